import assert from "node:assert/strict";
import test from "node:test";
import {
  decimalsFor,
  digits,
  limitQuantity,
  limitText,
  measured,
  quantity,
  stepsText,
  valueText,
} from "../src/words/figures.js";
import { positionText } from "../src/base/geometry.js";
import { measureText } from "../src/drawing/measure.js";

test("figures have three significant digits and keep all integer digits", () => {
  assert.deepEqual(
    [12345, 123.4, 99.96, 12.34, 9.996, 1.234, 0.99951, 0.1234, 0.01234, 0.00042, -0.00042, 0].map(digits),
    ["12345", "123", "100", "12.3", "10.0", "1.23", "1.00", "0.123", "0.0123", "0.000420", "−0.000420", "0.00"],
  );
  assert.equal(digits(4.2e-9), "4.20·10⁻⁹");
  assert.equal(digits(-4.2e-12), "−4.20·10⁻¹²");
  assert.equal(digits(NaN), "–");
  for (let n = 0; n < 3000; n++) {
    const value = 10 ** (6 * Math.random() - 6);
    const error = Math.abs(Number(digits(value)) / value - 1);
    assert.ok(error <= 0.005, `${value} is shown as ${digits(value)}`);
  }
});

test("small quantities have a unit without leading zeros", () => {
  assert.deepEqual(
    [0.00042, 0.0099, 0.01, 1.4, 3.3, 0].map((force) => quantity(force, "N")),
    ["0.420 mN", "9.90 mN", "0.0100 N", "1.40 N", "3.30 N", "0.00 N"],
  );
  assert.equal(quantity(-0.00042, "mm"), "−0.420 µm");
  assert.equal(quantity(0.0042, "N/mm"), "4.20 N/m");
  assert.deepEqual(measured(1e-12, "N"), ["0.00", "N"], "what is left of a sum is nothing");
});

test("a force limit lowered by warm motors is displayed with the configured one", () => {
  assert.equal(limitText(3.3, 3.3), "of 3.3 N");
  assert.equal(limitText(Math.fround(3.3), 3.3), "of 3.3 N", "rounded to single precision");
  assert.equal(limitText(3, 3.3), "of 3 N (set to 3.3 N)");
  assert.equal(limitText(0, 3), "of 3 N", "no force is allowed");
});

test("a force limit has no trailing zeros", () => {
  assert.deepEqual(
    [120, 10, 3, 0.5, 0.005].map((limit_N) => limitQuantity(limit_N, limit_N)),
    ["120 N", "10 N", "3 N", "0.5 N", "5 mN"],
  );
});

test("scan values have the precision of their step", () => {
  assert.equal(valueText(-1024, 1), "−1024");
  assert.equal(valueText(0.00042, 1 / 65535 / 10), "0.000420");
  assert.equal(valueText(0.00042, 0.00002), "0.00042");
  assert.equal(valueText(123.456, 0.002), "123");
  assert.equal(valueText(0.0004, 0.3), "0.0", "less than a step is not told");
});

test("the quantization step of a rounded scan is displayed", () => {
  assert.equal(stepsText(1), "");
  assert.ok(stepsText(2.5 / 65535).includes("steps of 0.0000381"));
});

test("positions resolve half a voxel, and short lengths keep their digits", () => {
  assert.deepEqual([5, 0.9, 0.35, 0.1, 0.01].map(decimalsFor), [1, 1, 1, 2, 3]);
  assert.equal(positionText([0.1234, -2, 3], "LPS", 3), "LPS +0.123  −2.000  +3.000 mm");
  assert.equal(
    measureText({
      kind: "ruler",
      points: [
        [0, 0, 0],
        [0, 0.0042, 0],
      ],
    }),
    "4.20 µm",
  );
  assert.equal(
    measureText({
      kind: "ruler",
      points: [
        [0, 0, 0],
        [3, 4, 0],
      ],
    }),
    "5.00 mm",
  );
  assert.equal(
    measureText({
      kind: "angle",
      points: [
        [1, 0, 0],
        [0, 0, 0],
        [0, 0, 3],
      ],
    }),
    "90.0°",
  );
  assert.equal(
    measureText({
      kind: "angle",
      points: [
        [1, 0, 0],
        [0, 0, 0],
        [0, 0, 0],
      ],
    }),
    "",
    "its third point is to come",
  );
});
