// Figures for people: three significant digits, in a unit in which they are read easily. A figure that changes all the time
// stands in a column of its own width, so that its length moves nothing else.

import { words } from "./words.js";

/** Units a thousand times smaller, for what would begin with zeros. */
const SMALLER: Record<Unit, string> = { N: "mN", mm: "µm", "N/mm": "N/m", "mm/s": "µm/s" };
export type Unit = "N" | "mm" | "N/mm" | "mm/s";
/** Below so much of a unit its smaller one is taken. */
const SMALL = 0.01;
/** Of a unit; what is less is what is left of a sum that ought to be nothing. */
const NOTHING = 1e-9;
const SUPERSCRIPT = [..."⁰¹²³⁴⁵⁶⁷⁸⁹"];

const signed = (text: string): string => text.replace("-", "−");

/** Three significant digits, or all of those before the point: 1234, 123, 12.3, 0.123, 0.000420. */
export function digits(value: number): string {
  if (!Number.isFinite(value)) return "–";
  if (value === 0) return "0.00";
  // its power of ten as it is after rounding: 9.999 is 10.0
  const power = Number(value.toExponential(2).split("e")[1]);
  if (power >= -6) return signed(value.toFixed(Math.max(0, 2 - power)));
  const [mantissa] = value.toExponential(2).split("e");
  return `${signed(mantissa!)}·10⁻${[...String(-power)].map((digit) => SUPERSCRIPT[Number(digit)]).join("")}`;
}

/** The figure and its unit, apart from each other. */
export function measured(value: number, unit: Unit): [string, string] {
  const size = Math.abs(value);
  if (size < NOTHING) return [digits(0), unit];
  return size < SMALL ? [digits(1000 * value), SMALLER[unit]] : [digits(value), unit];
}
/** "12.3 mm", "4.20 µm" */
export const quantity = (value: number, unit: Unit): string => measured(value, unit).join(" ");

/** The force's limit in this tick; where that is below the one that is set (a warm motor), both. */
export function limitText(limit_N: number, set_N: number): string {
  const [now, wanted] = [quantity(limit_N, "N"), quantity(set_N, "N")];
  return limit_N < set_N && now !== wanted ? words.limitNowAndSet(now, wanted) : words.limitNow(now);
}

/** A value of the scan: whole where it comes in whole steps, else three significant digits, but none below a step. */
export function valueText(value: number, step: number): string {
  if (step >= 1) return signed(value.toFixed(0));
  const stepDigits = Math.ceil(-Math.log10(step));
  const shown = digits(value);
  return (shown.split(".")[1] ?? "").length > stepDigits ? signed(value.toFixed(stepDigits)) : shown;
}

/** Of a scan that did not come as it is: how finely it did. */
export const stepsText = (step: number): string =>
  step === 1 ? "" : words.steps(digits(step));

/** As many decimals of a millimetre as tell half a voxel, and one at least. */
export const decimalsFor = (voxel_mm: number): number => Math.max(1, Math.ceil(-Math.log10(voxel_mm / 2)));
