// Time line of a recording: playback position, contacts, forces and events. Playback is controlled by requests to the
// server, which plays for all viewers.

import { computed, effect } from "@preact/signals-core";
import { toast } from "../base/announce.js";
import type { RecordedEvent, Recording } from "../protocol/messages.js";
import type { Connection } from "../protocol/connection.js";
import { byId, element, press, write } from "../base/dom.js";
import { quantity } from "../words/figures.js";
import { Watch } from "../base/watch.js";
import { refusalText, type Requests } from "../state/requests.js";
import { ObservedSize } from "../base/screen.js";
import { readable, type Session } from "../state/session.js";
import { themeColour } from "./theme.js";
import { words } from "../words/words.js";

const SPEEDS = [-4, -1, -0.25, 0.1, 0.25, 0.5, 1, 2, 4, 8, 16];
/** Text of a time, to 0.1 ms, which resolves the ticks of the fastest loop. */
const time = (s: number): string => `${s.toFixed(4).replace(/(\.\d\d)0+$/, "$1")} s`;

/** Number of rows: one for each device up to the last one with a contact. */
const devicesOf = (recording: Recording): number =>
  1 + Math.max(0, ...recording.contacts.map(([, , , , device]) => device));

export class Timeline {
  private readonly slider = byId<HTMLInputElement>("place");
  private readonly canvas = byId<HTMLCanvasElement>("line");
  private readonly size = new ObservedSize(this.canvas);
  private readonly marks = byId<HTMLSelectElement>("marks");
  private readonly speed = byId<HTMLSelectElement>("play-speed");
  private readonly recording = computed(() => this.session.scene.value?.recording ?? null);
  private failure: string | null = null; // error as reported last
  private readonly drawing = new Watch();

  constructor(
    private readonly session: Session,
    connection: Connection,
    private readonly requests: Requests,
  ) {
    this.speed.append(...SPEEDS.map((speed) => new Option(`${speed} ×`.replace("-", "−"), String(speed))));
    byId("play").addEventListener("click", () => this.toggle());
    byId("tick-back").addEventListener("click", () => this.step(-1));
    byId("tick-on").addEventListener("click", () => this.step(1));
    this.speed.addEventListener("change", () => this.ask({ speed: Number(this.speed.value) }));
    this.slider.addEventListener("input", () => this.seek(Number(this.slider.value)));
    this.marks.addEventListener("change", () => {
      if (this.marks.value !== "") this.seek(Number(this.marks.value));
      this.marks.value = "";
    });
    this.canvas.addEventListener("pointerdown", (event) => this.goToPointer(event));
    this.canvas.addEventListener("pointermove", (event) => event.buttons === 1 && this.goToPointer(event));
    effect(() => this.showRecording(this.recording.value));
    effect(() => this.listMarks());
    effect(() => this.showState());
    effect(() => this.showTime());
    effect(() => {
      const isAllowed = connection.allows("play");
      for (const id of ["play", "tick-back", "tick-on", "play-speed", "place", "marks"])
        byId<HTMLInputElement>(id).disabled = !isAllowed;
    });
    session.onFigures(() => {
      if (this.drawing.isDue) this.drawing.run(() => this.draw());
    });
  }

  private showRecording(recording: Recording | null): void {
    byId("playback").hidden = recording === null;
    document.body.classList.toggle("shows-recording", recording !== null);
    if (!recording) return;
    this.slider.min = String(recording.begin_s);
    this.slider.max = String(recording.end_s);
  }

  private showState(): void {
    const playback = this.session.state.value?.playback;
    if (!playback) return;
    press(byId("play"), playback.playing);
    if (this.speed.selectedOptions[0]?.value !== String(playback.speed)) {
      // speed set by another viewer
      if (!SPEEDS.includes(playback.speed))
        this.speed.append(new Option(`${playback.speed} ×`.replace("-", "−"), String(playback.speed)));
      this.speed.value = String(playback.speed);
    }
    const failure = playback.failed && refusalText(playback.failed);
    if (failure && failure !== this.failure) toast(failure);
    this.failure = failure;
  }

  toggle(): void {
    this.ask({ playing: this.session.state.value?.playback?.playing !== true });
  }

