// Bookmarks of views, stored per scene: camera, planes, layout, window and rotation of the object.

import { byId, element } from "../base/dom.js";
import type { History } from "../state/history.js";
import { ANATOMICAL, type Anatomical, type Quaternion, type Vec3, type PlaneKind } from "../base/geometry.js";
import { keepScene, recallScene } from "../state/kept.js";
import { ALONG, type Along, type SectionStand, type SectionView } from "../section/section_view.js";
import { LAYOUTS, type Layout, type Session, type Window } from "../state/session.js";
import type { VolumeView } from "../volume/volume_view.js";
import { says, words } from "../words/words.js";

interface SectionSeen extends SectionStand {
  kind: PlaneKind;
}
export interface Seen {
  layout: Layout;
  window: Window;
  camera: { right: Vec3; up: Vec3; focus: Vec3; across_mm: number };
  cross: Vec3 | null; // point of all planes; null: they follow the tip
  normal: Vec3; // unit normal of the oblique plane
  along: Along;
  like: Anatomical;
  sections: SectionSeen[];
  rotation: Quaternion | null; // rotation of the object; null: unknown
}
export interface Bookmark {
  name: string;
  seen: Seen;
}
/** Bookmarks of a scene, as this browser stores them. */
interface KeptBookmarks {
  bookmarks: Bookmark[];
}

const areNumbers = (x: unknown, count: number): boolean =>
  Array.isArray(x) && x.length === count && x.every(Number.isFinite);
/** Whether a value from the browser's storage is a valid bookmark. */
export function isBookmark(x: unknown): x is Bookmark {
  const { name, seen } = (x ?? {}) as Partial<Bookmark>;
  const { window, camera, sections } = seen ?? ({} as Partial<Seen>);
  return (
    typeof name === "string" &&
    typeof seen === "object" &&
    Number.isFinite(window?.level) &&
    window!.width > 0 &&
    camera !== undefined &&
    [camera.right, camera.up, camera.focus, seen.normal].every((v) => areNumbers(v, 3)) &&
    camera.across_mm >= 0 &&
    (seen.cross === null || areNumbers(seen.cross, 3)) &&
    (seen.rotation === null || areNumbers(seen.rotation, 4)) &&
    LAYOUTS.includes(seen.layout!) &&
    ALONG.includes(seen.along!) &&
    ANATOMICAL.includes(seen.like!) &&
    Array.isArray(sections) &&
    sections.every((one) => one.across_mm > 0 && areNumbers(one.pan, 2) && Number.isFinite(one.offset_mm))
  );
}

export interface Shows {
  session: Session;
  history: History;
  volume: VolumeView;
  sections: SectionView[];
  layout(): Layout;
  choose(layout: Layout): void;
  /** Sets the direction that the oblique plane contains, and the anatomical plane that it stays close to. */
  orient(along: Along, like: Anatomical): void;
  /** Requests a rotation of the object, if this viewer may. */
  turn(rotation: Quaternion): void;
}

export class Bookmarks {
  private list: Bookmark[] = [];

  constructor(private readonly page: Shows) {
    const form = byId<HTMLFormElement>("bookmark-form");
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      const name = byId<HTMLInputElement>("bookmark-name");
      this.change([
        ...this.list,
        { name: name.value.trim() || words.bookmarkNumber(String(this.list.length + 1)), seen: this.seen() },
      ]);
      name.value = "";
      // moves the focus out of the text field, in which the space bar is not the emergency stop
      byId("bookmarks").querySelector<HTMLElement>("li:last-child .figure")?.focus();
    });
    this.show();
  }

  /** Loads the stored bookmarks of the current scene. */
  load(): void {
    const kept: unknown = recallScene<KeptBookmarks>(this.page.session.scene!.volume.hash).bookmarks;
    this.list = Array.isArray(kept) ? kept.filter(isBookmark) : [];
    this.show();
  }
  private change(list: Bookmark[]): void {
    const { history, session } = this.page;
    if (!session.scene) return;
    history.gesture += 1;
    history.note("bookmarks", { before: this.list, after: list, go: (_, to) => this.set(to) });
    this.set(list);
  }
  private set(list: Bookmark[]): boolean {
    const { scene } = this.page.session;
    if (!scene) return false;
    this.list = list;
    keepScene<KeptBookmarks>(scene.volume.hash, { bookmarks: list });
    this.show();
    return true;
  }
  private show(): void {
    byId("bookmarks").replaceChildren(
      ...this.list.map((bookmark, place) => {
        const go = says(
          element("button", { type: "button", className: "figure", textContent: bookmark.name }),
          { title: "showBookmark" },
          bookmark.name,
        );
        go.addEventListener("click", () => this.recall(bookmark.seen));
        const remove = says(
          element("button", { type: "button", textContent: "×" }),
          { label: "deleteNamed", title: "deleteNamed" },
          bookmark.name,
        );
        remove.addEventListener("click", () => {
          this.change(this.list.filter((_, other) => other !== place));
          // keeps the focus in the list
          (
            byId("bookmarks").querySelectorAll<HTMLElement>("button:last-child")[
              Math.min(place, this.list.length - 1)
            ] ?? byId("bookmark-name")
          ).focus();
        });
        return element("li", {}, go, remove);
      }),
    );
  }

  private seen(): Seen {
    const { session, volume, sections, layout } = this.page;
    const oblique = sections[0]!;
    return {
      layout: layout(),
      window: session.window,
      camera: volume.stand,
      cross: session.follow ? null : session.anchor(),
      normal: oblique.normal,
      along: oblique.along,
      like: oblique.like,
      // sections that were never shown have no extent
      sections: sections.filter(({ across_mm }) => across_mm > 0).map(({ kind, stand }) => ({ kind, ...stand })),
      rotation: session.pose?.rotation ?? null,
    };
  }
  private recall(seen: Seen): void {
    const { session, history, volume, sections, choose, orient, turn } = this.page;
    choose(seen.layout);
    history.change("bookmark", () => {
      session.window = seen.window;
      session.planes = { follow: seen.cross === null, cross: seen.cross, obliqueNormal: seen.cross && seen.normal };
      for (const section of sections) {
        const own = seen.sections.find(({ kind }) => kind === section.kind);
        if (own) section.stand = own;
      }
      orient(seen.along, seen.like);
      volume.stand = seen.camera;
    });
    if (seen.rotation) turn(seen.rotation);
    session.touch();
  }
}
