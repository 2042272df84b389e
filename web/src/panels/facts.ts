// Facts about the session in the head and the foot of the page: side, modality, device, version, viewers.

import type { DeviceTool, Scene, State } from "../protocol/messages.js";
import { byId, write } from "../base/dom.js";
import type { Session } from "../state/session.js";
import { words, type Words } from "../words/words.js";

/** Name of a tool, and the form of its burr or shaver. */
const toolText = ({ name, burr, shaver }: DeviceTool): string =>
  words.toolNamed(name) + (burr ? ` · ${(shaver ? words.shaver : words.burr)[burr as keyof Words["burr"]]}` : "");

export function showFacts(session: Session): void {
  session.onScene((scene) => showScene(scene));
  session.onState((state) => write(byId("viewers"), viewersText(state)));
}

function showScene(scene: Scene): void {
  document.title = words.title(words.sideInTitle[scene.side]);
  write(byId("side"), words.side[scene.side]);
  byId("side").classList.toggle("warn", scene.side === "unknown");
  write(byId("modality"), words.modality[scene.modality] + (scene.oriented ? "" : ` · ${words.orientationUnknown}`));
  write(
    byId("device"),
    [scene.device.name, words.mover[scene.device.input], ...new Set(scene.tools.map(toolText))].join(" · "),
  );
  write(byId("version"), `palpate ${scene.palpate}`);
}

const viewersText = (state: State): string =>
  [
    state.viewers === 1 ? words.viewer : words.viewers(String(state.viewers)),
    ...(state.pointer_by === null ? [] : [state.pointer ? words.youHavePointer : words.viewerHasPointer]),
    ...(state.recording ? [words.sessionRecorded] : []),
    ...(state.armed ? [words.deviceArmed] : []),
  ].join(" · ");
