// Bookmarks of views, stored per scene: camera, planes, layout, window and rotation of the object.

import { effect, signal, untracked } from "@preact/signals-core";
import { byId, element } from "../base/dom.js";
import type { History } from "../state/history.js";
import { ANATOMICAL, type Anatomical, type Quaternion, type Vec3, type PlaneKind } from "../base/geometry.js";
import { storeScene, recallScene } from "../state/local_storage.js";
import { ALONG, type Along, type SectionPlacement, type SectionView } from "../section/section_view.js";
import { LAYOUTS, type Layout, type Session, type Window } from "../state/session.js";
import type { VolumeView } from "../volume/volume_view.js";
import { setMessages, words } from "../words/words.js";

interface BookmarkedSection extends SectionPlacement {
  kind: PlaneKind;
}
export interface BookmarkedView {
  layout: Layout;
  window: Window;
  camera: { right: Vec3; up: Vec3; focus: Vec3; across_mm: number };
  cross: Vec3 | null; // point of all planes; null: they follow the tip
  normal: Vec3; // unit normal of the oblique plane
  along: Along;
  anatomical: Anatomical;
  sections: BookmarkedSection[];
  rotation: Quaternion | null; // rotation of the object; null: unknown
}
export interface Bookmark {
  name: string;
  view: BookmarkedView;
}
/** Bookmarks of a scene, as this browser stores them. */
interface StoredBookmarks {
  bookmarks: Bookmark[];
}

const areNumbers = (x: unknown, count: number): boolean =>
  Array.isArray(x) && x.length === count && x.every(Number.isFinite);
/** Whether a value from the browser's storage is a valid bookmark. */
export function isBookmark(x: unknown): x is Bookmark {
  const { name, view } = (x ?? {}) as Partial<Bookmark>;
  const { window, camera, sections } = view ?? ({} as Partial<BookmarkedView>);
  return (
    typeof name === "string" &&
    typeof view === "object" &&
    Number.isFinite(window?.level) &&
    window!.width > 0 &&
    camera !== undefined &&
    [camera.right, camera.up, camera.focus, view.normal].every((v) => areNumbers(v, 3)) &&
    camera.across_mm >= 0 &&
    (view.cross === null || areNumbers(view.cross, 3)) &&
    (view.rotation === null || areNumbers(view.rotation, 4)) &&
    LAYOUTS.includes(view.layout!) &&
    ALONG.includes(view.along!) &&
    ANATOMICAL.includes(view.anatomical!) &&
    Array.isArray(sections) &&
    sections.every((one) => one.across_mm > 0 && areNumbers(one.pan, 2) && Number.isFinite(one.offset_mm))
  );
}

export interface Shows {
  session: Session;
  history: History;
  volume: VolumeView;
  sections: SectionView[];
  /** Requests a rotation of the object, if this viewer may. */
  turn(rotation: Quaternion): void;
}

export class Bookmarks {
  private readonly list = signal<Bookmark[]>([]);

  constructor(private readonly page: Shows) {
    const form = byId<HTMLFormElement>("bookmark-form");
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      const name = byId<HTMLInputElement>("bookmark-name");
      this.change([
        ...this.list.value,
        { name: name.value.trim() || words.bookmarkNumber(String(this.list.value.length + 1)), view: this.view() },
      ]);
      name.value = "";
      // moves the focus out of the text field, in which the space bar is not the emergency stop
      byId("bookmarks").querySelector<HTMLElement>("li:last-child .figure")?.focus();
    });
    effect(() => {
      const volumes = page.session.volumes.value;
      if (volumes) untracked(() => this.load(volumes.hash));
    });
    effect(() => this.show(this.list.value));
  }

  /** Loads the stored bookmarks of a scene, by the hash of its volume. */
  private load(hash: string): void {
    const stored: unknown = recallScene<StoredBookmarks>(hash).bookmarks;
    this.list.value = Array.isArray(stored) ? stored.filter(isBookmark) : [];
  }
  private change(list: Bookmark[]): void {
    const { history, session } = this.page;
    if (!session.scene.value) return;
    history.gesture += 1;
    history.push("bookmarks", { before: this.list.value, after: list, apply: (_, to) => this.set(to) });
    this.set(list);
  }
  private set(list: Bookmark[]): boolean {
    const scene = this.page.session.scene.value;
    if (!scene) return false;
    this.list.value = list;
    storeScene<StoredBookmarks>(scene.volume.hash, { bookmarks: list });
    return true;
  }
  private show(list: Bookmark[]): void {
    byId("bookmarks").replaceChildren(
      ...list.map((bookmark, index) => {
        const button = setMessages(
          element("button", { type: "button", className: "figure", textContent: bookmark.name }),
          { title: "showBookmark" },
          bookmark.name,
        );
        button.addEventListener("click", () => this.recall(bookmark.view));
        const remove = setMessages(
          element("button", { type: "button", textContent: "×" }),
          { label: "deleteNamed", title: "deleteNamed" },
          bookmark.name,
        );
        remove.addEventListener("click", () => {
          this.change(list.filter((_, other) => other !== index));
          // keeps the focus in the list
          (
            byId("bookmarks").querySelectorAll<HTMLElement>("button:last-child")[
              Math.min(index, this.list.value.length - 1)
            ] ?? byId("bookmark-name")
          ).focus();
        });
        return element("li", {}, button, remove);
      }),
    );
  }

  private view(): BookmarkedView {
    const { session, volume, sections } = this.page;
    const oblique = sections[0]!;
    return {
      layout: session.layout.value,
      window: session.window.value,
      camera: volume.placement,
      cross: session.planes.value.follow ? null : session.anchor(),
      normal: oblique.normal,
      along: oblique.along.value,
      anatomical: oblique.anatomical.value,
      // sections that were never shown have no extent
      sections: sections
        .filter(({ across_mm }) => across_mm > 0)
        .map(({ kind, placement }) => ({ kind, ...placement })),
      rotation: session.pose.value?.rotation ?? null,
    };
  }
  private recall(view: BookmarkedView): void {
    const { session, history, volume, sections, turn } = this.page;
    session.layout.value = view.layout;
    history.change("bookmark", () => {
      session.window.value = view.window;
      session.planes.value = {
        follow: view.cross === null,
        cross: view.cross,
        obliqueNormal: view.cross && view.normal,
      };
      for (const section of sections) {
        const own = view.sections.find(({ kind }) => kind === section.kind);
        if (own) section.placement = own;
      }
      const oblique = sections[0]!;
      [oblique.along.value, oblique.anatomical.value] = [view.along, view.anatomical];
      volume.placement = view.camera;
    });
    if (view.rotation) turn(view.rotation);
  }
}
