// Page: owns the session and the panels, loads the scene and schedules frames.

import { toast } from "./base/announce.js";
import type { Scene, State, Debriefing, TaskRun } from "./protocol/messages.js";
import { Bookmarks } from "./panels/bookmarks.js";
import { Connection, type Link } from "./protocol/connection.js";
import { complain, Controls } from "./panels/controls.js";
import { Cuts } from "./state/cuts.js";
import { Displacement } from "./drawing/displacement.js";
import { byId, element, press, write } from "./base/dom.js";
import { download, fileStem } from "./base/download.js";
import { History } from "./state/history.js";
import type { Measure } from "./drawing/measure.js";
import { Measures } from "./section/measures_panel.js";
import { Part } from "./words/part.js";
import type { Picture } from "./drawing/picture.js";
import { PlanStore } from "./state/plan_store.js";
import { PointerDevice } from "./state/pointer.js";
import type { Concealed } from "./training/quiz.js";
import { Requests } from "./state/requests.js";
import { fetchScene, fetchVolumes, NeedsToken, showsTheSame, shrinkFor } from "./protocol/scene.js";
import { SectionView, type Along } from "./section/section_view.js";
import { LAYOUTS, PAGE_KEY, Session, type KeptPage, type Layout } from "./state/session.js";
import { showTracked } from "./panels/tracked.js";
import { anySlicer } from "./section/plain_slicer.js";
import { keep, recall } from "./state/kept.js";
import { Gone, isMemoryShort, Lasting, versionTrouble } from "./words/trouble.js";
import { addVolumeControls } from "./panels/volume_controls.js";
import { VolumeView } from "./volume/volume_view.js";
import { VolumeRenderer } from "./volume/volume_renderer.js";
import type { Preset } from "./volume/camera.js";
import {
  add,
  angleOf_deg,
  conjugate,
  multiply,
  scale,
  type Anatomical,
  type Quaternion,
  type Vec3,
  type PlaneKind,
} from "./base/geometry.js";
import { memory_GB } from "./base/screen.js";
import { PROTOCOL, type Pose } from "./protocol/wire.js";
import { says, words, type Message } from "./words/words.js";
import { Yields, type Nodes } from "./protocol/yields.js";

const TOKEN_KEY = "palpate.token";
/** Minimum frame interval without a graphics card, which keeps the page responsive. */
const SOFTWARE_FRAME_MS = 66;
/**
 * Minimum interval between drawings of the sections, as a multiple of their duration, while the volume is rendered on
 * the same CPU: sections get a third of the time.
 */
const SECTIONS_REST = 3;
/**
 * Maximum time for which all sections together may block the page without a graphics card, and while the volume is
 * rendered, too.
 */
const SECTIONS_MS = 32,
  SECTIONS_BESIDE_MS = 16;
/** Time after which a lost WebGL context that the browser has not restored is reported as permanent. */
const HOPELESS_MS = 5000;
const FIGURES_MS = 100;
/** Angle below which a rotation is ignored. */
const LEAST_TURN_DEG = 0.05;

