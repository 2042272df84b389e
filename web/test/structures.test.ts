import assert from "node:assert/strict";
import test from "node:test";
import { isFound } from "../src/panels/structures_panel.js";

test("a structure is found by words of its name in any order", () => {
  assert.ok(isFound("lateral_tibial_cartilage", ""));
  assert.ok(isFound("lateral_tibial_cartilage", "Cart  lat"));
  assert.ok(isFound("lateral_tibial_cartilage", "tibial cart"));
  assert.ok(!isFound("lateral_tibial_cartilage", "cart medial"));
});
