import { Bookmarks } from "./bookmarks.js";
import { Connection, type Link } from "./connection.js";
import { complain, Controls } from "./controls.js";
import { Cuts } from "./cuts.js";
import { Displacement, type Nodes } from "./displacement.js";
import { byId, element, press, toast, write } from "./dom.js";
import { download, fileStem } from "./download.js";
import { History } from "./history.js";
import type { Measure } from "./measure.js";
import { Measures } from "./measures_panel.js";
import { Part } from "./part.js";
import type { Picture } from "./picture.js";
import { PlanStore } from "./plan_store.js";
import { PointerDevice } from "./pointer.js";
import type { Concealed } from "./quiz.js";
import { Requests } from "./requests.js";
import { fetchScene, fetchVolumes, NeedsToken, showsTheSame, shrinkFor, type Scene, type State } from "./scene.js";
import { SectionView, type Along, type PlaneKind } from "./section_view.js";
import { LAYOUTS, PAGE_KEY, Session, type KeptPage, type Layout } from "./session.js";
import { showTracked } from "./tracked.js";
import { anySlicer } from "./plain_slicer.js";
import { keep, recall } from "./kept.js";
import { applyLanguage } from "./language.js";
import { applyTheme } from "./theme.js";
import type { Debriefing, TaskRun } from "./training.js";
import { Gone, isMemoryShort, Lasting, versionTrouble } from "./trouble.js";
import { addVolumeControls } from "./volume_controls.js";
import { VolumeView } from "./volume_view.js";
import { VolumeRenderer } from "./volume_renderer.js";
import type { Preset } from "./camera.js";
import { add, angleOf_deg, conjugate, multiply, scale, type Anatomical, type Quaternion, type Vec3 } from "./geometry.js";
import { memory_GB } from "./screen.js";
import { PROTOCOL, type Pose } from "./wire.js";
import { says, words, type Message } from "./words.js";
import { Yields } from "./yields.js";

const TOKEN_KEY = "palpate.token";
/** What is not drawn by the graphics card is drawn less often, so that the page stays awake. */
const SOFTWARE_FRAME_MS = 66;
/** Beside a picture of the volume, sections are drawn in a third of the time: as many times their own pass from one to the next. */
const SECTIONS_REST = 3;
/** Where no graphics card draws, the page waits for its sections: so long for all of them at a time, and less where it waits for a part of the volume's picture, too. */
const SECTIONS_MS = 32, SECTIONS_BESIDE_MS = 16;
/** Graphics that the browser has not given back by then will hardly come. */
const HOPELESS_MS = 5000;
const FIGURES_MS = 100;
/** An object that stands so is not turned. */
const LEAST_TURN_DEG = 0.05;

