// The volume in three dimensions, turned as the object is felt, with the tool over it. The volume is drawn anew only when it
// looks otherwise; the tool, its trail and its force are drawn over it for every pose.

import { Camera, type Preset } from "./camera.js";
import { add, dot, orientationLetters, scale, multiply, normalizeQuaternion, spread, type Quaternion, type Vec3 } from "./geometry.js";
import { colourField } from "./field.js";
import { drawAge, drawCube, drawForceBar, drawLetters, drawScale, drawSide, drawTool, drawTrail, text, touchedText, type Projection } from "./overlay.js";
import { Picture } from "./picture.js";
import type { PointerDevice } from "./pointer.js";
import type { Session } from "./session.js";
import type { VolumeRenderer } from "./volume_renderer.js";
import { BACKGROUND } from "./volume_renderer.js";

const ABOUT = "Arrow keys: look from elsewhere; with Alt: turn the object; plus and minus: zoom; Home: from anterior.";
/** A rotation is asked for so often, and the loop interpolates between. */
const ROTATION_INTERVAL_MS = 100;
/** A picture that took longer is drawn coarser while something moves. */
const SLOW_MS = 40;
const STILL_AFTER_MS = 250;
/** Colours are made anew when a slider has rested for so long: it takes a moment for millions of voxels. */
const SETTLED_MS = 150;
const COARSEST = 4;

export class VolumeView {
  readonly picture = new Picture("volume", "Volume", ABOUT);
  readonly camera = new Camera();
  turnsObject = false; // dragging turns the object, not the camera
  private fieldVersion = -1;
  private wantedVersion = -1;
  private wantedSince_ms = 0;
  private key = "";
  private moved_ms = 0;
  private reduction = 1;
  private sharp = false;
  private cost_ms = 0; // of a picture at full size
  private size = 0; // of the picture's shorter side
  private rotation: Quaternion | null = null; // that is asked for
  private rotationSent: Quaternion | null = null;
  private isOpen = false; // the camera has been put before the object as it stands
  private held: Vec3 | null = null;
  private readonly pointers = new Map<number, [number, number]>();

  constructor(private readonly session: Session, private readonly renderer: VolumeRenderer,
              private readonly pointer: PointerDevice, private readonly turnTo: (rotation: Quaternion) => void) {
    this.listen();
    window.setInterval(() => this.sendRotation(), ROTATION_INTERVAL_MS);
    if (renderer.isSoftware) this.reduction = 2;
  }

  /** Of the volume's texture: it takes 4 bytes a texel. */
  get mostTexels(): number {
    const memory = (navigator as { deviceMemory?: number }).deviceMemory ?? 8;
    return this.renderer.isSoftware ? 1.2e6 : memory <= 2 ? 2e6 : memory <= 4 ? 4e6 : 9e6;
  }

  sceneChanged(): void {
    this.camera.place(this.session.scene!.world_from_patient);
    this.isOpen = false;
    this.reset();
  }
  reset(): void {
    const { volumes, pose } = this.session;
    if (!volumes) return;
    if (pose) this.camera.setRotation(pose.rotation);
    this.camera.focus = this.camera.toWorld(volumes.centre);
    const { clientWidth, clientHeight } = this.picture.surface;
    if (clientWidth > 0) this.camera.mmPerPixel = (0.7 * volumes.size) / Math.min(clientWidth, clientHeight);
    this.camera.look("anterior");
    this.session.touch();
  }
  look(preset: Preset): void {
    this.camera.look(preset);
    this.session.touch();
  }

  draw(now: number): void {
    const { session, picture, camera } = this;
    const resized = picture.fit();
    if (!picture.isShown || !session.volumes || !session.scene) return;
    if (resized) {
      // as much is seen in a picture of another size
      const size = Math.min(picture.surface.clientWidth, picture.surface.clientHeight);
      if (this.size === 0) this.reset();
      else camera.mmPerPixel *= this.size / size;
      this.size = size;
    }
    if (session.pose) camera.setRotation(session.pose.rotation);
    if (session.pose && !this.isOpen) {
      // how the object stands is known only now
      this.isOpen = true;
      this.reset();
    }
    const frame = picture.frame();

    if (this.wantedVersion !== session.fieldVersion) {
      this.wantedVersion = session.fieldVersion;
      this.wantedSince_ms = now;
    }
    if (this.fieldVersion < 0 || now - this.wantedSince_ms > SETTLED_MS) this.loadField();
    const key = JSON.stringify([camera.inPatient(), camera.mmPerPixel, frame.width, frame.height]);
    if (key !== this.key) {
      this.key = key;
      this.moved_ms = now;
      this.render(Math.max(1, this.cost_ms > SLOW_MS ? Math.min(COARSEST, Math.sqrt(this.cost_ms / SLOW_MS)) : 1) * this.reduction);
    } else if (!this.sharp && now - this.moved_ms > STILL_AFTER_MS && this.pointers.size === 0) {
      this.render(1);
    }
    this.drawOver();
  }

