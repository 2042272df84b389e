// Screenshots and videos of the pictures as laid out on the page, with the information that every image of a patient
// must carry burned in.

import { download, fileStem } from "../base/download.js";
import { FONT } from "../drawing/overlay.js";
import type { Picture } from "../drawing/picture.js";
import { pixelRatio } from "../base/screen.js";
import type { Session } from "../state/session.js";
import type { Pose } from "../protocol/wire.js";
import { words } from "../words/words.js";

const FRAMES_A_SECOND = 30;
const HEAD_PX = 30;
/** Longest wait of a screenshot for pictures that are being redrawn. */
const REDRAWN_MS = 2000;

export class Capture {
  /** Video in progress; null: none. */
  private recording: { recorder: MediaRecorder; canvas: HTMLCanvasElement; poses: string[]; begun_ms: number } | null =
    null;

  /**
   * @param isRedrawn  whether all visible pictures are drawn completely, for the current layout
   * @param onFailed  called when a recording has failed; the video up to then is saved
   */
  constructor(
    private readonly session: Session,
    private readonly pictures: Picture[],
    private readonly area: HTMLElement,
    private readonly isRedrawn: () => boolean,
    private readonly onFailed: (error: Error) => void,
  ) {
    session.onPose((pose) => this.addPose(pose));
  }

  /** Draws all visible pictures in their layout, below a line that states the permitted use. */
  compose(canvas: HTMLCanvasElement): void {
    const ratio = pixelRatio();
    const box = this.area.getBoundingClientRect();
    // even dimensions, as video encoders require
    const [w, h] = [box.width * ratio, (box.height + HEAD_PX) * ratio].map((n) => 2 * Math.round(n / 2)) as [
      number,
      number,
    ];
    if (canvas.width !== w || canvas.height !== h) Object.assign(canvas, { width: w, height: h });
    const c = canvas.getContext("2d")!;
    c.fillStyle = "#0a0d0f";
    c.fillRect(0, 0, w, h);
    for (const picture of this.pictures) {
      if (!picture.isShown) continue;
      const bounds = picture.surface.getBoundingClientRect();
      const [x, y] = [(bounds.left - box.left) * ratio, (bounds.top - box.top + HEAD_PX) * ratio];
      for (const layer of [picture.base.canvas, picture.over.canvas]) c.drawImage(layer, x, y);
      c.font = `600 ${12 * ratio}px ${FONT}`;
      c.textBaseline = "top";
      c.textAlign = "left";
      c.fillStyle = "#c9d3d9";
      c.fillText(picture.head.querySelector("h2")!.textContent!, x + 12 * ratio, y + 12 * ratio);
    }
    const scene = this.session.scene.value;
    c.fillStyle = "#fdf0dc";
    c.fillRect(0, 0, w, HEAD_PX * ratio);
    c.fillStyle = "#7a4300";
    c.textBaseline = "middle";
    c.font = `600 ${13 * ratio}px ${FONT}`;
    c.textAlign = "center";
    c.fillText(words.notice, w / 2, (HEAD_PX / 2) * ratio);
    c.textAlign = "right";
    c.fillText(scene ? words.side[scene.side] : "", w - 12 * ratio, (HEAD_PX / 2) * ratio);
    c.textAlign = "left";
    const time = this.session.pose.value ? `${this.session.pose.value.time.toFixed(2)} s` : "";
    c.fillText(`palpate ${scene?.palpate ?? ""}   ${time}`, 12 * ratio, (HEAD_PX / 2) * ratio);
  }

  async screenshot(): Promise<Blob> {
    for (const end_ms = performance.now() + REDRAWN_MS; !this.isRedrawn() && performance.now() < end_ms;)
      await new Promise((drawn) => requestAnimationFrame(drawn));
    const canvas = document.createElement("canvas");
    this.compose(canvas);
    return new Promise((done, failed) =>
      canvas.toBlob((blob) => (blob ? done(blob) : failed(new Error(words.noPicture))), "image/png"),
    );
  }

  get isRecording(): boolean {
    return this.recording !== null;
  }
  seconds(): number {
    return this.recording ? (performance.now() - this.recording.begun_ms) / 1000 : 0;
  }

  /**
   * Starts a video.
   * @throws Error if the browser cannot record
   */
  start(): void {
    const type = ["video/webm;codecs=vp9", "video/webm;codecs=vp8", "video/webm"].find((t) =>
      window.MediaRecorder?.isTypeSupported(t),
    );
    if (!type) throw new Error(words.noVideo);
    const canvas = document.createElement("canvas");
    this.compose(canvas);
    const recorder = new MediaRecorder(canvas.captureStream(FRAMES_A_SECOND), {
      mimeType: type,
      videoBitsPerSecond: 8e6,
    });
    const parts: Blob[] = [];
    const stem = fileStem();
    const scene = this.session.scene.value!;
    const poses = [
      JSON.stringify({
        notice: words.notice,
        side: scene.side,
        frame: "patient (LPS), mm; forces in World, N",
        palpate: scene.palpate,
      }),
    ];
    recorder.ondataavailable = (event) => parts.push(event.data);
    recorder.onstop = () => {
      download(new Blob(parts, { type: "video/webm" }), `${stem}.webm`);
      download(new Blob([poses.join("\n") + "\n"], { type: "application/jsonl" }), `${stem}.poses.jsonl`);
    };
    const recording = { recorder, canvas, poses, begun_ms: performance.now() };
    // after an error, the browser ends the recording and delivers its data
    recorder.onerror = () => {
      if (this.recording === recording) this.recording = null;
      this.onFailed(new Error(words.videoEnded));
    };
    recorder.start(1000);
    this.recording = recording;
  }
  stop(): void {
    this.recording?.recorder.stop();
    this.recording = null;
  }
  private addPose(pose: Pose): void {
    if (!this.recording) return;
    const devices = pose.devices.map((d) => ({
      tip: d.tip,
      proxy: d.proxy,
      force: d.force,
      label: d.label,
      depth: Number.isFinite(d.depth) ? d.depth : null,
      flags: d.flags,
      path: d.path.map(({ label, depth, share }) => ({ label, depth: Number.isFinite(depth) ? depth : null, share })),
      contacts: d.contacts,
    }));
    this.recording.poses.push(
      JSON.stringify({ sequence: pose.sequence, tick: pose.tick, time: pose.time, rotation: pose.rotation, devices }),
    );
  }
  /** Adds a frame to the video; to be called after every frame. */
  drawn(): void {
    if (this.recording) this.compose(this.recording.canvas);
  }
}