export class Page {
  readonly session = new Session();
  readonly connection: Connection;
  readonly history = new History();
  readonly measures = new Measures(this.session, this.history, (measure) => this.goTo(measure));
  readonly sections: SectionView[];
  readonly volume: VolumeView;
  readonly controls: Controls;
  readonly pointer: PointerDevice;
  readonly requests: Requests;
  private readonly pictures: Picture[];
  // imported on first use
  readonly capture = new Part("capture", async () => {
    const { Capture } = await import("./panels/capture.js");
    return new Capture(this.session, this.pictures, byId("pictures"), (error) => {
      complain(error);
      press(byId("record"), false);
    });
  });
  readonly scope = new Part("scope", async () => {
    const { ScopeView } = await import("./volume/scope_view.js");
    const scope = new ScopeView(this.session, this.renderer, this.slicer.isSoftware, this.history);
    this.volume.picture.element.after(scope.picture.element);
    this.pictures.splice(1, 0, scope.picture);
    return scope;
  });
  readonly timeline = new Part("recording", async () => {
    const { Timeline } = await import("./panels/timeline.js");
    return new Timeline(this.session, this.connection, this.requests);
  });
  readonly training = new Part("training", async () => {
    const { Training, Quiz } = await import("./training/training.js");
    const training = new Training(
      this.session,
      this.connection,
      this.requests,
      this.volume,
      (toFind) => this.quiz(toFind, Quiz),
      ({ optics_deg, back_mm }) => void this.scope.get().then((scope) => scope?.standAs(optics_deg, back_mm)),
    );
    if (this.run) training.tell(this.run);
    if (this.debriefing) training.debrief(this.debriefing);
    return training;
  });
  readonly lesson = new Part("lesson", async () => {
    const { Lesson } = await import("./training/lesson.js");
    return new Lesson(this.connection, this.requests, () => this.token);
  });
  readonly nearPanel = new Part("near", async () => {
    const { NearPanel } = await import("./panels/near_panel.js");
    return new NearPanel(this.session, this.connection);
  });
  readonly planPanel = new Part("plan", async () => {
    const { PlanPanel } = await import("./panels/plan_panel.js");
    return new PlanPanel(this.session, (place) => this.showPlace(place));
  });
  private run: TaskRun | null = null; // latest report, for a panel that is not loaded yet
  private debriefing: Debriefing | null = null;
  readonly slicer = anySlicer(() => toast(words.noWebGl));
  readonly renderer = new VolumeRenderer();
  private token = sessionStorage.getItem(TOKEN_KEY);
  private drawnVersion = -1;
  private lookVersion = -1;
  /** Minimum frame interval without a graphics card. */
  leastFrame_ms = SOFTWARE_FRAME_MS;
  private drawn_ms = -Infinity;
  private figures_ms = -Infinity;
  private loading: Promise<void> | null = null;
  private isOutdated = false; // reconnected since loading began: the scene may be another one
  private askedForHand = false; // the pointer was requested in this connection
  private readonly bookmarks: Bookmarks;
  private layoutName: Layout = "two";
  private readonly graphics: Record<"sections" | "volume", "fine" | "lost" | "restorable"> = {
    sections: "fine",
    volume: "fine",
  };
  private failed: "no" | "once" | "again" = "no"; // failures of the volume's worker
  private displacement: Displacement | null = null;
  private readonly yields = new Yields();
  private areYieldsDue = false; // deformation has changed since it was last displayed
  private isYielding = false; // the volume's renderer is receiving a deformation
  private readonly cuts = new Cuts();
  private cutting: Promise<void> = Promise.resolve();
  private hidden = ""; // key of the labels that a quiz hides
  private concealed: Concealed | null = null;
  private isMending = false;
  private hopeless = 0; // timer of HOPELESS_MS
  private isHopeless = false; // the timer has expired: lost graphics are reported as permanent
  private isAskingWhy = false;
  private hasShownSection = false;
  isWhole = false; // all dynamically imported panels are loaded

