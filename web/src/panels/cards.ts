// Cards of the panel, open or closed as this browser has stored it.

import { store, recall } from "../state/local_storage.js";
import { PAGE_KEY, type StoredPage } from "../state/session.js";

export function storeCards(): void {
  const { cards = {} } = recall<StoredPage>(PAGE_KEY);
  for (const card of document.querySelectorAll<HTMLDetailsElement>("details.card")) {
    const name = card.querySelector("summary")!.dataset.words!;
    card.open = cards[name] ?? card.open;
    card.addEventListener("toggle", () =>
      store<StoredPage>(PAGE_KEY, { cards: { ...recall<StoredPage>(PAGE_KEY).cards, [name]: card.open } }),
    );
  }
}
