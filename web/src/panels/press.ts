// Slider for the pressing force of the pointer.

import { effect } from "@preact/signals-core";
import { byId, write } from "../base/dom.js";
import type { Permissions } from "../state/permissions.js";
import type { Session } from "../state/session.js";
import { PRESS_N } from "../touch/touching.js";
import { quantity } from "../words/figures.js";

export function showPress(session: Session, permissions: Permissions): void {
  const slider = byId<HTMLInputElement>("press");
  [slider.min, slider.max] = PRESS_N.map(String) as [string, string];
  slider.addEventListener("input", () => (session.press_N.value = Number(slider.value)));
  effect(() => {
    byId("press-line").hidden = session.scene.value?.device.input !== "pointer" || !permissions.operateTool.value;
    slider.value = String(session.press_N.value);
    write(byId("press-value"), quantity(session.press_N.value, "N"));
  });
}
