// Page: creates the session, the pictures and the panels, and connects them.

import { batch, effect } from "@preact/signals-core";
import { toast } from "./base/announce.js";
import { byId } from "./base/dom.js";
import {
  add,
  angleOf_deg,
  conjugate,
  multiply,
  scale,
  type PlaneKind,
  type Quaternion,
  type Vec3,
} from "./base/geometry.js";
import type { Measure } from "./drawing/measure.js";
import { Frames } from "./page/frames.js";
import { Graphics } from "./page/graphics.js";
import { Loading } from "./page/loading.js";
import { Panels } from "./page/panels.js";
import { VoxelChanges } from "./page/voxels.js";
import { CaptureButtons } from "./panels/capture_buttons.js";
import { storeCards } from "./panels/cards.js";
import { ContactPanel } from "./panels/contact_panel.js";
import { DevicePanel } from "./panels/device_panel.js";
import { showFacts } from "./panels/facts.js";
import { Keys } from "./panels/keys.js";
import { showLink } from "./panels/link.js";
import { nextTheme } from "./panels/theme.js";
import { Toolbar } from "./panels/toolbar.js";
import { addVolumeControls } from "./panels/volume_controls.js";
import { Connection, type Link } from "./protocol/connection.js";
import type { Scene, State } from "./protocol/messages.js";
import { PROTOCOL } from "./protocol/wire.js";
import { Measures } from "./section/measures_panel.js";
import { SectionView } from "./section/section_view.js";
import type { AnySlicer } from "./section/slicer.js";
import { History } from "./state/history.js";
import { Permissions } from "./state/permissions.js";
import { PlanStore } from "./state/plan_store.js";
import { PointerDevice } from "./state/pointer.js";
import { Requests } from "./state/requests.js";
import { Session, type Layout } from "./state/session.js";
import { Touching } from "./touch/touching.js";
import { addVolumeHead } from "./volume/volume_head.js";
import { VolumeRenderer } from "./volume/volume_renderer.js";
import { VolumeView } from "./volume/volume_view.js";
import { LazyModule } from "./words/lazy_module.js";
import { versionError } from "./words/errors.js";
import { words } from "./words/words.js";

/** Angle below which a rotation is ignored. */
const MIN_TURN_DEG = 0.05;
const SECTIONS: PlaneKind[] = ["oblique", "axial", "sagittal", "coronal"];
/** Layouts that the keys 1 to 6 choose. */
const LAYOUT_KEYS: Layout[] = ["two", "five", "volume", "section", "inside", "scope"];

export class Page {
  readonly session = new Session();
  readonly history = new History();
  readonly loading = new Loading();
  readonly connection = this.connect();
  readonly requests = new Requests(
    this.connection,
    () => this.session.state.value?.armed === true,
    () => this.session.state.value,
    this.history,
  );
  readonly permissions = new Permissions(this.session, this.connection);
  readonly renderer = new VolumeRenderer();
  readonly volume: VolumeView;
  readonly sections: SectionView[];
  readonly measures = new Measures(this.history, (measure) => this.moveTo(measure));
  readonly scope = new LazyModule("scope", async () => {
    const { ScopeView } = await import("./volume/scope_view.js");
    const scope = new ScopeView(this.session, this.renderer, this.slicer.isSoftware, this.history, this.pointer);
    this.volume.picture.element.after(scope.picture.element);
    this.pictures.splice(1, 0, scope.picture);
    return scope;
  });
  readonly pointer = new PointerDevice(this.session, this.connection, this.permissions, this.requests);
  readonly voxels: VoxelChanges;
  readonly panels: Panels;
  readonly captures: CaptureButtons;
  readonly deferredPanels = new LazyModule("later", async () => {
    const { session, requests, history, permissions, volume, sections } = this;
    const parts = await import("./panels/deferred_panels.js");
    parts.addObliqueHead(sections[0]!, session, history);
    parts.showTracked(session);
    parts.showPress(session, permissions);
    new parts.HapticsPanel(session, this.connection, requests, permissions);
    new parts.DisplayPanel(session, history);
    new parts.LoopPlots(session);
    new parts.BurrControls(session, this.connection);
    new parts.Bookmarks({ session, history, volume, sections, turn: (rotation) => this.turn(rotation) });
    return new parts.StructuresPanel(session, requests, history, permissions);
  });
  readonly frames: Frames;
  arePanelsLoaded = false; // all dynamically imported panels are loaded
  private readonly pictures;

