import assert from "node:assert/strict";
import { test } from "node:test";
import { pictureQuery, readPicture } from "../src/volume/served_pictures.js";
import { Found, type View } from "../src/volume/view.js";

const view: View = {
  width: 64,
  height: 48,
  corner: [-10, -10.5, 0],
  across: [1, 0, 0],
  down: [0, 1, 0],
  into: [0, 0, 1],
  eye: null,
  cut: null,
  isFine: true,
};

test("a picture is requested as specified by the protocol", () => {
  assert.equal(pictureQuery(view, Uint8Array.of(255, 0, 10, 255)), "view=64,48,-10,-10.5,0,1,0,0,0,1,0&looks=ff000aff");
  const eye = { at: [1, 2, -30] as [number, number, number], nearest_mm: 0, reach_mm: Infinity, isRound: false };
  const cut = { at: [1, 2, 3] as [number, number, number], radius_mm: 0, widening: Infinity, unclipped: 0 };
  assert.equal(
    pictureQuery({ ...view, eye, cut }, new Uint8Array(0)),
    "view=64,48,-10,-10.5,0,1,0,0,0,1,0,1,2,-30&cut=1,2,3,0,0,-1",
  );
  assert.equal(
    pictureQuery({ ...view, cut: { ...cut, widening: 0.4 } }, new Uint8Array(0)),
    "view=64,48,-10,-10.5,0,1,0,0,0,1,0",
  );
});

test("a response has colours, depths and structures", () => {
  const [w, h] = [3, 2];
  const bytes = new Uint8Array(24 + 6 * w * h);
  const head = new DataView(bytes.buffer);
  bytes.set([0x50, 0x4c, 0x50, 0x56]);
  head.setUint16(4, 3, true);
  head.setUint16(8, w, true);
  head.setUint16(10, h, true);
  head.setFloat32(12, -5, true);
  head.setFloat32(16, 20, true);
  const at = 2 + w; // pixel at the lower right
  bytes.set([10, 20, 30], 24 + 3 * at);
  head.setUint16(24 + 3 * w * h + 2 * at, 65535, true);
  bytes[24 + 5 * w * h + at] = 2;
  const read = readPicture(bytes.buffer);
  assert.deepEqual([...read.rgba.slice(4 * at, 4 * at + 4)], [10, 20, 30, 255]);
  const found = new Found(read.found, { ...view, width: w, height: h }, read.min_mm, read.extent_mm);
  assert.deepEqual(found.at(0.9, 0.9), { way_mm: 15, structure: 1 });
  assert.equal(found.at(0.1, 0.1), null);
  for (const length of [0, 10, 24, bytes.length - 1]) assert.throws(() => readPicture(bytes.buffer.slice(0, length)));
});
