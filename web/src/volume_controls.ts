// How the volume is looked at: what is taken away in front of the tip, perspective, the planes in it. A small menu in the picture's head.

import { element } from "./dom.js";
import type { Plane } from "./geometry.js";
import type { PlaneKind, SectionView } from "./section_view.js";
import type { Session } from "./session.js";
import type { Cutting, VolumeView } from "./volume_view.js";
import { says, type Message } from "./words.js";

const CUTTINGS: [Cutting, Message][] = [["none", "uncut"], ["plane", "cutAtTip"], ["hole", "openedToTip"]];
/** As the pictures of the planes are marked. */
const COLOURS: Record<PlaneKind, string> = { oblique: "#8adcf0", axial: "#f34a33", sagittal: "#edd54c", coronal: "#6eb04b" };

export function addVolumeControls(volume: VolumeView, session: Session, sections: SectionView[]): void {
  const change = (act: () => void) => () => {
    act();
    session.touch();
  };
  const cutting = element("select", { id: "cutting" }, ...CUTTINGS.map(([value, message]) => says(new Option("", value), { text: message })));
  cutting.addEventListener("change", change(() => (volume.cutting = cutting.value as Cutting)));
  const tick = (id: string, message: Message, set: (isOn: boolean) => void) => {
    const input = element("input", { id, type: "checkbox" });
    input.addEventListener("change", change(() => set(input.checked)));
    return element("label", {}, input, " ", says(element("span"), { text: message }));
  };
  const shown = (): { plane: Plane; colour: string }[] =>
    sections.filter(({ picture }) => picture.isShown).map(({ kind, shownPlane }) => ({ plane: shownPlane, colour: COLOURS[kind] }));
  const menu = element("details", { className: "menu small" },
    says(element("summary"), { text: "viewMenu", title: "viewMenuTitle" }),
    element("div", {},
      element("label", {}, says(element("span"), { text: "volumeCut" }), " ", cutting),
      tick("perspective", "perspective", (isOn) => (volume.camera.isPerspective = isOn)),
      tick("planes-in-volume", "planesInVolume", (isOn) => (volume.planes = isOn ? shown : () => []))));
  volume.picture.head.append(menu);
}