  private loadField(): void {
    const { session } = this;
    if (this.fieldVersion === session.fieldVersion) return;
    this.fieldVersion = session.fieldVersion;
    this.renderer.load(colourField(session.volumes!, session.looks, session.scanInVolume, session.storedWindow(), this.mostTexels));
    this.key = "";
  }

  /** Draws the volume; so coarse that it costs little while something moves. */
  private render(reduction: number): void {
    const { base } = this.picture;
    const { width, height, ratio } = this.picture.frame();
    const least = this.renderer.isSoftware ? Math.max(ratio, 1.5) : 1;
    const total = Math.max(reduction, least);
    this.cost_ms = this.renderer.render(this.camera, width / ratio, height / ratio, total / ratio) * total * total;
    base.imageSmoothingQuality = "high";
    base.drawImage(this.renderer.canvas, 0, 0, width, height);
    this.sharp = total === least;
  }

  private projection(): Projection {
    const { width, height, ratio } = this.picture.frame();
    const camera = this.camera;
    return {
      pixel: (p) => {
        const [x, y] = camera.project(p);
        return [width / 2 + x * ratio, height / 2 + y * ratio];
      },
      direction: (v) => {
        const world = camera.directionToWorld(v);
        return [dot(world, camera.right), -dot(world, camera.up)];
      },
      pixelsPerMm: ratio / camera.mmPerPixel,
      clearness: () => 1,
    };
  }

  /** Whether something that is drawn solid lies between a point and the viewer. */
  private isHidden(p: Vec3): boolean {
    const { volumes, looks } = this.session;
    const towards = this.camera.directionToPatient(this.camera.backward());
    const step = volumes!.voxelSize * 1.5;
    for (let way = 2.5; way < volumes!.size; way += step) {
      const place = volumes!.structureAt(add(p, scale(towards, way)));
      if (place !== null && looks[place]!.visible && looks[place]!.opacity > 0.5) return true;
    }
    return false;
  }

  private drawOver(): void {
    const { session } = this;
    const frame = this.picture.frame();
    const projection = this.projection();
    frame.context.clearRect(0, 0, frame.width, frame.height);
    const device = session.pose?.devices[0];
    if (device) {
      const hidden = this.isHidden(session.toolAt(device));
      drawTrail(frame, session, projection);
      drawTool(frame, session, device, { ...projection, clearness: () => (hidden ? 0.45 : 1) });
      text(frame, touchedText(session, device), 12 * frame.ratio, 40 * frame.ratio, 12, session.isFresh ? "#eef3f5" : "#a4adb3", "left", "top");
      if (session.scene!.device.input === "pointer") drawForceBar(frame, session, device);
    }
    const camera = this.camera;
    const right = camera.directionToPatient(camera.right);
    const down = scale(camera.directionToPatient(camera.up), -1);
    drawLetters(frame, orientationLetters(right, down), session.scene!.oriented, true);
    if (session.scene!.oriented) {
      drawCube(frame, (v) => {
        const world = camera.directionToWorld(v);
        return [dot(world, camera.right), dot(world, camera.up), dot(world, camera.backward())];
      });
    }
    drawScale(frame, camera.mmPerPixel / frame.ratio);
    drawSide(frame, session.scene!);
    drawAge(frame, session);
  }

  /** 1 where the volume is seen, 0 where the ground is; at full size, drawn for this. */
  silhouette(width: number, height: number, mmPerPixel: number): { width: number; height: number; seen: number[] } {
    this.loadField();
    const kept = this.camera.mmPerPixel;
    this.camera.mmPerPixel = mmPerPixel;
    this.renderer.render(this.camera, width, height, 1);
    this.camera.mmPerPixel = kept;
    const copy = document.createElement("canvas").getContext("2d", { willReadFrequently: true })!;
    copy.canvas.width = width;
    copy.canvas.height = height;
    copy.drawImage(this.renderer.canvas, 0, 0);
    const { data } = copy.getImageData(0, 0, width, height);
    const ground = BACKGROUND.map((x) => Math.round(255 * x));
    const seen = Array.from({ length: width * height }, (_, i) =>
      [0, 1, 2].some((c) => Math.abs(data[4 * i + c]! - ground[c]!) > 28) ? 1 : 0);
    this.key = "";
    return { width, height, seen };
  }