class Page {
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
  // what few sessions show
  readonly capture = new Part("capture", async () => {
    const { Capture } = await import("./capture.js");
    return new Capture(this.session, this.pictures, byId("pictures"), (error) => {
      complain(error);
      press(byId("record"), false);
    });
  });
  readonly scope = new Part("scope", async () => {
    const { ScopeView } = await import("./scope_view.js");
    const scope = new ScopeView(this.session, this.renderer, this.slicer.isSoftware, this.history);
    this.volume.picture.element.after(scope.picture.element);
    this.pictures.splice(1, 0, scope.picture);
    return scope;
  });
  readonly timeline = new Part("recording", async () => {
    const { Timeline } = await import("./timeline.js");
    return new Timeline(this.session, this.connection, this.requests);
  });
  readonly training = new Part("training", async () => {
    const { Training, Quiz } = await import("./training.js");
    const training = new Training(this.session, this.connection, this.requests, this.volume, (toFind) => this.quiz(toFind, Quiz),
      ({ optics_deg, back_mm }) => void this.scope.get().then((scope) => scope?.standAs(optics_deg, back_mm)));
    if (this.run) training.tell(this.run);
    if (this.debriefing) training.debrief(this.debriefing);
    return training;
  });
  readonly lesson = new Part("lesson", async () => {
    const { Lesson } = await import("./lesson.js");
    return new Lesson(this.connection, this.requests, () => this.token);
  });
  readonly nearPanel = new Part("near", async () => {
    const { NearPanel } = await import("./near_panel.js");
    return new NearPanel(this.session, this.connection);
  });
  readonly planPanel = new Part("plan", async () => {
    const { PlanPanel } = await import("./plan_panel.js");
    return new PlanPanel(this.session, (place) => this.showPlace(place));
  });
  private run: TaskRun | null = null; // as reported last, for a panel that is fetched later
  private debriefing: Debriefing | null = null;
  readonly slicer = anySlicer(() => toast(words.noWebGl));
  readonly renderer = new VolumeRenderer();
  private token = sessionStorage.getItem(TOKEN_KEY);
  private drawnVersion = -1;
  private lookVersion = -1;
  /** Where no graphics card draws. */
  leastFrame_ms = SOFTWARE_FRAME_MS;
  private drawn_ms = -Infinity;
  private figures_ms = -Infinity;
  private loading: Promise<void> | null = null;
  private isOutdated = false; // a server answered while the page was loading: it may be another one
  private askedForHand = false; // on this connection
  private readonly bookmarks: Bookmarks;
  private layoutName: Layout = "two";
  private readonly graphics: Record<"sections" | "volume", "fine" | "lost" | "restorable"> = { sections: "fine", volume: "fine" };
  private failed: "no" | "once" | "again" = "no"; // what draws the volume beside the page
  private displacement: Displacement | null = null;
  private readonly yields = new Yields();
  private areYieldsDue = false; // to be seen
  private isYielding = false; // where the volume is drawn, what came before is not there yet
  private readonly cuts = new Cuts();
  private cutting: Promise<void> = Promise.resolve();
  private hidden = ""; // labels of what a quiz hides
  private concealed: Concealed | null = null;
  private isMending = false;
  private hopeless = 0; // timer
  private isHopeless = false; // it has run out
  private isAskingWhy = false;
  private hasShownSection = false;
  isWhole = false; // its panels have been fetched too

