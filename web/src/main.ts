import "./theme.css";
import { Capture, download, fileStem } from "./capture.js";
import { Connection, type Link } from "./connection.js";
import { complain, Controls } from "./controls.js";
import { byId, element, press, toast, write } from "./dom.js";
import type { Measure } from "./measure.js";
import type { Picture } from "./picture.js";
import { PointerDevice } from "./pointer.js";
import { Requests } from "./requests.js";
import { fetchScene, fetchVolumes, NeedsToken, shrinkFor, type Scene, type State } from "./scene.js";
import { SectionView, type Along, type PlaneKind } from "./section_view.js";
import { Session } from "./session.js";
import { Slicer } from "./slicer.js";
import { applyTheme } from "./theme.js";
import { openToTests } from "./test_hook.js";
import { VolumeView } from "./volume_view.js";
import { VolumeRenderer } from "./volume_renderer.js";
import type { Preset } from "./camera.js";
import type { Anatomical } from "./geometry.js";
import type { Pose } from "./wire.js";

const TOKEN_KEY = "palpate.token";
/** What is not drawn by the graphics card is drawn less often, so that the page stays awake. */
const SOFTWARE_FRAME_MS = 66;
const FIGURES_MS = 100;

class Page {
  readonly session = new Session();
  readonly connection: Connection;
  readonly measures: Measure[] = [];
  readonly sections: SectionView[];
  readonly volume: VolumeView;
  readonly capture: Capture;
  readonly controls: Controls;
  readonly pointer: PointerDevice;
  readonly requests: Requests;
  private readonly slicer = new Slicer();
  private readonly renderer = new VolumeRenderer();
  private token = sessionStorage.getItem(TOKEN_KEY);
  private drawnVersion = -1;
  private lookVersion = -1;
  private drawn_ms = -Infinity;
  private figures_ms = -Infinity;
  private loading = false;
  private askedForHand = false; // on this connection

  constructor() {
    this.connection = new Connection({
      onLink: (link) => this.onLink(link),
      onState: (state) => this.onState(state),
      onPose: (pose) => this.onPose(pose),
      onToken: () => this.askForToken(),
      onProblem: toast,
      onAsked: () => toast("Asked at the device: it happens when somebody there agrees, within 20 s."),
    }, this.token);
    const { session } = this;
    this.requests = new Requests(this.connection, () => session.state?.armed === true);
    this.pointer = new PointerDevice(session, this.connection);
    this.volume = new VolumeView(session, this.renderer, this.pointer, (rotation) =>
      void this.requests.latest("rotation", { type: "set", rotation_wxyz: rotation }));
    this.sections = (["oblique", "axial", "sagittal", "coronal"] as PlaneKind[]).map(
      (kind) => new SectionView(kind, session, this.slicer, this.measures, this.pointer));
    const pictures: Picture[] = [this.volume.picture, ...this.sections.map((section) => section.picture)];
    byId("pictures").append(...pictures.map((picture) => picture.element));
    this.capture = new Capture(session, pictures, byId("pictures"));
    this.controls = new Controls(session, this.connection, this.requests, {
      layout: (name) => this.layout(name),
      screenshot: () => void this.capture.screenshot().then((blob) => download(blob, `${fileStem()}.png`)).catch(complain),
      record: () => this.record(),
      clearMeasures: () => {
        this.measures.length = 0;
        session.touch();
      },
    });
    this.addHeads();
    this.layout("two");
  }

  /** Loads what is shown, then connects; on later connections looks whether it is still the same. */
  async start(): Promise<void> {
    await this.load();
    this.connection.open();
    requestAnimationFrame((now) => this.frame(now));
    window.setInterval(() => this.connection.watch(), 1000);
  }

  private async load(): Promise<void> {
    this.loading = true;
    try {
      for (let tried = 0; ; tried++) {
        try {
          const scene = await fetchScene(this.token);
          if (scene.volume.hash !== this.session.volumes?.hash) await this.loadVolumes(scene);
          else this.session.setScene(scene, this.session.volumes);
          this.controls.showScene(scene);
          if (this.session.state) this.controls.showState(this.session.state);
          break;
        } catch (error) {
          if (error instanceof NeedsToken) await this.tokenFromUser(this.token !== null);
          else {
            write(byId("cover-text"), `${(error as Error).message}. Trying again …`);
            await new Promise((later) => setTimeout(later, Math.min(500 * 2 ** tried, 5000)));
          }
        }
      }
      byId("cover").hidden = true;
    } finally {
      this.loading = false;
    }
  }

  private async loadVolumes(scene: Scene): Promise<void> {
    byId("cover").hidden = false;
    write(byId("cover-text"), "Loading the volume …");
    const memory = (navigator as { deviceMemory?: number }).deviceMemory ?? 8;
    let shrink = shrinkFor(scene.volume.dims, { mostSide: this.slicer.mostSide, mostTexels: memory <= 2 ? 8e6 : memory <= 4 ? 32e6 : 256e6 });
    for (;;) {
      const volumes = await fetchVolumes(scene, shrink, this.token);
      try {
        this.slicer.load(volumes);
        this.session.setScene(scene, volumes);
        break;
      } catch (error) {
        if (shrink === 4) throw error;
        shrink = shrink === 1 ? 2 : 4;
      }
    }
    if (shrink > 1) toast(`This device's memory is short: the volume is shown at 1/${shrink} of its resolution.`);
    this.volume.sceneChanged();
    for (const section of this.sections) section.reset();
    document.title = `palpate · ${scene.side === "unknown" ? "side unknown" : scene.side}`;
  }