  private ask(asked: { at_s?: number; playing?: boolean; speed?: number }): void {
    void this.requests.latest(`play ${Object.keys(asked).join()}`, { type: "play", ...asked });
  }
  private seek(at_s: number): void {
    this.ask({ at_s });
  }
  /** Steps by one tick, forwards for positive `ticks`, and pauses there. */
  private step(ticks: number): void {
    const pose = this.session.pose.value,
      scene = this.session.scene.value;
    if (!pose || !scene) return;
    // the middle of a tick, which tolerates jitter of the recorded times
    this.ask({ at_s: pose.time + (ticks > 0 ? 1.5 : -0.5) / scene.rate_hz, playing: false });
  }
  private goToPointer(event: PointerEvent): void {
    const recording = this.recording.value;
    if (this.slider.disabled || !recording) return;
    const { left, width } = this.canvas.getBoundingClientRect();
    const fraction = Math.min(1, Math.max(0, (event.clientX - left) / width));
    this.seek(recording.begin_s + fraction * (recording.end_s - recording.begin_s));
  }

  /** Text of an event in the list. */
  private eventText({ kind, changed, tissue, by, viewer }: RecordedEvent): string {
    const names = words.recorded as Record<string, string>;
    const what =
      kind === "settings"
        ? changed.map((key) => names[key] ?? key).join(", ") || names.nothing!
        : kind === "model"
          ? tissue === null
            ? names.fields!
            : readable(this.session.scene.value?.tissues[tissue]?.name ?? String(tissue))
          : names[kind]!;
    return `${what} · ${viewer === null ? names[by]! : words.viewerNumber(String(viewer))}`;
  }
  private listMarks(): void {
    const recording = this.recording.value;
    if (!recording) return;
    const isOne = devicesOf(recording) === 1;
    const contacts = recording.contacts.map(([begin_s, , label, max_N, device]) => {
      const name = this.session.nameOf(label);
      return {
        at_s: begin_s,
        text: [name, quantity(max_N, "N"), ...(isOne ? [] : [words.deviceNumber(String(device + 1))])].join(" · "),
      };
    });
    const events = recording.events.map((event) => ({ at_s: event.time_s, text: this.eventText(event) }));
    const listed = [...contacts, ...events].sort((a, b) => a.at_s - b.at_s);
    const left = recording.contacts_left_out + recording.events_left_out;
    this.marks.replaceChildren(
      new Option(left > 0 ? words.goToOfMore(String(left)) : words.moveTo, ""),
      ...listed.map(({ at_s, text }) =>
        element("option", { value: String(at_s), textContent: `${time(at_s)}: ${text}` }),
      ),
    );
  }

  private showTime(): void {
    const recording = this.recording.value,
      pose = this.session.pose.value;
    if (!recording || !pose) return;
    if (!this.slider.matches(":active")) this.slider.value = String(pose.time);
    write(byId("play-time"), `${time(pose.time)} / ${time(recording.end_s)} · ${words.tick(String(pose.tick))}`);
  }

  /** Draws forces, contacts in their structures' colours, events and the playback position. */
  private draw(): void {
    const { session, canvas } = this;
    const recording = this.recording.value,
      pose = session.pose.value;
    const { width, height, ratio } = this.size;
    if (!recording || !pose || width === 0) return;
    const colour = themeColour("--ink");
    const context = canvas.getContext("2d")!;
    if (!this.size.fit(canvas)) context.clearRect(0, 0, width, height);
    const span = Math.max(recording.end_s - recording.begin_s, 1e-9);
    const x = (s: number) => ((s - recording.begin_s) / span) * width;
    const colours = new Map(
      session.scene.value!.structures.map(({ label }, n) => [
        label,
        `rgb(${session.appearances.value[n]!.colour.join()})`,
      ]),
    );

    const top = Math.max(...recording.force_N, 1e-6);
    const part = height * 0.62;
    context.fillStyle = themeColour("--force");
    recording.force_N.forEach((force, n) => {
      const bar = (force / top) * part;
      context.fillRect(
        (n / recording.force_N.length) * width,
        part - bar,
        Math.max(1, width / recording.force_N.length),
        bar,
      );
    });
    // one row of contacts for each device
    const row = (height - part) / devicesOf(recording);
    for (const [begin_s, end_s, label, , device] of recording.contacts) {
      context.fillStyle = colours.get(label) ?? colour;
      context.fillRect(x(begin_s), part + device * row + ratio, Math.max(ratio, x(end_s) - x(begin_s)), row - ratio);
    }
    for (const { time_s, kind } of recording.events) {
      context.fillStyle = kind === "stop" ? themeColour("--notice") : colour;
      context.fillRect(x(time_s), 0, ratio, kind === "stop" ? height : height / 4);
    }
    context.fillStyle = colour;
    context.fillRect(x(pose.time) - ratio, 0, 2 * ratio, height);
  }
}
