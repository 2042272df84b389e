// Readout of the position under the mouse, else of the tip: coordinates, value of the scan, structure.

import { byId, write } from "../base/dom.js";
import { decimalsFor, valueText } from "../words/figures.js";
import { positionText } from "../base/geometry.js";
import { readable, type Session } from "../state/session.js";
import { words } from "../words/words.js";

/** Updates the readout; to be called after sections are drawn, because planes may move under a resting mouse. */
export function showReadout(session: Session): void {
  const volumes = session.volumes.value,
    scene = session.scene.value,
    device = session.pose.value?.devices[0];
  const pointed = session.pointed.value?.() ?? null;
  const p = pointed ?? device?.tip;
  if (!p || !volumes || !scene) return;
  const position = positionText(p, session.convention.value, decimalsFor(volumes.voxelSize / volumes.shrink));
  write(byId("position"), pointed ? position : `${words.statusTip}  ${position}`);
  const value = volumes.valueAt(p);
  const { scan } = scene.volume;
  const figure = value === null || !scan ? null : valueText(value, scan.scale);
  write(byId("value"), figure === null ? "" : scene.modality === "ct" ? `${figure} HU` : words.value(figure));
  const structureIndex = volumes.structureAt(p);
  if (!pointed && device) write(byId("structure"), session.contactOf(device).words);
  else write(byId("structure"), structureIndex === null ? "" : readable(session.nameAt(structureIndex)));
}