  private turnObject(dx: number, dy: number): void {
    const now = this.rotation ?? this.session.pose?.rotation ?? [1, 0, 0, 0];
    this.rotation = normalizeQuaternion(multiply(this.camera.dragged(dx, dy), now));
  }
  private sendRotation(): void {
    if (!this.rotation || this.rotation === this.rotationSent) return;
    this.rotationSent = this.rotation;
    this.turnTo(this.rotation);
    // what is turned next begins where the object stands then
    if (this.pointers.size === 0) this.rotation = null;
  }
  private patientAt(at: [number, number], depthOf: Vec3): Vec3 {
    const { width, height, ratio } = this.picture.frame();
    return this.camera.unproject((at[0] - width / 2) / ratio, (at[1] - height / 2) / ratio, depthOf);
  }

  private listen(): void {
    const { session, picture } = this;
    const surface = picture.surface;
    surface.addEventListener("contextmenu", (event) => event.preventDefault());
    surface.addEventListener("pointerdown", (event) => {
      surface.setPointerCapture(event.pointerId);
      surface.focus({ preventScroll: true });
      this.pointers.set(event.pointerId, picture.at(event));
      const tip = session.pose?.devices[0]?.tip;
      if (session.tool === "touch" && this.pointer.isTaken && event.button === 0 && !this.turnsObject && tip && this.pointers.size === 1) {
        this.held = this.patientAt(picture.at(event), tip);
        this.pointer.hold(this.held);
      }
    });
    surface.addEventListener("pointermove", (event) => {
      const at = picture.at(event);
      const before = this.pointers.get(event.pointerId);
      if (!before) return;
      const { ratio } = picture.frame();
      const [dx, dy] = [(at[0] - before[0]) / ratio, (at[1] - before[1]) / ratio];
      if (this.pointers.size === 2) {
        const other = [...this.pointers].find(([id]) => id !== event.pointerId)![1];
        this.camera.zoom(spread(other, before, at));
        this.camera.pan(dx / 2, dy / 2);
      } else if (this.held) {
        this.held = this.patientAt(at, this.held);
        this.pointer.move(this.held);
      } else if (event.buttons & 2) this.camera.zoom(Math.exp(-dy / 150));
      else if (event.buttons & 4 || session.tool === "pan" || event.shiftKey) this.camera.pan(dx, dy);
      else if (this.turnsObject || event.altKey) this.turnObject(dx, dy);
      else this.camera.orbit(dx, dy);
      this.pointers.set(event.pointerId, at);
      session.touch();
    });
    const up = (event: PointerEvent) => {
      this.pointers.delete(event.pointerId);
      if (this.held) {
        this.held = null;
        this.pointer.release();
      }
      // what was asked for last still goes out with the next beat
      if (this.rotation === this.rotationSent) this.rotation = null;
      session.touch();
    };
    surface.addEventListener("pointerup", up);
    surface.addEventListener("pointercancel", up);
    surface.addEventListener("wheel", (event) => {
      event.preventDefault();
      if (this.held) {
        const into = this.camera.directionToPatient(this.camera.backward());
        this.held = add(this.held, scale(into, -Math.sign(event.deltaY) * session.volumes!.voxelSize));
        this.pointer.move(this.held);
      } else this.camera.zoom(Math.exp(-event.deltaY / 500));
      session.touch();
    }, { passive: false });
    surface.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey) return;
      const by: Record<string, [number, number]> = { ArrowLeft: [-12, 0], ArrowRight: [12, 0], ArrowUp: [0, -12], ArrowDown: [0, 12] };
      const way = by[event.key];
      if (way && (event.altKey || this.turnsObject)) this.turnObject(...way);
      else if (way) this.camera.orbit(...way);
      else if (event.key === "+" || event.key === "=") this.camera.zoom(1.2);
      else if (event.key === "-") this.camera.zoom(1 / 1.2);
      else if (event.key === "Home") this.reset();
      else return;
      event.preventDefault();
      session.touch();
    });
  }
}