  /** @param language  resolves when the page's texts are loaded */
  constructor(private readonly language: Promise<void>) {
    this.connection = new Connection(
      {
        onLink: (link) => this.onLink(link),
        onState: (state) => this.onState(state),
        onPose: (pose) => this.onPose(pose),
        onToken: () => this.askForToken(),
        onProblem: toast,
        onOtherProtocol: () => void this.whyEnded(versionTrouble(PROTOCOL, null)),
        onUnanswered: () => void this.whyEnded(null),
        onAsked: () => toast(words.askedAtDevice),
        onCut: (first, sweeps) => {
          this.cuts.tell(first, sweeps);
          this.cut();
        },
        onTask: (run) => {
          this.run = run;
          this.training.now?.tell(run);
        },
        onPlan: (plan) => this.session.plans.tell(plan),
        onNear: (near) => (this.session.near = near),
        onTracked: showTracked,
        onDebriefing: (debriefing) => {
          this.debriefing = debriefing;
          this.training.now?.debrief(debriefing);
        },
        onYield: (told) => {
          this.yields.tell(told);
          this.areYieldsDue = true;
        },
      },
      this.token,
    );
    const { session } = this;
    session.movedAt = (place) => this.yields.movedAt(place);
    this.requests = new Requests(
      this.connection,
      () => session.state?.armed === true,
      () => session.state,
      this.history,
    );
    session.plans = new PlanStore(
      this.history,
      (request) => this.requests.once({ type: "plan", ...request }),
      () => this.connection.allows("plan"),
    );
    session.plans.onChange = () => {
      if (session.plans.drawn.length > 0) void this.planPanel.get();
      session.touch();
    };
    byId("plan-card").addEventListener("toggle", () => void this.planPanel.get());
    this.pointer = new PointerDevice(session, this.connection);
    this.volume = new VolumeView(
      session,
      this.renderer,
      this.slicer.isSoftware,
      this.slicer.mostSide,
      this.pointer,
      this.history,
      (rotation, gesture) => void this.requests.latest("rotation", { type: "set", rotation_wxyz: rotation }, gesture),
    );
    this.history.part(
      "planes",
      () => session.planes,
      (to) => (session.planes = to),
    );
    this.history.part(
      "window",
      () => session.window,
      (to) => (session.window = to),
    );
    this.sections = (["oblique", "axial", "sagittal", "coronal"] as PlaneKind[]).map(
      (kind) => new SectionView(kind, session, this.slicer, this.measures, this.pointer, this.history),
    );
    this.pictures = [this.volume.picture, ...this.sections.map((section) => section.picture)];
    byId("pictures").append(...this.pictures.map((picture) => picture.element));
    this.controls = new Controls(session, this.connection, this.requests, this.history, {
      layout: (name) => this.layout(name),
      screenshot: () => void this.screenshot(),
      record: () => void this.record(),
      togglePlaying: () => this.timeline.now?.toggle(),
      beginOrEnd: () => this.training.now?.beginOrEnd(),
      toggleSound: () => this.nearPanel.now?.toggleSound(),
    });
    const orient = this.addHeads();
    const { layout } = recall<KeptPage>(PAGE_KEY);
    this.layout(layout && LAYOUTS.includes(layout) ? layout : "two");
    this.bookmarks = new Bookmarks({
      session,
      history: this.history,
      volume: this.volume,
      sections: this.sections,
      orient,
      layout: () => this.layoutName,
      choose: (name) => this.layout(name),
      turn: (rotation) => this.turn(rotation),
    });
    for (const [which, its] of [
      ["sections", this.slicer],
      ["volume", this.renderer],
    ] as const) {
      its.onLost = () => this.graphicsLost(which);
      its.onRestorable = () => {
        this.graphics[which] = "restorable";
        void this.mend();
      };
    }
    this.renderer.served = () => {
      const { scene } = this.session;
      return scene && { hash: scene.volume.hash, structures: scene.structures.length, token: this.token };
    };
    this.renderer.onFailed = (isReplaced) => this.workerFailed(isReplaced);
    // releases the pointer, because browsers may keep a page and its connection alive after navigation
    addEventListener("pagehide", () => this.connection.end());
    addEventListener("pageshow", ({ persisted }) => {
      if (persisted) void this.load();
    });
  }

  private workerFailed(isReplaced: boolean): void {
    this.failed = isReplaced ? "once" : "again";
    this.graphics.volume = isReplaced ? "restorable" : "lost";
    for (const view of [this.volume, this.scope.now]) view?.lost();
    this.session.touch();
    this.tellOfGraphics();
    void this.mend();
  }
  private graphicsLost(which: "sections" | "volume"): void {
    this.graphics[which] = "lost";
    if (which === "volume") for (const view of [this.volume, this.scope.now]) view?.lost();
    // redraws the sections, which are empty without a context
    this.session.touchLooks();
    clearTimeout(this.hopeless);
    this.isHopeless = false;
    this.tellOfGraphics();
    this.hopeless = window.setTimeout(() => {
      this.isHopeless = true;
      this.tellOfGraphics();
    }, HOPELESS_MS);
  }
  /** Uploads everything to restored contexts; sections first, because they show the tip's position. */
  private async mend(): Promise<void> {
    if (this.isMending) return;
    this.isMending = true;
    const { graphics } = this;
    try {
      await this.mendAll();
    } catch (error) {
      complain(error);
    }
    this.isMending = false;
    if (graphics.sections === "fine" && graphics.volume === "fine") {
      clearTimeout(this.hopeless);
      this.isHopeless = false;
    }
    this.tellOfGraphics();
  }
  private async mendAll(): Promise<void> {
    const { graphics } = this;
    for (;;) {
      if (graphics.sections === "restorable") {
        await this.slicer.restore(this.session.volumes);
        if (graphics.sections === "restorable") graphics.sections = "fine";
        this.session.touchLooks();
      } else if (graphics.sections === "fine" && graphics.volume === "restorable") {
        if ((await this.renderer.restore()) && graphics.volume === "restorable") {
          graphics.volume = "fine";
          if (this.failed === "once") this.failed = "no";
        }
      } else return;
    }
  }
  private tellOfGraphics(): void {
    const isTaken = {
      sections: this.graphics.sections !== "fine",
      volume: this.graphics.volume !== "fine" && this.failed === "no",
    };
    const taken = isTaken.sections
      ? isTaken.volume
        ? words.lostBoth
        : words.lostSections
      : isTaken.volume
        ? words.lostVolume
        : null;
    const all = [
      ...(taken === null ? [] : [taken, this.isHopeless ? words.mendLost : words.lostHeals]),
      ...(this.failed === "no"
        ? []
        : [words.failedVolume, this.failed === "once" ? words.failedHeals : words.mendFailed]),
    ];
    write(byId("graphics"), all.length === 0 ? "" : [...all, words.lostHarmless].join(" "));
    byId("graphics").hidden = all.length === 0;
  }

