// Buttons in the head of the volume's picture: standard views, and rotation of the object instead of the camera.

import { element, press } from "../base/dom.js";
import type { Preset } from "./camera.js";
import type { VolumeView } from "./volume_view.js";
import { setMessages, type Message } from "../words/words.js";

const VIEWS: [Preset, string, Message][] = [
  ["anterior", "A", "lookFromAnterior"],
  ["posterior", "P", "lookFromPosterior"],
  ["left", "L", "lookFromLeft"],
  ["right", "R", "lookFromRight"],
  ["superior", "S", "lookFromSuperior"],
  ["inferior", "I", "lookFromInferior"],
];

export function addVolumeHead(volume: VolumeView): void {
  const group = setMessages(element("div", { className: "group small", role: "group" }), { label: "lookFrom" });
  for (const [preset, letter, message] of VIEWS) {
    const button = setMessages(element("button", { type: "button", textContent: letter }), {
      title: message,
      label: message,
    });
    button.dataset.look = preset;
    button.addEventListener("click", () => volume.orient(preset));
    group.append(button);
  }
  const turn = setMessages(element("button", { type: "button", className: "small" }), {
    text: "turn",
    title: "turnTitle",
  });
  press(turn, false);
  turn.id = "turn";
  turn.addEventListener("click", () => {
    volume.turnsObject = !volume.turnsObject;
    press(turn, volume.turnsObject);
  });
  volume.picture.head.append(group, turn);
}
