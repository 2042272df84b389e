// Menu in the head of the volume's picture: clipping in front of the tip, perspective, planes in the volume.

import type { PlaneKind } from "../base/geometry.js";
import { element } from "../base/dom.js";
import type { History } from "../state/history.js";
import type { SectionView } from "../section/section_view.js";
import type { Cutting, VolumeView } from "../volume/volume_view.js";
import { setMessages, type Message } from "../words/words.js";

const CUTTINGS: [Cutting, Message][] = [
  ["none", "uncut"],
  ["plane", "cutAtTip"],
  ["hole", "openedToTip"],
];
/** Colour of each plane's outline in the volume, which also marks its picture. */
const COLOURS: Record<PlaneKind, string> = {
  oblique: "#8adcf0",
  axial: "#f34a33",
  sagittal: "#edd54c",
  coronal: "#6eb04b",
};

export function addVolumeControls(volume: VolumeView, history: History, sections: SectionView[]): void {
  const change = (act: () => void) => () => history.change("view", act);
  const cutting = element(
    "select",
    { id: "cutting" },
    ...CUTTINGS.map(([value, message]) => setMessages(new Option("", value), { text: message })),
  );
  cutting.addEventListener(
    "change",
    change(() => (volume.cutting = cutting.value as Cutting)),
  );
  const tick = (id: string, set: (isOn: boolean) => void) => {
    const input = element("input", { id, type: "checkbox" });
    input.addEventListener(
      "change",
      change(() => set(input.checked)),
    );
    return input;
  };
  const labelled = (input: HTMLElement, message: Message) =>
    element("label", {}, input, " ", setMessages(element("span"), { text: message }));
  const perspective = tick("perspective", (isOn) => (volume.camera.isPerspective = isOn));
  const planes = tick("planes-in-volume", (isOn) => (volume.showsPlanes = isOn));
  const everyVoxel = tick("every-voxel", (isOn) => {
    volume.isWhole = isOn;
    volume.load();
  });
  volume.planes = () =>
    sections
      .filter(({ picture }) => picture.isShown)
      .map(({ kind, shownPlane }) => ({ plane: shownPlane, colour: COLOURS[kind] }));
  const menu = element(
    "details",
    { className: "menu small" },
    setMessages(element("summary"), { text: "viewMenu", title: "viewMenuTitle" }),
    element(
      "div",
      {},
      element("label", {}, setMessages(element("span"), { text: "volumeCut" }), " ", cutting),
      labelled(perspective, "perspective"),
      labelled(planes, "planesInVolume"),
      // choice of full resolution, which is always on with a graphics card
      ...(volume.isSoftware ? [labelled(everyVoxel, "everyVoxel")] : []),
    ),
  );
  volume.picture.head.append(menu);
  history.register(
    "view",
    () => ({ cutting: volume.cutting, isPerspective: volume.camera.isPerspective, showsPlanes: volume.showsPlanes }),
    (to) => {
      [volume.cutting, volume.camera.isPerspective, volume.showsPlanes] = [
        to.cutting,
        to.isPerspective,
        to.showsPlanes,
      ];
      [cutting.value, perspective.checked, planes.checked] = [to.cutting, to.isPerspective, to.showsPlanes];
    },
  );
}