  /** Replaces the structures in a box of voxels, i fastest: index in the scene's list + 1, or 0. */
  async updateBox(lo: Vec3, size: Vec3, structure: Uint8Array): Promise<void> {
    this.session.volumes!.write(lo, size, structure);
    await this.showBox(lo, size);
  }
  private async showBox(lo: Vec3, size: Vec3): Promise<void> {
    this.volume.voxelsChanged();
    await Promise.all([this.slicer.update(lo, size), this.renderer.update(lo, size)]);
    this.session.touchLooks();
  }
  /** Applies burr cuts and their undo, one update at a time; those that arrive meanwhile are part of the next one. */
  private cut(): void {
    this.cutting = this.cutting
      .then(async () => {
        const { volumes, scene } = this.session;
        if (!volumes || !scene) return;
        const isCut = [
          false,
          ...scene.structures.map(({ tissue }) => {
            const of = scene.tissues[tissue];
            return of !== undefined && of.felt && of.protection !== "keep";
          }),
        ];
        const box = this.cuts.takeFrom(volumes, isCut);
        if (box) await this.showBox(box.lo, box.size);
      })
      .catch(complain);
  }

  /** Hides the names of structures, and the voxels of labels to be found in a quiz; null: restores both. */
  private quiz(toFind: number[] | null, { conceal, revealed }: typeof import("./training/quiz.js")): void {
    const { session } = this;
    const hidden = JSON.stringify(toFind);
    if (hidden === this.hidden || !session.volumes || !session.scene) return;
    this.hidden = hidden;
    session.quiz = toFind;
    document.body.classList.toggle("quiz", toFind !== null);
    // serialised with updates by burr cuts
    this.cutting = this.cutting
      .then(async () => {
        const { volumes, scene } = session;
        if (!volumes || !scene || hidden !== this.hidden) return;
        if (this.concealed)
          await this.updateBox(this.concealed.lo, this.concealed.size, revealed(volumes, this.concealed));
        this.concealed = toFind && toFind.length > 0 ? conceal(scene, volumes, toFind) : null;
        session.alike = this.concealed;
        session.touchLooks();
        if (this.concealed) await this.updateBox(this.concealed.lo, this.concealed.size, this.concealed.now);
      })
      .catch(complain);
    session.touchLooks();
  }

