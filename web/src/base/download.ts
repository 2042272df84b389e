// Download of generated files.

export function download(blob: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}
/** File name stem with the local time, such as "palpate-2026-11-20-17-05-09". */
export function fileStem(): string {
  const now = new Date();
  const two = (n: number) => String(n).padStart(2, "0");
  return [
    "palpate",
    now.getFullYear(),
    two(now.getMonth() + 1),
    two(now.getDate()),
    two(now.getHours()),
    two(now.getMinutes()),
    two(now.getSeconds()),
  ].join("-");
}
