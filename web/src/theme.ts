// Light, dark, or as the system is; kept in this browser.

type Theme = "system" | "light" | "dark";
const ORDER: Theme[] = ["system", "light", "dark"];
const KEY = "palpate.theme";
const systemIsDark = matchMedia("(prefers-color-scheme: dark)");

function chosen(): Theme {
  const kept = localStorage.getItem(KEY) as Theme;
  return ORDER.includes(kept) ? kept : "system";
}
export function applyTheme(): void {
  const theme = chosen();
  document.documentElement.dataset.theme = theme === "system" ? (systemIsDark.matches ? "dark" : "light") : theme;
  document.getElementById("theme")!.textContent = `Theme: ${theme}`;
}
export function nextTheme(): void {
  localStorage.setItem(KEY, ORDER[(ORDER.indexOf(chosen()) + 1) % ORDER.length]!);
  applyTheme();
}
systemIsDark.addEventListener("change", applyTheme);