  /**
   * Displays a deformation, initially zero, on a grid of nodes; null: none. It affects pictures only; contact and
   * readouts use undeformed voxels.
   */
  displace(nodes: Nodes | null): void {
    void this.displaceBy(nodes && new Displacement(nodes));
  }
  private async displaceBy(displacement: Displacement | null): Promise<void> {
    this.displacement = displacement;
    this.session.yields = displacement !== null;
    this.slicer.displace(displacement);
    const isThere = this.renderer.displace(displacement);
    this.session.touchLooks();
    await isThere;
  }
  /** Displays the latest deformation; reports that arrive meanwhile are part of the next update. */
  private async showYields(): Promise<void> {
    const { volumes } = this.session;
    if (!volumes) return;
    this.areYieldsDue = false;
    const by = this.yields.displaced((p) => volumes.structureAt(p) === null);
    if (!by && !this.displacement) return;
    this.isYielding = true;
    await this.displaceBy(by && new Displacement(by.nodes, by.mm));
    this.isYielding = false;
  }
  /**
   * Replaces displacements of a box of nodes.
   * @param mm  from displayed positions to positions at rest, patient frame; three components per node, i fastest
   */
  async updateDisplacement(lo: Vec3, size: Vec3, mm: ArrayLike<number>): Promise<void> {
    this.displacement!.write(lo, size, mm);
    this.slicer.updateDisplacement(lo, size);
    await this.renderer.updateDisplacement(lo, size);
    this.session.touchLooks();
  }

  /**
   * Loads the scene and connects, before the volumes are loaded, so that the emergency stop is available early.
   */
  async start(): Promise<void> {
    requestAnimationFrame((now) => this.frame(now));
    window.setInterval(() => this.connection.watch(), 1000);
    await this.load();
  }

  /**
   * Loads the scene, and its volumes unless they are loaded already; one load at a time.
   * @param trouble  problem to report first
   */
  private load(trouble: Lasting | null = null): Promise<void> {
    return (this.loading ??= this.loadAll(trouble).finally(() => (this.loading = null)));
  }
  private async loadAll(trouble: Lasting | null): Promise<void> {
    if (trouble) await this.tell(trouble);
    let gone = ""; // hash of a volume that was missing at the previous attempt
    for (let tried = 0; ; tried++) {
      try {
        this.isOutdated = false;
        const scene = await fetchScene(this.token);
        if (this.connection.link === "ended" || this.connection.link === "refused") this.connection.open();
        // panels are loaded after the first section, except for a quiz, whose panel hides names
        const isQuiz = (scene.tasks ?? []).some(({ quiz }) => quiz);
        await Promise.all([this.language, this.hasShownSection || isQuiz ? this.fetchPanels(scene) : null]);
        if (this.session.volumes && showsTheSame(scene, this.session.scene))
          this.session.setScene(scene, this.session.volumes);
        else await this.loadVolumes(scene);
        if (this.isOutdated) continue;
        this.controls.showScene(scene);
        this.showPanels(scene);
        break;
      } catch (error) {
        if (error instanceof NeedsToken) await this.tokenFromUser(this.token !== null);
        else if (error instanceof Lasting) await this.tell(error);
        else if (error instanceof Gone && gone === error.message)
          await this.tell(new Lasting(words.lacksItsVolume(gone), words.startAgain));
        else {
          if (error instanceof Gone) gone = error.message;
          write(byId("cover-text"), words.failedAgain((error as Error).message));
          await new Promise((later) => setTimeout(later, Math.min(500 * 2 ** tried, 5000)));
        }
      }
    }
    byId("cover").hidden = true;
  }

  private async fetchPanels({ tasks, recording, distances, no_go, may, role }: Scene): Promise<void> {
    const wanted = [
      ...(tasks && tasks.length > 0 ? [this.training] : []),
      ...(may.includes("lesson") || role === "learner" || role === "teacher" ? [this.lesson] : []),
      ...(recording ? [this.timeline] : []),
      ...(distances || no_go.length > 0 ? [this.nearPanel] : []),
    ];
    await Promise.all(wanted.map((part) => part.get()));
  }
  private showPanels(scene: Scene): void {
    this.nearPanel.now?.show(scene);
    this.timeline.now?.show(scene.recording);
    this.training.now?.show(scene);
    this.lesson.now?.show(scene);
    if (this.session.state) this.onState(this.session.state);
  }
  /** Loads everything that the first section does not need. */
  private async fetchTheRest(): Promise<void> {
    this.renderer.begin();
    await this.fetchPanels(this.session.scene!);
    this.showPanels(this.session.scene!);
    this.isWhole = true;
  }

