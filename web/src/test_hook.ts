// window.palpateViewer: what tests read of the page. It changes nothing but what is drawn for a test, and no part of the
// page uses it.

import { dot, normalOf, type Vec3 } from "./geometry.js";
import type { Page } from "./main.js";

export function openToTests(page: Page): void {
  const { session, connection, sections, volume } = page;
  const section = (kind: string) => sections.find((one) => one.kind === kind)!;
  const hook = {
    /** "connecting", "connected", "lost" or "refused" */
    get link() { return connection.link; },
    get role() { return connection.role; },
    get age_ms() { return connection.age_ms(); },
    get isFresh() { return session.isFresh; },
    get isLoaded() { return session.volumes !== null; },
    get volumeHash() { return session.volumes?.hash ?? null; },
    get scene() { return session.scene; },
    get state() { return session.state; },
    get pose() { return session.pose; },
    get structureAtTip() {
      const place = session.pose && session.volumes ? session.volumes.structureAt(session.pose.devices[0]!.tip) : null;
      return place === null ? null : session.scene!.structures[place];
    },
    structureAt: (p: Vec3) => session.volumes?.structureAt(p) ?? null,
    /** Draws the pictures now, whatever the frame rate. */
    draw() {
      for (const one of sections) one.draw();
      volume.draw(performance.now());
    },
    /** [x, y] of a patient's point in a section's picture, in pixels of its canvas, and how far off its plane it is */
    pixelOf(kind: string, p: Vec3) {
      const [x, y] = section(kind).pixelOf(p);
      return { x, y, off_mm: section(kind).farness_mm(p) };
    },
    patientAt: (kind: string, x: number, y: number) => section(kind).patientAt([x, y]),
    plane(kind: string) {
      const plane = section(kind).shownPlane;
      return { ...plane, normal: normalOf(plane), orthogonal: Math.abs(dot(plane.right, plane.down)) < 1e-6 };
    },
    /** RGB of the picture below the drawn tool. */
    colourAt(kind: string, x: number, y: number) {
      return [...section(kind).picture.base.getImageData(Math.floor(x), Math.floor(y), 1, 1).data.slice(0, 3)];
    },
    /** Of the volume view: where a patient's point is, in pixels of the screen from its middle, y down. */
    project: (p: Vec3) => volume.camera.project(p),
    silhouette: (width: number, height: number, mmPerPixel: number) => volume.silhouette(width, height, mmPerPixel),
    /** The picture that "Screenshot" writes, as a data URL. */
    async screenshot() {
      const bytes = new Uint8Array(await (await page.capture.screenshot()).arrayBuffer());
      return "data:image/png;base64," + btoa(Array.from(bytes, (byte) => String.fromCharCode(byte)).join(""));
    },
  };
  Object.defineProperty(window, "palpateViewer", { value: Object.freeze(hook) });
}
