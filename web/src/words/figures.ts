// Formatting of quantities: three significant digits, in a unit that avoids leading zeros. Continuously changing
// figures have columns of fixed width, which keeps the layout stable.

import { words } from "./words.js";

/** Unit that is a thousandth of each unit. */
const SMALLER: Record<Unit, string> = { N: "mN", mm: "µm", "N/mm": "N/m", "mm/s": "µm/s" };
export type Unit = "N" | "mm" | "N/mm" | "mm/s";
/** Fraction of a unit below which the smaller unit is used. */
const SMALL = 0.01;
/** Magnitude below which a value is a rounding error and displayed as 0. */
const NOTHING = 1e-9;
const SUPERSCRIPT = [..."⁰¹²³⁴⁵⁶⁷⁸⁹"];

const signed = (text: string): string => text.replace("-", "−");

/** Text of a number with three significant digits, or all integer digits: 1234, 123, 12.3, 0.123, 0.000420. */
export function digits(value: number): string {
  if (!Number.isFinite(value)) return "–";
  if (value === 0) return "0.00";
  // exponent after rounding: 9.999 becomes 10.0
  const power = Number(value.toExponential(2).split("e")[1]);
  if (power >= -6) return signed(value.toFixed(Math.max(0, 2 - power)));
  const [mantissa] = value.toExponential(2).split("e");
  return `${signed(mantissa!)}·10⁻${[...String(-power)].map((digit) => SUPERSCRIPT[Number(digit)]).join("")}`;
}

/** Texts of the number and of the unit of a quantity. */
export function measured(value: number, unit: Unit): [string, string] {
  const size = Math.abs(value);
  if (size < NOTHING) return [digits(0), unit];
  return size < SMALL ? [digits(1000 * value), SMALLER[unit]] : [digits(value), unit];
}
/** Text of a quantity: "12.3 mm", "4.20 µm". */
export const quantity = (value: number, unit: Unit): string => measured(value, unit).join(" ");

/**
 * Text of a force limit without trailing zeros: "3 N".
 * @param limit_N  limit of the tick; 0 while no force is allowed: the configured limit is displayed instead
 * @param set_N  configured limit
 */
export function limitQuantity(limit_N: number, set_N: number): string {
  const [figure, unit] = measured(limit_N > 0 ? limit_N : set_N, "N");
  return `${figure.includes(".") ? figure.replace(/\.?0+$/, "") : figure} ${unit}`;
}
/** Text of the force limit of a tick and, if that is lower (warm motors), of the configured limit, too. */
export function limitText(limit_N: number, set_N: number): string {
  const [now, wanted] = [limitQuantity(limit_N, set_N), limitQuantity(set_N, set_N)];
  return limit_N < set_N && now !== wanted ? words.limitNowAndSet(now, wanted) : words.limitNow(now);
}

/** Text of a scan value: an integer for integer steps, else three significant digits, but none below a step. */
export function valueText(value: number, step: number): string {
  if (step >= 1) return signed(value.toFixed(0));
  const stepDigits = Math.ceil(-Math.log10(step));
  const shown = digits(value);
  return (shown.split(".")[1] ?? "").length > stepDigits ? signed(value.toFixed(stepDigits)) : shown;
}

/** Text of the quantization step of a scan that was rounded on download; empty for a step of 1. */
export const stepsText = (step: number): string => (step === 1 ? "" : words.steps(digits(step)));

/** Number of decimals of a millimetre that resolve half a voxel, at least one. */
export const decimalsFor = (voxel_mm: number): number => Math.max(1, Math.ceil(-Math.log10(voxel_mm / 2)));