  /** @param language  resolves when the page's texts are loaded */
  constructor(
    readonly slicer: AnySlicer,
    private readonly language: Promise<void>,
  ) {
    const { session, connection, requests, history, renderer, loading, measures, scope } = this;
    session.plans = new PlanStore(
      history,
      (request) => requests.once({ type: "plan", ...request }),
      () => connection.allows("plan"),
    );
    const { pointer } = this;
    pointer.onReleasedByPause = () => toast(words.releasedByPause);
    const volume = new VolumeView(
      session,
      renderer,
      slicer.isSoftware,
      slicer.maxSide,
      pointer,
      history,
      (rotation, gesture) => void requests.latest("rotation", { type: "set", rotation_wxyz: rotation }, gesture),
    );
    const sections = SECTIONS.map((kind) => new SectionView(kind, session, slicer, measures, pointer, history));
    [this.volume, this.sections] = [volume, sections];
    this.pictures = [volume.picture, ...sections.map((section) => section.picture)];
    byId("pictures").append(...this.pictures.map((picture) => picture.element));
    addVolumeHead(volume);
    addVolumeControls(volume, history, sections);

    this.voxels = new VoxelChanges(session, slicer, renderer, volume);
    new Graphics(session, slicer, renderer, () => {
      for (const view of [volume, scope.value]) view?.lost();
    });
    renderer.served = () => {
      const scene = session.scene.value;
      return scene && { hash: scene.volume.hash, structures: scene.structures.length, token: loading.token };
    };
    this.panels = new Panels({
      session,
      connection,
      requests,
      volume,
      voxels: this.voxels,
      token: () => loading.token,
      setUpScope: ({ optics_deg, back_mm }) => void scope.get().then((view) => view?.setUp(optics_deg, back_mm)),
      showPosition: (position) => this.showPosition("place", position),
    });
    this.captures = new CaptureButtons(session, this.pictures, () => this.isRedrawn);
    this.addPanels();
    this.frames = new Frames({
      session,
      connection,
      slicer,
      renderer,
      volume,
      sections,
      scope,
      voxels: this.voxels,
      onFirstSection: () => void this.loadDeferredPanels(),
      onFrame: () => this.captures.capture.value?.drawn(),
    });
    effect(() => {
      if (session.layout.value === "inside" || session.layout.value === "scope") void scope.get();
    });
    // releases the pointer, because browsers may keep a page and its connection alive after navigation
    addEventListener("pagehide", () => connection.end());
    // timers of a hidden page do not run often enough to hold the tip
    document.addEventListener("visibilitychange", () => document.hidden && pointer.releaseByPause());
    addEventListener("pageshow", ({ persisted }) => {
      if (persisted) loading.reload();
    });
  }

  /** Whether all visible pictures are drawn completely, for the current layout. */
  get isRedrawn(): boolean {
    const { volume, sections, scope } = this;
    const views = [volume, ...(scope.value ? [scope.value] : [])];
    return (
      this.pictures.every((picture) => picture.isFitted) &&
      !sections.some(({ isCoarse }) => isCoarse) &&
      views.every((view) => !view.picture.isShown || view.isSharp)
    );
  }

  private connect(): Connection {
    const { session, loading } = this;
    return new Connection(
      {
        onLink: (link) => this.onLink(link),
        onState: (state) => this.onState(state),
        onPose: (pose) => session.setPose(pose),
        onToken: () => void loading.requestToken(),
        onProblem: toast,
        onOtherProtocol: () => void loading.diagnoseDisconnect(versionError(PROTOCOL, null)),
        onUnanswered: () => void loading.diagnoseDisconnect(null),
        onAsked: () => toast(words.askedAtDevice),
        onCut: (first, sweeps) => this.voxels.reportCut(first, sweeps),
        onDeformation: (received) => this.voxels.addDeformation(received),
        onTask: (run) => (session.run.value = run),
        onDebriefing: (debriefing) => (session.debriefing.value = debriefing),
        onPlan: (plan) => session.plans.update(plan),
        onNear: (near) => (session.near.value = near),
        onTracked: (tracked) => (session.tracked.value = tracked),
      },
      loading.token,
    );
  }
  private onLink(link: Link): void {
    if (link !== "connected") return;
    // the server at this address may be another one
    const { session } = this;
    batch(() => {
      session.near.value = [];
      session.run.value = session.debriefing.value = session.tracked.value = null;
      session.plans.update(null);
    });
    this.voxels.reset();
    this.loading.reload();
  }
  private onState(state: State): void {
    const before = this.session.state.value;
    this.session.state.value = state;
    if (state.lesson.over && !before?.lesson.over) toast(words.lessonOver);
    // a quiz begins or ends to hide names and voxels from this viewer
    if (before && before.lesson.redacted !== state.lesson.redacted) this.loading.reload();
  }

