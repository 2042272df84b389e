// What the page may take of the machine that shows it.

/** Of a picture in one of the page, at most two: more costs time and is hardly seen. */
export function pixelRatio(): number {
  return Math.min(window.devicePixelRatio || 1, 2);
}
/** Of the machine, as far as the browser tells: 8 are "8 or more", or not known. */
export function memory_GB(): number {
  return (navigator as { deviceMemory?: number }).deviceMemory ?? 8;
}