  private async loadVolumes(scene: Scene): Promise<void> {
    byId("cover").hidden = false;
    write(byId("cover-text"), words.loading);
    this.loaded(0);
    const memory = memory_GB();
    let shrink = shrinkFor(scene.volume.dims, {
      mostSide: this.slicer.mostSide,
      mostTexels: memory <= 2 ? 8e6 : memory <= 4 ? 32e6 : 256e6,
    });
    for (;;) {
      try {
        const volumes = await fetchVolumes(scene, shrink, this.token, (share) => this.loaded(share));
        await this.slicer.load(volumes);
        this.session.setScene(scene, volumes);
        break;
      } catch (error) {
        if (!isMemoryShort(error) || this.slicer.isLost) throw error;
        if (shrink === 4) throw new Lasting(words.noMemory, words.mendMemory);
        shrink = shrink === 1 ? 2 : 4;
      }
    }
    if (shrink > 1) toast(words.shrunk(`1/${shrink}`));
    this.volume.sceneChanged();
    for (const section of this.sections) section.reset();
    // discards state of another patient
    this.concealed = null;
    this.hidden = "";
    this.displace(null);
    this.areYieldsDue = true;
    this.measures.forget();
    this.session.plans.forget();
    this.history.clear();
    this.bookmarks.load();
    this.cut();
  }

  private loaded(share: number): void {
    const bar = byId<HTMLProgressElement>("cover-share");
    bar.value = share;
    bar.hidden = share >= 1;
  }

  /** Shows a problem and its remedy; resolves when the user requests a retry. */
  private tell(trouble: Lasting): Promise<void> {
    byId("cover").hidden = false;
    byId("cover-share").hidden = true;
    write(byId("cover-text"), `${trouble.message} ${trouble.how}`);
    byId("mend").hidden = false;
    return new Promise((again) => {
      byId("again").onclick = () => {
        byId("mend").hidden = true;
        write(byId("cover-text"), words.again);
        again();
      };
    });
  }
  /**
   * Handles a failed connection: a request for the scene shows whether and why the failure is permanent.
   * @param known  permanent problem, if already known
   */
  private async whyEnded(known: Lasting | null): Promise<void> {
    // a pending check covers all failed attempts
    if (this.isAskingWhy && !known) return;
    this.isAskingWhy = true;
    await this.loading;
    this.isAskingWhy = false;
    const trouble = await fetchScene(this.token).then(
      () => known,
      (error) => (error instanceof Lasting ? error : known),
    );
    if (!trouble || this.loading || this.connection.link === "connected") return;
    this.connection.end();
    await this.load(trouble);
  }

  private tokenFromUser(wasWrong: boolean): Promise<void> {
    const dialog = byId<HTMLDialogElement>("token-dialog");
    const input = byId<HTMLInputElement>("token");
    byId("token-problem").hidden = !wasWrong;
    byId("cover").hidden = true;
    input.value = "";
    if (!dialog.open) dialog.showModal();
    return new Promise((done) => {
      let isGiven = false;
      // Escape closes the dialog; it has to stay open until a token is entered
      dialog.onclose = () => {
        if (!isGiven && !dialog.open) dialog.showModal();
      };
      byId<HTMLFormElement>("token-form").onsubmit = () => {
        isGiven = true;
        this.token = input.value.trim();
        sessionStorage.setItem(TOKEN_KEY, this.token);
        this.connection.setToken(this.token);
        input.value = "";
        done();
      };
    });
  }
  private async askForToken(): Promise<void> {
    // a download may be asking for the token already
    await this.loading;
    await this.load();
  }

  private onLink(link: Link): void {
    this.askedForHand = false;
    if (link === "connected") {
      // the server at this address may be another one
      this.isOutdated = true;
      this.cuts.beginAnew();
      this.yields.forget();
      this.session.near = [];
      this.session.plans.tell(null);
      showTracked(null);
      this.planPanel.now?.beginAnew();
      this.areYieldsDue = true;
      this.run = this.debriefing = null;
      this.training.now?.beginAnew();
      this.cut();
      void this.load();
    }
    this.controls.allow();
    this.timeline.now?.allow();
    this.training.now?.allow();
    this.lesson.now?.allow();
    this.nearPanel.now?.sound();
    this.session.touch();
  }
  private onState(state: State): void {
    // a quiz begins or ends to hide names and voxels from this viewer
    const isOtherFace = this.session.state !== null && this.session.state.lesson.veiled !== state.lesson.veiled;
    this.session.state = state;
    if (isOtherFace) {
      this.isOutdated = true;
      void this.load();
    }
    this.nearPanel.now?.sound();
    this.controls.showState(state);
    this.timeline.now?.showState(state);
    this.training.now?.showLesson(state.lesson);
    this.lesson.now?.showState(state);
    // a refusal is not reported, unlike that of choosing the tool
    if (!this.askedForHand && this.session.tool === "touch") {
      this.askedForHand = true;
      void this.connection.ask({ type: "pointer", take: true });
    }
    this.session.touch();
  }
  private onPose(pose: Pose): void {
    this.session.setPose(pose);
    this.nearPanel.now?.sound();
    this.planPanel.now?.addPose(pose.devices[0]!);
    this.controls.addPose(pose);
    this.timeline.now?.addPose(pose);
    this.capture.now?.addPose(pose);
  }

