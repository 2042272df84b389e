// Cards of the panel, open or closed as this browser has stored it.

import { keep, recall } from "../state/local_storage.js";
import { PAGE_KEY, type KeptPage } from "../state/session.js";

export function keepCards(): void {
  const { cards = {} } = recall<KeptPage>(PAGE_KEY);
  for (const card of document.querySelectorAll<HTMLDetailsElement>("details.card")) {
    const name = card.querySelector("summary")!.dataset.words!;
    card.open = cards[name] ?? card.open;
    card.addEventListener("toggle", () =>
      keep<KeptPage>(PAGE_KEY, { cards: { ...recall<KeptPage>(PAGE_KEY).cards, [name]: card.open } }),
    );
  }
}