  private addPanels(): void {
    const { session, connection, requests, history, permissions, panels, captures } = this;
    const toolbar = new Toolbar(session, connection, requests, history, permissions);
    const device = new DevicePanel(session, requests, permissions);
    history.register(
      "window",
      () => session.window.value,
      (to) => (session.window.value = to),
    );
    new ContactPanel(session);
    showFacts(session);
    showLink(session, connection);
    storeCards();
    byId("theme").addEventListener("click", nextTheme);
    byId("reload").addEventListener("click", () => location.reload());
    new Keys(history, () => device.stop(), {
      ...Object.fromEntries(LAYOUT_KEYS.map((layout, n) => [String(n + 1), () => (session.layout.value = layout)])),
      w: () => toolbar.chooseTool("window"),
      v: () => toolbar.chooseTool("pan"),
      r: () => toolbar.chooseTool("ruler"),
      a: () => toolbar.chooseTool("angle"),
      e: () => toolbar.chooseTool("plan"),
      t: () => toolbar.chooseTool("touch"),
      f: () => toolbar.toggleFollow(),
      s: () => captures.screenshot(),
      o: () => captures.record(),
      d: nextTheme,
      p: () => (session.scene.value?.recording ? panels.timeline.value?.toggle() : device.togglePause()),
      b: ({ repeat }) => repeat || panels.training.value?.beginOrEnd(),
      n: ({ repeat }) => repeat || panels.near.value?.toggleSound(),
      // one stroke per key press, without repeats
      u: ({ repeat, shiftKey }) => repeat || byId(shiftKey ? "redo-stroke" : "undo-stroke").click(),
    });
  }

  /** Loads the scene and connects, before the volumes are loaded, so that the emergency stop is available early. */
  async start(): Promise<void> {
    const { session, slicer, connection, loading, frames } = this;
    frames.begin();
    window.setInterval(() => connection.watch(), 1000);
    await loading.begin({
      session,
      slicer,
      connection,
      prepare: (scene) => this.prepare(scene),
      onVolumes: () => this.volumesChanged(),
    });
  }
  /** Loads texts, and panels: after the first section, except for a quiz, whose panel hides names. */
  private prepare(scene: Scene): Promise<unknown> {
    const isQuiz = (scene.tasks ?? []).some(({ quiz }) => quiz);
    return Promise.all([this.language, this.frames.hasShownSection || isQuiz ? this.panels.fetchFor(scene) : null]);
  }
  /** Discards state of another patient. */
  private volumesChanged(): void {
    this.volume.sceneChanged();
    for (const section of this.sections) section.reset();
    this.voxels.volumesChanged();
    this.measures.forget();
    this.session.plans.forget();
    this.history.clear();
  }
  /** Loads everything that the first section does not need. */
  private async loadDeferredPanels(): Promise<void> {
    // mark up to which the page's size is measured (tests/browser/smoke_test.py)
    performance.mark("first-section");
    this.renderer.begin();
    await Promise.all([this.deferredPanels.get(), Touching.load(), this.panels.fetchFor(this.session.scene.value!)]);
    this.arePanelsLoaded = true;
  }

  /** Requests a rotation of the object, if this viewer has the permission. */
  private turn(rotation: Quaternion): void {
    const now = this.session.pose.value?.rotation;
    const isOther = now && angleOf_deg(multiply(rotation, conjugate(now))) > MIN_TURN_DEG;
    if (isOther && this.connection.allows("hand")) void this.requests.once({ type: "set", rotation_wxyz: rotation });
  }
  /** Moves the planes to a measure. */
  private moveTo({ points, plane, normal }: Measure): void {
    this.showPosition(
      "measure",
      scale(points.reduce(add), 1 / points.length),
      plane === "oblique" ? normal : undefined,
    );
  }
  /** Moves the planes to a position, patient frame, undoably. */
  private showPosition(by: string, position: Vec3, obliqueNormal?: Vec3): void {
    this.history.change(by, () => {
      this.session.showPosition(position, obliqueNormal);
      for (const section of this.sections) section.centre();
    });
  }
}