  private async screenshot(): Promise<void> {
    const capture = await this.capture.get();
    await capture
      ?.screenshot()
      .then((blob) => download(blob, `${fileStem()}.png`))
      .catch(complain);
  }
  private async record(): Promise<void> {
    const capture = await this.capture.get();
    if (!capture) return;
    try {
      if (capture.isRecording) capture.stop();
      else capture.start();
    } catch (error) {
      complain(error);
    }
    press(byId("record"), capture.isRecording);
  }

  private layout(name: Layout): void {
    this.layoutName = name;
    if (name === "inside" || name === "scope") void this.scope.get();
    keep<KeptPage>(PAGE_KEY, { layout: name });
    byId("pictures").className = `pictures layout-${name}`;
    for (const button of document.querySelectorAll<HTMLElement>("[data-layout]"))
      button.setAttribute("aria-checked", String(button.dataset.layout === name));
    this.session.touch();
  }

  /** Requests a rotation of the object, if this viewer may. */
  private turn(rotation: Quaternion): void {
    const now = this.session.pose?.rotation;
    const isOther = now && angleOf_deg(multiply(rotation, conjugate(now))) > LEAST_TURN_DEG;
    if (isOther && this.connection.allows("hand")) void this.requests.once({ type: "set", rotation_wxyz: rotation });
  }

  /** Moves the planes to a position, patient frame, where they stop following the tip. */
  private showPlace(place: Vec3): void {
    const { session } = this;
    this.history.change("place", () => {
      session.planes = { follow: false, cross: place, obliqueNormal: session.obliqueNormal };
      for (const section of this.sections) section.offset_mm = 0;
    });
  }

  /** Moves the planes to a measure, where they stop following the tip. */
  private goTo(measure: Measure): void {
    const { session } = this;
    this.history.change("measure", () => {
      session.planes = {
        follow: false,
        cross: scale(measure.points.reduce(add), 1 / measure.points.length),
        obliqueNormal: measure.plane === "oblique" ? measure.normal : session.obliqueNormal,
      };
      for (const section of this.sections) section.offset_mm = 0;
    });
  }

