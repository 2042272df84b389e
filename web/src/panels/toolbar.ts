// Toolbar: tool of a drag, layout of the pictures, whether the planes follow the tip, undo and redo.

import { effect } from "@preact/signals-core";
import { byId, press } from "../base/dom.js";
import type { History } from "../state/history.js";
import type { Connection } from "../protocol/connection.js";
import { store, recall } from "../state/local_storage.js";
import type { Permissions } from "../state/permissions.js";
import type { Requests } from "../state/requests.js";
import { LAYOUTS, PAGE_KEY, type StoredPage, type Layout, type Session, type Tool } from "../state/session.js";

/** Buttons of which one is pressed: those with a data attribute of this name. */
const choices = (name: "tool" | "layout"): HTMLElement[] => [
  ...document.querySelectorAll<HTMLElement>(`[data-${name}]`),
];

export class Toolbar {
  private hasAsked = false; // the pointer was requested in this connection
  private wasPointer: boolean | null = null; // the previous scene had a pointer that this viewer may use

  constructor(
    private readonly session: Session,
    private readonly connection: Connection,
    private readonly requests: Requests,
    private readonly history: History,
    private readonly permissions: Permissions,
  ) {
    for (const button of choices("tool"))
      button.addEventListener("click", () => this.chooseTool(button.dataset.tool as Tool));
    for (const button of choices("layout"))
      button.addEventListener("click", () => (session.layout.value = button.dataset.layout as Layout));
    byId("follow").addEventListener("click", () => this.toggleFollow());
    byId("undo").addEventListener("click", () => void history.undo());
    byId("redo").addEventListener("click", () => void history.redo());
    // the release of a slider ends an undo step
    document.addEventListener("change", () => (history.gesture += 1));
    history.register(
      "planes",
      () => session.planes.value,
      (to) => (session.planes.value = to),
    );
    const { layout } = recall<StoredPage>(PAGE_KEY);
    if (layout && LAYOUTS.includes(layout)) session.layout.value = layout;
    effect(() => {
      byId<HTMLButtonElement>("undo").disabled = !history.canUndo.value;
      byId<HTMLButtonElement>("redo").disabled = !history.canRedo.value;
    });
    effect(() => press(byId("follow"), session.planes.value.follow));
    effect(() => this.check("tool", session.tool.value));
    effect(() => this.showLayout(session.layout.value));
    effect(() => {
      void connection.link.value;
      this.hasAsked = false;
    });
    effect(() => {
      this.offerTouch();
      if (session.state.value) this.claimPointer();
    });
  }

  toggleFollow(): void {
    const { session } = this;
    const follow = !session.planes.value.follow;
    const tip = session.pose.value?.devices[0]?.tip ?? null;
    this.history.change(
      "follow",
      () => (session.planes.value = { follow, cross: follow ? null : tip, obliqueNormal: null }),
    );
  }
  /** Chooses a tool; the pointer is taken or released with it. */
  chooseTool(tool: Tool): void {
    const { session } = this;
    if (tool === "touch" && (session.scene.value?.device.input !== "pointer" || !this.permissions.operateTool.value))
      return;
    const has = session.state.value?.pointer === true;
    session.tool.value = tool;
    if (has !== (tool === "touch")) void this.requests.once({ type: "pointer", take: tool === "touch" });
  }

  private check(name: "tool" | "layout", chosen: string): void {
    for (const button of choices(name)) button.setAttribute("aria-checked", String(button.dataset[name] === chosen));
  }
  private showLayout(layout: Layout): void {
    store<StoredPage>(PAGE_KEY, { layout });
    byId("pictures").className = `pictures layout-${layout}`;
    this.check("layout", layout);
  }
  /** Offers touching with a pointer as device, whose default tool it is. */
  private offerTouch(): void {
    const { session } = this;
    const scene = session.scene.value;
    if (!scene) return;
    const hasPointer = scene.device.input === "pointer";
    choices("tool").find(({ dataset }) => dataset.tool === "touch")!.hidden = !hasPointer;
    const isPointer = hasPointer && scene.may.includes("hand");
    if (isPointer && this.wasPointer !== true) session.tool.value = "touch";
    else if (!isPointer && session.tool.peek() === "touch") session.tool.value = "window";
    this.wasPointer = isPointer;
  }
  /**
   * Requests the pointer once in a connection, silently, unlike when the user chooses the tool. A teacher's page leaves
   * it to the learners until a press.
   */
  private claimPointer(): void {
    if (this.hasAsked || this.session.tool.peek() !== "touch" || this.connection.allows("lesson")) return;
    this.hasAsked = true;
    void this.connection.request({ type: "pointer", take: true });
  }
}