  private tokenFromUser(wasWrong: boolean): Promise<void> {
    const dialog = byId<HTMLDialogElement>("token-dialog");
    const input = byId<HTMLInputElement>("token");
    byId("token-problem").hidden = !wasWrong;
    byId("cover").hidden = true;
    input.value = "";
    if (!dialog.open) dialog.showModal();
    return new Promise((done) => {
      byId<HTMLFormElement>("token-form").onsubmit = () => {
        this.token = input.value.trim();
        sessionStorage.setItem(TOKEN_KEY, this.token);
        this.connection.setToken(this.token);
        input.value = "";
        done();
      };
    });
  }
  private async askForToken(): Promise<void> {
    if (!this.loading) await this.load();
    this.connection.open();
  }

  private onLink(link: Link): void {
    this.askedForHand = false;
    if (link === "connected" && !this.loading) {
      // another server may stand behind the same address
      void this.load();
    }
    this.controls.allow();
    this.session.touch();
  }
  private onState(state: State): void {
    this.session.state = state;
    this.controls.showState(state);
    // without a word where another viewer has it: then the tool says so when it is chosen
    if (!this.askedForHand && this.session.tool === "touch") {
      this.askedForHand = true;
      void this.connection.ask({ type: "pointer", take: true });
    }
    this.session.touch();
  }
  private onPose(pose: Pose): void {
    this.session.setPose(pose);
    this.controls.addPose(pose);
    this.capture.addPose(pose);
  }

  private record(): void {
    try {
      if (this.capture.isRecording) this.capture.stop();
      else this.capture.start();
    } catch (error) {
      complain(error);
    }
    press(byId("record"), this.capture.isRecording);
  }

  private layout(name: string): void {
    byId("pictures").className = `pictures layout-${name}`;
    for (const button of document.querySelectorAll<HTMLElement>("[data-layout]")) button.setAttribute("aria-checked", String(button.dataset.layout === name));
    this.session.touch();
  }

  /** The small controls in the pictures' heads. */
  private addHeads(): void {
    const presets: [Preset, string][] = [["anterior", "A"], ["posterior", "P"], ["left", "L"], ["right", "R"], ["superior", "S"], ["inferior", "I"]];
    const group = element("div", { className: "group small", role: "group", ariaLabel: "Look from" });
    for (const [preset, letter] of presets) {
      const button = element("button", { type: "button", textContent: letter, title: `Look from ${preset}`, ariaLabel: `Look from ${preset}` });
      button.dataset.look = preset;
      button.addEventListener("click", () => this.volume.look(preset));
      group.append(button);
    }
    const turn = element("button", { type: "button", className: "small", textContent: "Turn object", title: "Drag: turn the object that is felt (or drag with Alt)" });
    press(turn, false);
    turn.id = "turn";
    turn.addEventListener("click", () => {
      this.volume.turnsObject = !this.volume.turnsObject;
      press(turn, this.volume.turnsObject);
    });
    this.volume.picture.head.append(group, turn);

    const section = this.sections[0]!;
    const choose = (label: string, options: [string, string][], set: (value: string) => void) => {
      const select = element("select", { className: "small", ariaLabel: label, title: label }, ...options.map(([value, words]) => new Option(words, value)));
      select.addEventListener("change", () => {
        set(select.value);
        this.session.touch();
      });
      return select;
    };
    section.picture.head.append(
      choose("What the section contains besides the tip", [["tool", "along the tool"], ["force", "along the force"], ["fixed", "fixed"]], (value) => (section.along = value as Along)),
      choose("What the section is close to", [["sagittal", "sagittal"], ["coronal", "coronal"], ["axial", "axial"]], (value) => (section.like = value as Anatomical)));
  }

  private frame(now: number): void {
    requestAnimationFrame((later) => this.frame(later));
    const { session, connection } = this;
    const wasFresh = session.isFresh;
    session.isFresh = connection.isFresh();
    session.age_ms = connection.age_ms();
    if (wasFresh !== session.isFresh || !session.isFresh) session.touch();
    if (this.renderer.isSoftware && now - this.drawn_ms < SOFTWARE_FRAME_MS) return;
    this.drawn_ms = now;
    if (this.lookVersion !== session.lookVersion && session.volumes) {
      this.lookVersion = session.lookVersion;
      this.slicer.setColours(session.palette());
    }
    // the volume's sharp picture comes after a while without any change
    this.volume.draw(now);
    if (this.drawnVersion !== session.version) {
      this.drawnVersion = session.version;
      for (const section of this.sections) section.draw();
    }
    this.capture.drawn();
    if (now - this.figures_ms > FIGURES_MS) {
      this.figures_ms = now;
      this.controls.draw();
      write(byId("record"), this.capture.isRecording ? `Stop ${this.capture.seconds().toFixed(0)} s` : "Record");
    }
  }
}

applyTheme();
try {
  const page = new Page();
  openToTests(page);
  void page.start();
} catch (error) {
  write(byId("cover-text"), (error as Error).message);
}
export type { Page };