  /**
   * Creates the controls in the pictures' heads.
   * @returns setter of the oblique section's options
   */
  private addHeads(): (along: Along, like: Anatomical) => void {
    const presets: [Preset, string, Message][] = [
      ["anterior", "A", "lookFromAnterior"],
      ["posterior", "P", "lookFromPosterior"],
      ["left", "L", "lookFromLeft"],
      ["right", "R", "lookFromRight"],
      ["superior", "S", "lookFromSuperior"],
      ["inferior", "I", "lookFromInferior"],
    ];
    const group = says(element("div", { className: "group small", role: "group" }), { label: "lookFrom" });
    for (const [preset, letter, message] of presets) {
      const button = says(element("button", { type: "button", textContent: letter }), {
        title: message,
        label: message,
      });
      button.dataset.look = preset;
      button.addEventListener("click", () => this.volume.look(preset));
      group.append(button);
    }
    const turn = says(element("button", { type: "button", className: "small" }), { text: "turn", title: "turnTitle" });
    press(turn, false);
    turn.id = "turn";
    turn.addEventListener("click", () => {
      this.volume.turnsObject = !this.volume.turnsObject;
      press(turn, this.volume.turnsObject);
    });
    this.volume.picture.head.append(group, turn);
    addVolumeControls(this.volume, this.session, this.history, this.sections);

    const section = this.sections[0]!;
    const choose = (label: Message, options: [string, Message][], set: (value: string) => void) => {
      const select = says(
        element(
          "select",
          { className: "small" },
          ...options.map(([value, message]) => says(new Option("", value), { text: message })),
        ),
        { label, title: label },
      );
      select.addEventListener("change", () => {
        this.history.change("section", () => {
          set(select.value);
          this.session.obliqueNormal = null;
        });
        this.session.touch();
      });
      return select;
    };
    const along = choose(
      "sectionAlong",
      [
        ["tool", "alongTool"],
        ["force", "alongForce"],
        ["fixed", "fixed"],
      ],
      (value) => (section.along = value as Along),
    );
    const like = choose(
      "sectionLike",
      [
        ["sagittal", "likeSagittal"],
        ["coronal", "likeCoronal"],
        ["axial", "likeAxial"],
      ],
      (value) => (section.like = value as Anatomical),
    );
    section.picture.head.append(along, like);
    const orient = (...wanted: [Along, Anatomical]) => {
      [section.along, section.like] = [along.value, like.value] = wanted;
    };
    this.history.part(
      "section",
      () => [section.along, section.like] as [Along, Anatomical],
      (to) => {
        orient(...to);
        this.session.touch();
      },
    );
    return orient;
  }

  /**
   * Draws the sections and updates the readout.
   * @param max_ms  maximum time to block the page
   */
  drawSections(max_ms: number): void {
    const { session } = this;
    if (this.lookVersion !== session.lookVersion && session.volumes) {
      this.lookVersion = session.lookVersion;
      this.slicer.setColours(session.palette());
    }
    const shown = this.sections.filter(({ picture }) => picture.isShown).length;
    for (const section of this.sections) section.draw(performance.now(), max_ms / shown);
    this.slicer.mark();
    this.controls.showReadout();
  }

  private frame(now: number): void {
    requestAnimationFrame((later) => this.frame(later));
    const { session, connection } = this;
    const wasFresh = session.isFresh;
    session.isFresh = connection.isFresh();
    session.age_ms = connection.age_ms();
    if (this.areYieldsDue && !this.isYielding) void this.showYields();
    if (wasFresh !== session.isFresh || !session.isFresh) session.touch();
    if (this.slicer.isSoftware) {
      // sections leave time for the volume's picture, which is rendered concurrently
      const isDone = this.slicer.isDone;
      const least = this.renderer.isDrawing
        ? Math.max(this.leastFrame_ms, SECTIONS_REST * this.slicer.took_ms)
        : this.leastFrame_ms;
      if (!isDone || now - this.drawn_ms < least) {
        // requests to the volume's renderer do not depend on the sections
        this.volume.ask(now);
        this.scope.now?.ask(now);
        return;
      }
      this.drawn_ms = now;
    }
    // every frame, because a sharp picture of the volume follows a pause, and the tool is drawn over each new picture
    this.volume.draw(now, this.slicer.isSoftware ? this.leastFrame_ms / 2 : 0);
    this.scope.now?.draw(now);
    const areSectionsDue = this.drawnVersion !== session.version || this.sections.some(({ isCoarse }) => isCoarse);
    // drawing would block while the volume's shader is compiled
    if (areSectionsDue && session.volumes && !this.renderer.isCompiling) {
      this.drawnVersion = session.version;
      this.drawSections(
        !this.slicer.isSoftware ? Infinity : this.renderer.isDrawing ? SECTIONS_BESIDE_MS : SECTIONS_MS,
      );
      if (!this.hasShownSection) {
        this.hasShownSection = true;
        // mark up to which the page's size is measured (tests/browser/smoke_test.py)
        performance.mark("first-section");
        void this.fetchTheRest();
      }
    }
    this.capture.now?.drawn();
    if (now - this.figures_ms > FIGURES_MS) {
      this.figures_ms = now;
      this.controls.draw();
      this.nearPanel.now?.draw(now);
      this.planPanel.now?.draw();
      this.timeline.now?.draw();
      this.training.now?.draw();
      const capture = this.capture.now;
      write(byId("record"), capture?.isRecording ? words.recording(`${capture.seconds().toFixed(0)} s`) : words.record);
    }
  }
}
