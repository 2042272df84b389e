// window.palpateViewer: what tests read of the page. It is there in a browser that a test drives (navigator.webdriver). It changes nothing
// but what is drawn for a test, and no part of the page uses it.

import type { Nodes } from "./displacement.js";
import { dot, normalOf, type Vec3 } from "./geometry.js";
import type { Page } from "./main.js";
import type { ScopeFrame } from "./scope.js";

export function openToTests(page: Page): void {
  const { session, connection, sections, volume } = page;
  const section = (kind: string) => sections.find((one) => one.kind === kind)!;
  const hook = {
    /** "connecting", "connected", "lost", "refused" or "ended" */
    get link() { return connection.link; },
    get role() { return connection.role; },
    get age_ms() { return connection.age_ms(); },
    get isFresh() { return session.isFresh; },
    get isLoaded() { return session.volumes !== null && page.isWhole; },
    get volumeHash() { return session.volumes?.hash ?? null; },
    get scene() { return session.scene; },
    get state() { return session.state; },
    get pose() { return session.pose; },
    get structureAtTip() {
      const place = session.pose && session.volumes ? session.volumes.structureAt(session.pose.devices[0]!.tip) : null;
      return place === null ? null : session.scene!.structures[place];
    },
    structureAt: (p: Vec3) => session.volumes?.structureAt(p) ?? null,
    /** Since the page opened: texels of the volume that were made, how often looks were sent, pictures of the volume. */
    get volumeWork() { return page.renderer.work; },
    /** How many texels the volume is drawn from, each way. */
    get volumeTexels() { return page.renderer.texels; },
    get isDrawnInWorker() { return page.renderer.isInWorker; },
    /** palpate draws it. */
    get isServed() { return page.renderer.isServed; },
    /** As a browser takes the graphics of the "sections" or the "volume", or gives them back. */
    loseGraphics: (which: string, restores: boolean) => (which === "volume" ? page.renderer : page.slicer).lose(restores),
    /** Fills a box of voxels with the structure at a place of the list, 0 the first; -1 empties it. */
    fillBox: (lo: Vec3, size: Vec3, place: number) => page.updateBox(lo, size, new Uint8Array(size.reduce((a, b) => a * b)).fill(place + 1)),
    /** Sets voxels of a box, i fastest: places in the list + 1, 0 is nothing. */
    writeBox: (lo: Vec3, size: Vec3, structure: number[]) => page.updateBox(lo, size, Uint8Array.from(structure)),
    /** Tissue yields as nodes of a grid say, or no more. */
    displace: (nodes: Nodes | null) => page.displace(nodes),
    displaceBox: (lo: Vec3, size: Vec3, mm: number[]) => page.updateDisplacement(lo, size, mm),
    /** Some tissue is displaced. */
    get yields() { return session.yields; },
    /** From one picture to the next, where no graphics card draws. */
    set leastFrame_ms(ms: number) { page.leastFrame_ms = ms; },
    /** Draws the pictures and the figures now, whatever the frame rate, and sections as sharp as they get. */
    draw() {
      page.drawSections(Infinity);
      volume.draw(performance.now());
      page.scope.now?.draw(performance.now());
      page.controls.draw();
      page.nearPanel.now?.draw(performance.now());
      page.planPanel.now?.draw();
      page.timeline.now?.draw();
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
    /** Of patient's points: the greatest alpha of what is drawn over a section within two pixels of each. */
    drawnOver(kind: string, points: Vec3[]) {
      const { context, width, height } = section(kind).picture.frame();
      const { data } = context.getImageData(0, 0, width, height);
      return points.map((p) => {
        const [x, y] = section(kind).pixelOf(p).map(Math.floor) as [number, number];
        const near = [-2, -1, 0, 1, 2];
        return Math.max(...near.flatMap((dx) => near.map((dy) => data[4 * (x + dx + width * (y + dy)) + 3] ?? 0)));
      });
    },
    /** The trajectories that are shown, and whether palpate has them. */
    get plan() { return { list: session.plans.list, isShared: session.plans.isShared, plan: session.plans.plan, chosen: session.plans.chosen }; },
    /** What is told of what is near each tool, to which region it is how far, and the tone that is heard of that. */
    get near() { return session.near; },
    get approach() { return session.approach; },
    get tone() { return page.nearPanel.now?.heard.tone ?? null; },
    /** Of tasks: what the panel shows, how far a run is, and the last one that is over. */
    get training() { 
      const panel = page.training.now;
      return { view: panel?.view ?? "none", task: panel?.task?.name ?? null, run: panel?.run ?? null, debriefing: panel?.debriefing ?? null };
    },
    /** Points of the rulers and angles that are made, in the patient. */
    get measures() { return page.measures.all.map(({ points }) => points); },
    /** Where the scope stands: of the patient. */
    get scopeFrame() { return page.scope.now?.frame() ?? null; },
    get scopeWords() { return page.scope.now?.told ?? ""; },
    get isScopeSharp() { return page.scope.now?.isSharp === true; },
    /** What is seen by a scope that stands so: RGBA of a square, row by row, in base64. */
    async scopePicture(frame: ScopeFrame, size: number) {
      const scope = (await page.scope.get())!;
      return btoa(Array.from(await scope.pixels(frame, size), (byte) => String.fromCharCode(byte)).join(""));
    },
    /** Alpha of what is drawn over the volume, all around the tool at so many pixels from its middle. */
    drawnAround(radius: number) {
      const { context, width, height } = volume.picture.frame();
      const copy = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true })!;
      copy.drawImage(context.canvas, 0, 0);
      const { data } = copy.getImageData(0, 0, width, height);
      const [x, y] = volume.pixelOf(session.toolAt(session.pose!.devices[0]!));
      const angles = Array.from({ length: 48 }, (_, n) => (n * Math.PI) / 24);
      return angles.map((angle) => data[4 * (Math.floor(x + radius * Math.cos(angle)) + width * Math.floor(y + radius * Math.sin(angle))) + 3] ?? 0);
    },
    /** RGBA of all that is drawn over the volume, row by row in base64. */
    drawnOverVolume() {
      const { context, width, height } = volume.picture.frame();
      const copy = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true })!;
      copy.drawImage(context.canvas, 0, 0);
      const { data } = copy.getImageData(0, 0, width, height);
      const rows = Array.from({ length: height }, (_, y) => String.fromCharCode(...data.subarray(4 * width * y, 4 * width * (y + 1))));
      return { width, height, rgba: btoa(rows.join("")) };
    },
    /** Where in that points of the patient are. */
    pixelsOverVolume: (points: Vec3[]) => points.map((p) => volume.pixelOf(p)),
    /** Turns the volume's camera from anterior by so many pixels of a drag, which then is where it is for a while. */
    lookFrom(dx: number, dy: number, isPerspective: boolean) {
      // its first picture puts the camera
      volume.draw(performance.now());
      volume.reset();
      volume.camera.orbit(dx, dy);
      volume.camera.isPerspective = isPerspective;
      session.touch();
    },
    /** Nothing of the sections is to be drawn sharper yet. */
    get areSectionsSharp() { return !sections.some(({ isCoarse }) => isCoarse); },
    /** The picture of the volume that is seen is as sharp as it gets. */
    get isVolumeSharp() { return volume.isSharp; },
    /** What is seen at a pixel of the screen, from the volume's middle: a line in the patient. */
    volumeRay: (x: number, y: number) => volume.camera.ray(x, y),
    /** Of the volume view: where a patient's point is, in pixels of the screen from its middle, y down. */
    project: (p: Vec3) => volume.camera.project(p),
    /** RGBA of the volume, row by row, in base64; as what rests is drawn, or as what moves. */
    async volumePicture(width: number, height: number, mmPerPixel: number, isFine = true) {
      return btoa(Array.from(await volume.pixels(width, height, mmPerPixel, isFine), (byte) => String.fromCharCode(byte)).join(""));
    },
    met: (width: number, height: number, mmPerPixel: number) => volume.met(width, height, mmPerPixel),
    silhouette: (width: number, height: number, mmPerPixel: number) => volume.silhouette(width, height, mmPerPixel),
    /** The picture that "Screenshot" writes, as a data URL. */
    async screenshot() {
      const bytes = new Uint8Array(await (await (await page.capture.get())!.screenshot()).arrayBuffer());
      return "data:image/png;base64," + btoa(Array.from(bytes, (byte) => String.fromCharCode(byte)).join(""));
    },
  };
  Object.defineProperty(window, "palpateViewer", { value: Object.freeze(hook) });
}
