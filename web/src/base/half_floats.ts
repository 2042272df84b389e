// Conversion of scan values to IEEE 754 half precision: integers up to 2048 are exact, larger ones have 11 significant
// bits, which suffices for 256 grey levels.

let table: Uint16Array | null = null;

function makeTable(): Uint16Array {
  const made = new Uint16Array(65536);
  for (let bits = 0; bits < 65536; bits++) {
    const value = bits < 32768 ? bits : bits - 65536;
    const size = Math.abs(value);
    if (size === 0) continue;
    let exponent = Math.floor(Math.log2(size));
    let mantissa = Math.round((size / 2 ** exponent - 1) * 1024);
    if (mantissa === 1024) {
      mantissa = 0;
      exponent += 1;
    }
    made[bits] = (value < 0 ? 0x8000 : 0) | ((exponent + 15) << 10) | mantissa;
  }
  return made;
}

export function halfFloats(values: Int16Array): Uint16Array {
  table ??= makeTable();
  const halves = new Uint16Array(values.length);
  for (let i = 0; i < values.length; i++) halves[i] = table[values[i]! & 0xffff]!;
  return halves;
}