  /** @param language  resolves when the words of the page are there */
  constructor(private readonly language: Promise<void>) {
    this.connection = new Connection({
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
    }, this.token);
    const { session } = this;
    session.movedAt = (place) => this.yields.movedAt(place);
    this.requests = new Requests(this.connection, () => session.state?.armed === true, () => session.state, this.history);
    session.plans = new PlanStore(this.history, (request) => this.requests.once({ type: "plan", ...request }),
      () => this.connection.allows("plan"));
    session.plans.onChange = () => {
      if (session.plans.drawn.length > 0) void this.planPanel.get();
      session.touch();
    };
    byId("plan-card").addEventListener("toggle", () => void this.planPanel.get());
    this.pointer = new PointerDevice(session, this.connection);
    this.volume = new VolumeView(session, this.renderer, this.slicer.isSoftware, this.slicer.mostSide, this.pointer, this.history, (rotation, gesture) =>
      void this.requests.latest("rotation", { type: "set", rotation_wxyz: rotation }, gesture));
    this.history.part("planes", () => session.planes, (to) => (session.planes = to));
    this.history.part("window", () => session.window, (to) => (session.window = to));
    this.sections = (["oblique", "axial", "sagittal", "coronal"] as PlaneKind[]).map(
      (kind) => new SectionView(kind, session, this.slicer, this.measures, this.pointer, this.history));
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
      session, history: this.history, volume: this.volume, sections: this.sections, orient, layout: () => this.layoutName, choose: (name) => this.layout(name),
      turn: (rotation) => this.turn(rotation),
    });
    for (const [which, its] of [["sections", this.slicer], ["volume", this.renderer]] as const) {
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
    // a browser may keep a page that was left, and its connection with it: it lets go of the pointer
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
    // every section is drawn anew, empty
    this.session.touchLooks();
    clearTimeout(this.hopeless);
    this.isHopeless = false;
    this.tellOfGraphics();
    this.hopeless = window.setTimeout(() => {
      this.isHopeless = true;
      this.tellOfGraphics();
    }, HOPELESS_MS);
  }
  /** What came back is filled again: the sections first, for they say where the tip is. */
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
    const isTaken = { sections: this.graphics.sections !== "fine", volume: this.graphics.volume !== "fine" && this.failed === "no" };
    const taken = isTaken.sections ? (isTaken.volume ? words.lostBoth : words.lostSections) : isTaken.volume ? words.lostVolume : null;
    const all = [...(taken === null ? [] : [taken, this.isHopeless ? words.mendLost : words.lostHeals]),
      ...(this.failed === "no" ? [] : [words.failedVolume, this.failed === "once" ? words.failedHeals : words.mendFailed])];
    write(byId("graphics"), all.length === 0 ? "" : [...all, words.lostHarmless].join(" "));
    byId("graphics").hidden = all.length === 0;
  }

  /** Other structures in a box of voxels, i fastest: places in the scene's list + 1. */
  async updateBox(lo: Vec3, size: Vec3, structure: Uint8Array): Promise<void> {
    this.session.volumes!.write(lo, size, structure);
    await this.showBox(lo, size);
  }
  private async showBox(lo: Vec3, size: Vec3): Promise<void> {
    this.volume.voxelsChanged();
    await Promise.all([this.slicer.update(lo, size), this.renderer.update(lo, size)]);
    this.session.touchLooks();
  }
  /** Shows what has been cut away, and what came back, one after the other: what comes meanwhile is in the next. */
  private cut(): void {
    this.cutting = this.cutting.then(async () => {
      const { volumes, scene } = this.session;
      if (!volumes || !scene) return;
      const isCut = [false, ...scene.structures.map(({ tissue }) => {
        const of = scene.tissues[tissue];
        return of !== undefined && of.felt && of.protection !== "keep";
      })];
      const box = this.cuts.takeFrom(volumes, isCut);
      if (box) await this.showBox(box.lo, box.size);
    }).catch(complain);
  }

  /** Names of structures, and what is to be found, are hidden, or come back: null. */
  private quiz(toFind: number[] | null, { conceal, revealed }: typeof import("./quiz.js")): void {
    const { session } = this;
    const hidden = JSON.stringify(toFind);
    if (hidden === this.hidden || !session.volumes || !session.scene) return;
    this.hidden = hidden;
    session.quiz = toFind;
    document.body.classList.toggle("quiz", toFind !== null);
    // one after the other with what a burr takes away
    this.cutting = this.cutting.then(async () => {
      const { volumes, scene } = session;
      if (!volumes || !scene || hidden !== this.hidden) return;
      if (this.concealed) await this.updateBox(this.concealed.lo, this.concealed.size, revealed(volumes, this.concealed));
      this.concealed = toFind && toFind.length > 0 ? conceal(scene, volumes, toFind) : null;
      session.alike = this.concealed;
      session.touchLooks();
      if (this.concealed) await this.updateBox(this.concealed.lo, this.concealed.size, this.concealed.now);
    }).catch(complain);
    session.touchLooks();
  }

  /** Tissue yields as nodes say, of which none is displaced yet; null: it does not. It is seen so; what is felt and read out are the voxels as they are. */
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
  /** What was told of tissue last is seen; what comes meanwhile is in the next. */
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
  /** @param mm  of a box of nodes, three components each, i fastest: how far from there what is seen there is looked up, patient */
  async updateDisplacement(lo: Vec3, size: Vec3, mm: ArrayLike<number>): Promise<void> {
    this.displacement!.write(lo, size, mm);
    this.slicer.updateDisplacement(lo, size);
    await this.renderer.updateDisplacement(lo, size);
    this.session.touchLooks();
  }

  /** Connects as soon as it is known whom to, and loads what is shown meanwhile: a stop waits for no volume. */
  async start(): Promise<void> {
    requestAnimationFrame((now) => this.frame(now));
    window.setInterval(() => this.connection.watch(), 1000);
    await this.load();
  }

  /** On later connections: looks whether what is shown is still the same. @param trouble  that has come up, to be told first */
  private load(trouble: Lasting | null = null): Promise<void> {
    return (this.loading ??= this.loadAll(trouble).finally(() => (this.loading = null)));
  }
  private async loadAll(trouble: Lasting | null): Promise<void> {
    if (trouble) await this.tell(trouble);
    let gone = ""; // what was asked for in vain
    for (let tried = 0; ; tried++) {
      try {
        this.isOutdated = false;
        const scene = await fetchScene(this.token);
        if (this.connection.link === "ended" || this.connection.link === "refused") this.connection.open();
        // names that a quiz hides are not to be seen until its panel is there; nothing else of them is needed for the first section
        const isQuiz = (scene.tasks ?? []).some(({ quiz }) => quiz);
        await Promise.all([this.language, this.hasShownSection || isQuiz ? this.fetchPanels(scene) : null]);
        if (this.session.volumes && showsTheSame(scene, this.session.scene)) this.session.setScene(scene, this.session.volumes);
        else await this.loadVolumes(scene);
        if (this.isOutdated) continue;
        this.controls.showScene(scene);
        this.showPanels(scene);
        break;
      } catch (error) {
        if (error instanceof NeedsToken) await this.tokenFromUser(this.token !== null);
        else if (error instanceof Lasting) await this.tell(error);
        else if (error instanceof Gone && gone === error.message) await this.tell(new Lasting(words.lacksItsVolume(gone), words.startAgain));
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
  /** What the first section did not wait for. */
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
    let shrink = shrinkFor(scene.volume.dims, { mostSide: this.slicer.mostSide, mostTexels: memory <= 2 ? 8e6 : memory <= 4 ? 32e6 : 256e6 });
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
    // of another patient
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

  /** Says what is wrong and how it is mended; resolves when somebody wants it to be tried again. */
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
  /** Of a connection that fails: the scene says whether that will last, and why. @param known  what is known of it already */
  private async whyEnded(known: Lasting | null): Promise<void> {
    // each attempt asks, also while something is being loaded for long
    if (this.isAskingWhy && !known) return;
    this.isAskingWhy = true;
    await this.loading;
    this.isAskingWhy = false;
    const trouble = await fetchScene(this.token).then(() => known, (error) => (error instanceof Lasting ? error : known));
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
      // Escape closes it, and nothing else asks for a token
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
    // what is being loaded may have asked before the token was another one
    await this.loading;
    await this.load();
  }

  private onLink(link: Link): void {
    this.askedForHand = false;
    if (link === "connected") {
      // another server may stand behind the same address
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
    // what a quiz hides was shown, or is hidden again: other names and other voxels
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
    // without a word where another viewer has it: then the tool says so when it is chosen
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
    await capture?.screenshot().then((blob) => download(blob, `${fileStem()}.png`)).catch(complain);
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
    for (const button of document.querySelectorAll<HTMLElement>("[data-layout]")) button.setAttribute("aria-checked", String(button.dataset.layout === name));
    this.session.touch();
  }

  /** Asks for how the object is to stand, as a turn by hand does. */
  private turn(rotation: Quaternion): void {
    const now = this.session.pose?.rotation;
    const isOther = now && angleOf_deg(multiply(rotation, conjugate(now))) > LEAST_TURN_DEG;
    if (isOther && this.connection.allows("hand")) void this.requests.once({ type: "set", rotation_wxyz: rotation });
  }

  /** The planes rest there. */
  private showPlace(place: Vec3): void {
    const { session } = this;
    this.history.change("place", () => {
      session.planes = { follow: false, cross: place, obliqueNormal: session.obliqueNormal };
      for (const section of this.sections) section.offset_mm = 0;
    });
  }

  /** The planes rest where a measure was made. */
  private goTo(measure: Measure): void {
    const { session } = this;
    this.history.change("measure", () => {
      session.planes = {
        follow: false, cross: scale(measure.points.reduce(add), 1 / measure.points.length),
        obliqueNormal: measure.plane === "oblique" ? measure.normal : session.obliqueNormal,
      };
      for (const section of this.sections) section.offset_mm = 0;
    });
  }

  /** The small controls in the pictures' heads. @returns how the section's are set */
  private addHeads(): (along: Along, like: Anatomical) => void {
    const presets: [Preset, string, Message][] = [["anterior", "A", "lookFromAnterior"], ["posterior", "P", "lookFromPosterior"], ["left", "L", "lookFromLeft"],
      ["right", "R", "lookFromRight"], ["superior", "S", "lookFromSuperior"], ["inferior", "I", "lookFromInferior"]];
    const group = says(element("div", { className: "group small", role: "group" }), { label: "lookFrom" });
    for (const [preset, letter, message] of presets) {
      const button = says(element("button", { type: "button", textContent: letter }), { title: message, label: message });
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
      const select = says(element("select", { className: "small" }, ...options.map(([value, message]) => says(new Option("", value), { text: message }))), { label, title: label });
      select.addEventListener("change", () => {
        this.history.change("section", () => {
          set(select.value);
          this.session.obliqueNormal = null;
        });
        this.session.touch();
      });
      return select;
    };
    const along = choose("sectionAlong", [["tool", "alongTool"], ["force", "alongForce"], ["fixed", "fixed"]], (value) => (section.along = value as Along));
    const like = choose("sectionLike", [["sagittal", "likeSagittal"], ["coronal", "likeCoronal"], ["axial", "likeAxial"]], (value) => (section.like = value as Anatomical));
    section.picture.head.append(along, like);
    const orient = (...wanted: [Along, Anatomical]) => {
      [section.along, section.like] = [along.value, like.value] = wanted;
    };
    this.history.part("section", () => [section.along, section.like] as [Along, Anatomical], (to) => {
      orient(...to);
      this.session.touch();
    });
    return orient;
  }

  /** The planes, and what the readout says of them. @param max_ms  that they may hold the page */
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
      // one that takes long leaves the volume's picture, which is drawn beside it, its share
      const isDone = this.slicer.isDone;
      const least = this.renderer.isDrawing ? Math.max(this.leastFrame_ms, SECTIONS_REST * this.slicer.took_ms) : this.leastFrame_ms;
      if (!isDone || now - this.drawn_ms < least) {
        // what draws the volume beside the page waits for none of this
        this.volume.ask(now);
        this.scope.now?.ask(now);
        return;
      }
      this.drawn_ms = now;
    }
    // the volume's sharp picture comes after a while without any change; a picture that comes has the tool drawn over it
    this.volume.draw(now, this.slicer.isSoftware ? this.leastFrame_ms / 2 : 0);
    this.scope.now?.draw(now);
    const areSectionsDue = this.drawnVersion !== session.version || this.sections.some(({ isCoarse }) => isCoarse);
    // the page would wait until the volume's shader is compiled
    if (areSectionsDue && session.volumes && !this.renderer.isCompiling) {
      this.drawnVersion = session.version;
      this.drawSections(!this.slicer.isSoftware ? Infinity : this.renderer.isDrawing ? SECTIONS_BESIDE_MS : SECTIONS_MS);
      if (!this.hasShownSection) {
        this.hasShownSection = true;
        // up to here counts what the page weighs (tests/browser/smoke_test.py)
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

applyTheme();
const language = applyLanguage();
write(byId("cover-text"), words.loading);
try {
  const page = new Page(language);
  // nobody else's browser needs it
  if (navigator.webdriver) void import("./test_hook.js").then(({ openToTests }) => openToTests(page));
  void page.start();
} catch (error) {
  write(byId("cover-text"), (error as Error).message);
}
export type { Page };
