// Menus in the head of the oblique section: direction that its plane contains, and anatomical plane that it resembles.

import { effect, type Signal } from "@preact/signals-core";
import { element } from "../base/dom.js";
import type { Anatomical } from "../base/geometry.js";
import type { History } from "../state/history.js";
import type { Session } from "../state/session.js";
import type { Along, SectionView } from "./section_view.js";
import { setMessages, type Message } from "../words/words.js";

export function addObliqueHead(section: SectionView, session: Session, history: History): void {
  const choose = <Choice extends string>(label: Message, chosen: Signal<Choice>, options: [Choice, Message][]) => {
    const select = setMessages(
      element(
        "select",
        { className: "small" },
        ...options.map(([value, message]) => setMessages(new Option("", value), { text: message })),
      ),
      { label, title: label },
    );
    select.addEventListener("change", () =>
      history.change("section", () => {
        chosen.value = select.value as Choice;
        session.planes.value = { ...session.planes.peek(), obliqueNormal: null };
      }),
    );
    effect(() => void (select.value = chosen.value));
    return select;
  };
  const along = choose<Along>("sectionAlong", section.along, [
    ["tool", "alongTool"],
    ["force", "alongForce"],
    ["fixed", "fixed"],
  ]);
  const anatomical = choose<Anatomical>("sectionLike", section.anatomical, [
    ["sagittal", "likeSagittal"],
    ["coronal", "likeCoronal"],
    ["axial", "likeAxial"],
  ]);
  section.picture.head.append(along, anatomical);
  history.register(
    "section",
    () => [section.along.value, section.anatomical.value] as [Along, Anatomical],
    (to) => ([section.along.value, section.anatomical.value] = to),
  );
}
