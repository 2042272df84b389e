// window.palpateViewer: access to the page for tests, in browsers under test only (navigator.webdriver). It changes
// pictures, never the server's session, and no part of the page uses it.

import type { Nodes } from "./protocol/deformation_message.js";
import { dot, normalOf, type Vec3 } from "./base/geometry.js";
import type { Page } from "./page.js";
import type { ScopeFrame } from "./volume/scope.js";

export function openToTests(page: Page): void {
  const { session, connection, sections, volume, voxels } = page;
  const section = (kind: string) => sections.find((one) => one.kind === kind)!;
  const hook = {
    /** State of the connection: "connecting", "connected", "lost", "refused", "ended" or "over". */
    get link() {
      return connection.link.value;
    },
    get role() {
      return connection.role.value;
    },
    get age_ms() {
      return connection.age_ms();
    },
    get isFresh() {
      return session.isFresh.value;
    },
    get isLoaded() {
      return session.volumes.value !== null && page.arePanelsLoaded;
    },
    get volumeHash() {
      return session.volumes.value?.hash ?? null;
    },
    get scene() {
      return session.scene.value;
    },
    get state() {
      return session.state.value;
    },
    get pose() {
      return session.pose.value;
    },
    /** Whether a press of this page holds the tip. */
    get isPressing() {
      return session.isPressing.value;
    },
    get structureAtTip() {
      const index =
        session.pose.value && session.volumes.value
          ? session.volumes.value.structureAt(session.pose.value.devices[0]!.tip)
          : null;
      return index === null ? null : session.scene.value!.structures[index];
    },
    structureAt: (p: Vec3) => session.volumes.value?.structureAt(p) ?? null,
    /** Counters since the page was opened: computed texels, sent looks, pictures of the volume. */
    get volumeWork() {
      return page.renderer.work;
    },
    /** Number of texels of the volume along each axis. */
    get volumeTexels() {
      return page.renderer.texels;
    },
    get isDrawnInWorker() {
      return page.renderer.isInWorker;
    },
    /** Whether the volume is rendered by palpate instead of the browser. */
    get isServed() {
      return page.renderer.isServed;
    },
    /** Loses or restores the WebGL context of the "sections" or of the "volume", like a browser. */
    loseGraphics: (which: string, restores: boolean) =>
      (which === "volume" ? page.renderer : page.slicer).lose(restores),
    /** Fills a box of voxels with a structure by its index; -1 empties it. */
    fillBox: (lo: Vec3, size: Vec3, index: number) =>
      voxels.updateBox(lo, size, new Uint8Array(size.reduce((a, b) => a * b)).fill(index + 1)),
    /** Replaces the structures in a box of voxels, i fastest: index in the scene's list + 1, or 0. */
    writeBox: (lo: Vec3, size: Vec3, structure: number[]) => voxels.updateBox(lo, size, Uint8Array.from(structure)),
    /** Displays a deformation, initially zero, on a grid of nodes; null: none. */
    displace: (nodes: Nodes | null) => voxels.displace(nodes),
    displaceBox: (lo: Vec3, size: Vec3, mm: number[]) => voxels.updateDisplacement(lo, size, mm),
    /** Whether tissue is deformed. */
    get isDeformed() {
      return session.isDeformed.value;
    },
    /** Minimum frame interval without a graphics card. */
    set leastFrame_ms(ms: number) {
      page.frames.leastFrame_ms = ms;
    },
    /** Draws pictures and figures immediately, with sections at full resolution. */
    draw: () => page.frames.drawNow(),
    /** Projection of a position into a section, canvas pixels, and its distance from the section's plane, mm. */
    pixelOf(kind: string, p: Vec3) {
      const [x, y] = section(kind).pixelOf(p);
      return { x, y, off_mm: section(kind).distance_mm(p) };
    },
    patientAt: (kind: string, x: number, y: number) => section(kind).patientAt([x, y]),
    plane(kind: string) {
      const plane = section(kind).shownPlane;
      return { ...plane, normal: normalOf(plane), orthogonal: Math.abs(dot(plane.right, plane.down)) < 1e-6 };
    },
    /** RGB of a picture's pixel, without overlays. */
    colourAt(kind: string, x: number, y: number) {
      return [...section(kind).picture.base.getImageData(Math.floor(x), Math.floor(y), 1, 1).data.slice(0, 3)];
    },
    /** Maximum alpha of a section's overlays within two pixels of each position. */
    drawnOver(kind: string, points: Vec3[]) {
      const { context, width, height } = section(kind).picture.frame();
      const { data } = context.getImageData(0, 0, width, height);
      return points.map((p) => {
        const [x, y] = section(kind).pixelOf(p).map(Math.floor) as [number, number];
        const near = [-2, -1, 0, 1, 2];
        return Math.max(...near.flatMap((dx) => near.map((dy) => data[4 * (x + dx + width * (y + dy)) + 3] ?? 0)));
      });
    },
    /** Displayed trajectories, and whether they belong to palpate's plan. */
    get plan() {
      return {
        list: session.plans.list,
        isShared: session.plans.isShared,
        plan: session.plans.plan,
        chosen: session.plans.chosen.value,
      };
    },
    /** Distances of each tool, the nearest no-go region, and the current tone. */
    get near() {
      return session.near.value;
    },
    get approach() {
      return session.approach.value;
    },
    get tone() {
      return page.panels.near.value?.approachSound.tone ?? null;
    },
    /** State of the tasks: view of the panel, progress of the run, latest results. */
    get training() {
      const panel = page.panels.training.value;
      return {
        view: panel?.view ?? "none",
        task: panel?.task?.name ?? null,
        run: panel?.run ?? null,
        debriefing: panel?.debriefing ?? null,
      };
    },
    /** Points of all measures. */
    get measures() {
      return page.measures.list.value.map(({ points }) => points);
    },
    /** Pose of the scope; patient frame. */
    get scopeFrame() {
      return page.scope.value?.frame() ?? null;
    },
    get scopeWords() {
      return page.scope.value?.caption ?? "";
    },
    get isScopeSharp() {
      return page.scope.value?.isSharp === true;
    },
    /** Square picture of a scope at a pose: RGBA by rows, base64. */
    async scopePicture(frame: ScopeFrame, size: number) {
      const scope = (await page.scope.get())!;
      return btoa(Array.from(await scope.pixels(frame, size), (byte) => String.fromCharCode(byte)).join(""));
    },
    /** Alpha of the volume's overlays on a circle about the tool; radius in pixels. */
    drawnAround(radius: number) {
      const { context, width, height } = volume.picture.frame();
      const copy = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true })!;
      copy.drawImage(context.canvas, 0, 0);
      const { data } = copy.getImageData(0, 0, width, height);
      const [x, y] = volume.pixelOf(session.toolAt(session.pose.value!.devices[0]!));
      const angles = Array.from({ length: 48 }, (_, n) => (n * Math.PI) / 24);
      return angles.map(
        (angle) =>
          data[4 * (Math.floor(x + radius * Math.cos(angle)) + width * Math.floor(y + radius * Math.sin(angle))) + 3] ??
          0,
      );
    },
    /** RGBA of the volume's overlays by rows, base64. */
    drawnOverVolume() {
      const { context, width, height } = volume.picture.frame();
      const copy = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true })!;
      copy.drawImage(context.canvas, 0, 0);
      const { data } = copy.getImageData(0, 0, width, height);
      const rows = Array.from({ length: height }, (_, y) =>
        String.fromCharCode(...data.subarray(4 * width * y, 4 * width * (y + 1))),
      );
      return { width, height, rgba: btoa(rows.join("")) };
    },
    /** Projections of positions into the volume's picture, canvas pixels. */
    pixelsOverVolume: (points: Vec3[]) => points.map((p) => volume.pixelOf(p)),
    /** Rotates the volume's camera from the anterior view, like a drag by a number of pixels. */
    lookFrom(dx: number, dy: number, isPerspective: boolean) {
      // initial placement of the camera, by the first picture
      volume.draw(performance.now());
      volume.reset();
      const { clientWidth, clientHeight } = volume.picture.surface;
      volume.camera.focus = volume.camera.toWorld(session.volumes.value!.centre);
      volume.camera.mmPerPixel = (0.7 * session.volumes.value!.size) / Math.min(clientWidth, clientHeight);
      volume.camera.orbit(dx, dy);
      volume.camera.isPerspective = isPerspective;
    },
    /** Whether all visible pictures are drawn completely, for the current layout. */
    get isRedrawn() {
      return page.isRedrawn;
    },
    /** Whether all sections are at full resolution. */
    get areSectionsSharp() {
      return !sections.some(({ isCoarse }) => isCoarse);
    },
    /** Whether the displayed picture of the volume is sharp. */
    get isVolumeSharp() {
      return volume.isSharp;
    },
    /** Ray in the patient frame through a pixel, given relative to the picture's centre. */
    volumeRay: (x: number, y: number) => volume.camera.ray(x, y),
    /** Projection into the volume's picture: CSS pixels from its centre, y down. */
    project: (p: Vec3) => volume.camera.project(p),
    /** RGBA of the volume by rows, base64, with the quality at rest (`isFine`) or in motion. */
    async volumePicture(width: number, height: number, mmPerPixel: number, isFine = true) {
      return btoa(
        Array.from(await volume.pixels(width, height, mmPerPixel, isFine), (byte) => String.fromCharCode(byte)).join(
          "",
        ),
      );
    },
    met: (width: number, height: number, mmPerPixel: number) => volume.hitMask(width, height, mmPerPixel),
    silhouette: (width: number, height: number, mmPerPixel: number) => volume.silhouette(width, height, mmPerPixel),
    /** Picture that "Screenshot" saves, as a data URL. */
    async screenshot() {
      const bytes = new Uint8Array(await (await (await page.captures.capture.get())!.screenshot()).arrayBuffer());
      return "data:image/png;base64," + btoa(Array.from(bytes, (byte) => String.fromCharCode(byte)).join(""));
    },
  };
  Object.defineProperty(window, "palpateViewer", { value: Object.freeze(hook) });
}
