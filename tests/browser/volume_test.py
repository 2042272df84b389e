"""The volume in the viewer page: silhouettes, colours, shading, deformation, the scope, cut-away and lost graphics.

usage: volume_test.py [--campaigns] palpate PALPATE [TEST ...]
       volume_test.py [--campaigns] mock NODE MOCK_SERVER PAGE_FOLDER [TEST ...]

viewer_test.py explains the arguments and runs these tests with those of the other scripts in one browser.
"""

import base64
import json
import math
import os
import random
import sys
import time
import unittest

sys.dont_write_bytecode = True  # nothing is left in the source tree
import browser  # noqa: E402
import viewer_page  # noqa: E402
from pointer_session import PointerSession  # noqa: E402
from viewer_page import STOPS, Server, Viewer, WITHOUT_WEBGL, campaign, numpy, rotation_matrix, test_seed  # noqa: E402


class WithoutWebGl(Viewer):
    """Without 3-D textures in the browser, palpate renders the volume on the server."""

    @classmethod
    def setUpClass(cls):
        if viewer_page.program is None:
            raise unittest.SkipTest("the mock server draws nothing")
        cls.server = Server("pointer in finer voxels").__enter__()
        cls.addClassCleanup(cls.server.__exit__)
        cls.open_browser()

    def silhouette(self, size, mm):
        answer = self.page.run("return palpateViewer.silhouette(arguments[0], arguments[1], arguments[2])", size[1], size[0], mm)
        return numpy.array(answer["seen"], bool).reshape(size)

    def seen_from(self, views, size, mm):
        """For each view: mask of pixels whose ray hits a structure, and mask of pixels that differ from the background.
        """
        met, coloured = [], []
        for dx, dy, perspective in views:
            self.page.run("palpateViewer.lookFrom(arguments[0], arguments[1], arguments[2])", dx, dy, perspective)
            answer = self.page.run("return palpateViewer.met(arguments[0], arguments[1], arguments[2])", size[1], size[0], mm)
            met.append(numpy.array(answer, bool).reshape(size))
            coloured.append(self.silhouette(size, mm))
        return met, coloured

    @campaign
    def test_palpate_draws_the_same_silhouettes_and_follows_a_drag(self):
        size, mm = (340, 340), 0.5
        views = [(0, 0, False), (120, 60, False), (-200, -40, True)]
        self.assertFalse(self.page.run("return palpateViewer.isServed"))
        expected = self.seen_from(views, size, mm)
        self.assertGreater((expected[0][0] ^ expected[0][1]).sum(), 500)
        shared, arguments = self.page, browser.ARGUMENTS
        browser.ARGUMENTS = WITHOUT_WEBGL
        try:
            type(self).open_browser(own=True)
        finally:
            browser.ARGUMENTS = arguments
        self.page = type(self).page
        type(self).page = shared
        self.open_page()
        self.page.wait("palpateViewer.isServed")
        served = self.seen_from(views, size, mm)
        # palpate's rims are soft and lie up to half a voxel farther out: a pixel has another colour than the ground from a sixth of cover on,
        # and is met from half of it on
        for what, of_palpate, of_graphics in zip(("met", "coloured"), served, expected):
            for seen, by_graphics in zip(of_palpate, of_graphics):
                overlap = (seen & by_graphics).sum() / (seen | by_graphics).sum()
                print(f"  {what}: intersection over union {overlap:.4f}, {(seen & ~by_graphics).sum()} more, {(by_graphics & ~seen).sum()} less of {by_graphics.sum()}", flush=True)
                self.assertGreaterEqual(overlap, 0.97)
        # pictures come while it is dragged, and the last one is what is seen at the end
        before, work = self.silhouette(size, mm), "palpateViewer.volumeWork.pictures"
        pictures = self.page.run(f"return {work}")
        self.drag("#picture-volume .stack", 90, 30)
        self.page.wait(f"{work} > {pictures} && palpateViewer.isVolumeSharp")
        self.assertGreater((self.silhouette(size, mm) ^ before).sum(), 500)
        folder = os.environ.get("PALPATE_TEST_PICTURES")
        if folder:
            self.page.screenshot(os.path.join(folder, "without-webgl.png"))


class WithSphere(Viewer):
    """One of 20 mm, of voxels of 0.5 mm: the mock's alone."""

    uses_mock = True

    @classmethod
    def setUpClass(cls):
        cls.server = Server("pointer", extra=["--scan", "sphere"]).__enter__()
        cls.addClassCleanup(cls.server.__exit__)
        cls.open_browser()

    @campaign
    def test_a_sphere_is_shaded_as_one(self):
        size, mm, radius = 110, 0.2, 10
        at = (numpy.arange(size) + 0.5 - size / 2) * mm
        # the picture's middle is the volume's, and the sphere's is a little beside it
        x, y = numpy.meshgrid(at - 0.1, at + 0.15)
        aside = numpy.hypot(x, y)
        disc = aside < 0.985 * radius
        facing = numpy.sqrt(1 - numpy.minimum(1, aside / radius) ** 2)
        # the key light is at the upper left (web/src/volume/shading.gen.ts); y points down; the mock's friction of 0.15 is a gloss of a quarter
        key = numpy.array((-0.45, 0.6, 0.66)) / numpy.linalg.norm((-0.45, 0.6, 0.66))
        half = (key + (0, 0, 1)) / numpy.linalg.norm(key + (0, 0, 1))

        def shaded(towards):
            along = [numpy.maximum(0, (way[0] * x - way[1] * y) / radius + way[2] * towards * facing) for way in (key, half)]
            return 0.22 + 0.46 * facing + 0.34 * along[0] + 0.05 * facing ** 20 + 0.25 * (0.12 * along[1] ** 8 + 0.35 * along[1] ** 60)

        surface, far_side = shaded(1), shaded(-1)
        off = {}
        for opacity in (1, 0.6, 0.3):
            self.page.run("""const set = (kind, value) => {
                  const input = document.querySelector(`[aria-label="${kind} of femur"]`);
                  input.value = value;
                  input.dispatchEvent(new Event("input", { bubbles: true }));
                };
                set("Colour", "#ffffff");
                set("Opacity", arguments[0]);""", opacity)
            data = base64.b64decode(self.page.run("return palpateViewer.volumePicture(arguments[0], arguments[0], arguments[1])", size, mm))
            seen = numpy.frombuffer(data, numpy.uint8).reshape(size, size, 4)[:, :, 1] / 255
            # in through a surface, a faint haze, out through one, and the ground behind
            dense = numpy.ones_like(surface) if opacity == 1 else 1 - (1 - 0.6 * opacity) ** (1 / numpy.maximum(facing, 0.3))
            haze = 1 - numpy.exp(-0.006 * opacity * 2 * radius * facing)
            behind = haze * 0.8 + (1 - haze) * (dense * far_side + (1 - dense) * 12 / 255)
            error = (seen - (dense * surface + (1 - dense) * behind))[disc]
            off[opacity] = (numpy.sqrt((error ** 2).mean()), abs(error).max())
            light = seen[disc].mean() / (opacity * surface + (1 - opacity) * 12 / 255)[disc].mean()
            print(f"  opacity {opacity}: {100 * off[opacity][0]:.2f} % off in the mean square, {100 * off[opacity][1]:.2f} % at most; {100 * light:.0f} % of the light", flush=True)
            self.assertGreaterEqual(light, 0.7)
        self.assertLess(off[1][0], 0.015)
        self.assertLess(off[1][1], 0.05)
        self.assertLess(max(off[0.6][0], off[0.3][0]), 0.03)

    @campaign
    def test_tissue_that_yields_is_seen_where_it_went(self):
        scene = self.server.scene()
        labels, patient_from_voxel = self.server.labels(scene)
        volume = scene["volume"]
        scan = numpy.frombuffer(self.server.get("api/volume/scan/" + volume["hash"]), "<i2").reshape(volume["dims"][::-1]).transpose(2, 1, 0)
        voxel_from_patient = numpy.linalg.inv(patient_from_voxel)
        # nodes of a grid of its own that stands askew and holds the whole volume
        dims, spacing = numpy.array((11, 10, 12)), 5.5
        turned = rotation_matrix(numpy.array((0.9, 0.3, -0.2, 0.25)) / numpy.linalg.norm((0.9, 0.3, -0.2, 0.25)))
        node_from_patient = numpy.eye(4)
        node_from_patient[:3, :3] = turned.T / spacing
        node_from_patient[:3, 3] = (dims - 1) / 2
        nodes = (numpy.argwhere(numpy.ones(dims)) - (dims - 1) / 2) * spacing @ turned.T

        def at_nodes(field, points):
            """The displacement between nodes, linear."""
            node = points @ node_from_patient[:3, :3].T + node_from_patient[:3, 3]
            low = numpy.clip(numpy.floor(node).astype(int), 0, dims - 2)
            share = node - low
            return sum(numpy.prod(numpy.where(corner, share, 1 - share), 1)[:, None] * field.reshape(*dims, 3)[tuple((low + corner).T)]
                       for corner in map(numpy.array, numpy.ndindex(2, 2, 2)))

        def displace(field):
            """Two boxes of nodes after each other."""
            self.page.run("palpateViewer.displace(arguments[0])", {"dims": dims.tolist(), "nodeFromPatient": node_from_patient.tolist()})
            for begin, end in ((0, 5), (5, dims[2])):
                box = field.reshape(*dims, 3)[:, :, begin:end].transpose(2, 1, 0, 3)
                self.page.run("return palpateViewer.displaceBox(...arguments)", [0, 0, begin], [int(dims[0]), int(dims[1]), int(end - begin)], box.ravel().tolist())

        def voxelise(moved):
            self.page.run("palpateViewer.displace(null)")
            self.page.run("return palpateViewer.writeBox(...arguments)", [0, 0, 0], list(labels.shape), moved.transpose(2, 1, 0).ravel().astype(int).tolist())

        def seen():
            """The volume from outside and from within, and a grid of the section's pixels."""
            pixels = lambda data, size: numpy.frombuffer(base64.b64decode(data), numpy.uint8).reshape(size, size, 4)[:, :, :3].astype(int)  # noqa: E731
            outside = pixels(self.page.run("return palpateViewer.volumePicture(140, 140, 0.2)"), 140)
            frame = {"eye": [1, -2, 12.5], "forward": [0, 0, -1], "right": [1, 0, 0], "up": [0, 1, 0]}
            within = pixels(self.page.run("return palpateViewer.scopePicture(arguments[0], 80)", frame), 80)
            grid = numpy.array(self.page.run("""palpateViewer.draw();
                const { width, height } = document.querySelector("#picture-oblique canvas");
                const out = [];
                for (let y = 2; y < height; y += 7) for (let x = 2; x < width; x += 7) out.push([...palpateViewer.patientAt("oblique", x + 0.5, y + 0.5), ...palpateViewer.colourAt("oblique", x, y)]);
                return out;"""))
            return outside, within, grid

        def label_at(points):
            voxel = numpy.floor(points @ voxel_from_patient[:3, :3].T + voxel_from_patient[:3, 3] + 0.5).astype(int)
            inside = ((voxel >= 0) & (voxel < labels.shape)).all(1)
            return numpy.where(inside, labels[tuple(numpy.where(inside[:, None], voxel, 0).T)], -1)

        is_sphere = lambda grid: abs(grid[:, 3:] - scene["structures"][0]["colour"]).max(1) <= 3  # noqa: E731
        same = lambda a, b: (abs(a - b).max(-1) <= 2).mean()  # noqa: E731
        self.page.run("""const set = (id, value, kind) => { const one = document.querySelector(id); one.value = value; one.dispatchEvent(new Event(kind, { bubbles: true })); };
            set("#fill", 1, "input");
            document.getElementById("outlines").click();
            document.getElementById("follow").click();""")
        at_rest = seen()
        centres = numpy.argwhere(numpy.ones(labels.shape)) @ patient_from_voxel[:3, :3].T + patient_from_voxel[:3, 3]
        # by whole voxels: the same pixels as of the sphere that is voxelised there
        moved = numpy.roll(labels, (3, -2, 1), (0, 1, 2))
        field = numpy.broadcast_to(-0.5 * numpy.array((3, -2, 1)), (len(nodes), 3))
        displace(field)
        now = seen()
        grid = now[2]
        inverse = grid[:, :3] + at_nodes(field, grid[:, :3])
        voxel = inverse @ voxel_from_patient[:3, :3].T + voxel_from_patient[:3, 3]
        low = numpy.clip(numpy.floor(voxel).astype(int), 0, numpy.array(scan.shape) - 2)
        share = numpy.clip(voxel - low, 0, 1)
        value = sum(numpy.prod(numpy.where(corner, share, 1 - share), 1) * scan[tuple((low + corner).T)] for corner in map(numpy.array, numpy.ndindex(2, 2, 2)))
        least, most = volume["scan"]["window"]
        greys = label_at(inverse) == 0
        self.assertGreater(greys.sum(), 200)
        off = abs(grid[greys, 3] - 255 * numpy.clip((value[greys] - least) / (most - least), 0, 1))
        self.assertGreater((off <= 1.5).mean(), 0.99)
        voxelise(moved)
        voxelised = seen()
        share = [same(now[0], voxelised[0]), same(now[1], voxelised[1]), (is_sphere(now[2]) == is_sphere(voxelised[2])).mean()]
        # bent, so that what comes out is no sphere
        field = 2.2 * numpy.sin(nodes[:, [1, 2, 0]] / 6) + (0.4, -0.3, 0.2)
        bent = label_at(centres + at_nodes(field, centres)).clip(0).reshape(labels.shape)
        voxelise(labels)
        displace(field)
        now = seen()
        is_there = label_at(now[2][:, :3] + at_nodes(field, now[2][:, :3])) == 1
        share.append((is_sphere(now[2]) == is_there).mean())
        voxelise(bent)
        voxelised = seen()
        is_ground = lambda pixels: abs(pixels - (9, 12, 14)).max(-1) < 4  # noqa: E731
        share += [(is_ground(a) == is_ground(b)).mean() for a, b in zip(now[:2], voxelised[:2])]
        share.append((is_sphere(now[2]) == is_sphere(voxelised[2])).mean())
        print("  of the pixels are as of what is voxelised there " + ", ".join(f"{one:.4f}" for one in share), flush=True)
        self.assertGreaterEqual(min(share), 0.99)
        for a, b in zip(now, at_rest):
            self.assertGreater((abs(a - b).max(-1) > 20).mean(), 0.02, "it has moved")
        # and as it was at first
        voxelise(labels)
        for a, b in zip(seen(), at_rest):
            self.assertEqual(abs(a - b).max(), 0)

    @campaign
    def test_reported_deformation_and_strain_are_drawn(self):
        scene = self.server.scene()
        at, mm, wide, spacing = numpy.array((1, 0, 2)), numpy.array((-0.5, 1.5, 2)), 5, 2.5

        def back(points):
            """How far from there the tissue lay that is seen at a place: it went where the message says."""
            came = points.copy()
            for _ in range(30):
                came = points - numpy.exp(-((came - at) ** 2).sum(1) / (2 * wide ** 2))[:, None] * mm
            return came - points

        def between_nodes(points):
            """The same as pictures look it up: linear between the grid's nodes."""
            first = at - spacing * (numpy.array((24, 17, 17)) - 1) / 2
            node = (points - first) / spacing
            low = numpy.floor(node)
            return sum(numpy.prod(numpy.where(corner, node - low, 1 - node + low), 1)[:, None] * back(first + spacing * (low + corner))
                       for corner in map(numpy.array, numpy.ndindex(2, 2, 2)))

        def strain(points):
            step = spacing * numpy.eye(3)
            slope = numpy.stack([(between_nodes(points + one) - between_nodes(points - one)) / (2 * spacing) for one in step], 2)
            turned = slope.transpose(0, 2, 1)
            by = -0.5 * (slope + turned + turned @ slope)
            by -= numpy.trace(by, axis1=1, axis2=2)[:, None, None] / 3 * numpy.eye(3)
            return numpy.sqrt((by ** 2).sum((1, 2)) / 1.5)

        def seen():
            """Every seventh pixel of the section: where it is in the patient, its colour."""
            return numpy.array(self.page.run("""palpateViewer.draw();
                const { width, height } = document.querySelector("#picture-oblique canvas");
                const out = [];
                for (let y = 2; y < height; y += 7) for (let x = 2; x < width; x += 7) out.push([...palpateViewer.patientAt("oblique", x + 0.5, y + 0.5), ...palpateViewer.colourAt("oblique", x, y)]);
                return out;"""))

        def volume():
            return self.page.run("return palpateViewer.volumePicture(60, 60, 0.4)")

        colour = numpy.array(scene["structures"][0]["colour"])
        is_sphere = lambda grid: abs(grid[:, 3:] - colour).max(1) <= 3  # noqa: E731
        self.slide("#fill", 1)
        self.page.run("document.getElementById('outlines').click(); document.getElementById('follow').click()")
        rest, volume_at_rest = seen(), volume()
        self.server.get("mock/yield?at=1,0,2&mm=-0.5,1.5,2&wide=5&device=0")
        self.page.wait("palpateViewer.isDeformed")
        now = seen()
        came = now[:, :3] + back(now[:, :3])
        radius = numpy.linalg.norm(came - (0.1, -0.05, 0.15), axis=1)
        clear = abs(radius - 10) > 0.5  # voxels are as wide
        self.assertEqual((is_sphere(now) == (radius < 10))[clear].mean(), 1)
        self.assertGreater((abs(now[:, 3:] - rest[:, 3:]).max(1) > 20).mean(), 0.005, "it has moved")
        self.assertNotEqual(volume(), volume_at_rest)

        # colours of the strain, by keys alone, over the structure's own
        self.page.run("for (const card of document.querySelectorAll('details')) card.open = true; document.getElementById('strain').focus()")
        self.page.press("\ue007")
        self.page.wait("document.getElementById('strain').checked")
        coloured = seen()
        within = is_sphere(now) & clear
        expected = strain(coloured[within, :3])
        colours = numpy.array(((0, 0, 4), (87, 16, 110), (188, 55, 84), (249, 142, 9), (252, 255, 164)))
        along = numpy.clip(expected / 0.25, 0, 1) * 4
        by = numpy.stack([numpy.interp(along, range(5), colours[:, c]) for c in range(3)], 1)
        cover = numpy.clip(expected / 0.02, 0, 1)
        cover = (0.85 * cover * cover * (3 - 2 * cover))[:, None]
        off = abs(coloured[within, 3:] - (colour * (1 - cover) + by * cover))
        print(f"  strained by {100 * expected.max():.0f} % at most, colours {off.mean():.2f} of 255 off, {numpy.percentile(off, 99):.1f} at the most of 99 %", flush=True)
        self.assertGreater(expected.max(), 0.15)
        # a hundredth of strain is 14 of 255, and the page goes back from what is linear between nodes
        self.assertLess(off.mean(), 12)
        self.assertEqual(abs(coloured[~is_sphere(now) & clear, 3:] - now[~is_sphere(now) & clear, 3:]).max(), 0, "around the sphere nothing is strained")

        # what the graphics have lost comes back
        self.page.run("palpateViewer.loseGraphics('sections', false)")
        self.page.wait("!document.getElementById('graphics').hidden")
        self.page.run("palpateViewer.loseGraphics('sections', true)")
        self.page.wait("document.getElementById('graphics').hidden")
        self.assertEqual(abs(seen() - coloured).max(), 0)
        # and so does the tissue
        self.server.get("mock/yield")
        self.page.wait("!palpateViewer.isDeformed")
        self.assertEqual(abs(seen() - rest).max(), 0)
        self.assertEqual(volume(), volume_at_rest)


class WithManyVoxels(Viewer):
    """As many as a knee has that was scanned: the mock's alone, which says when a stop came."""

    uses_mock = True
    limits_frame_rate = False

    @classmethod
    def setUpClass(cls):
        cls.server = Server("script", extra=["--repeat", "2"]).__enter__()
        cls.addClassCleanup(cls.server.__exit__)
        cls.open_browser()

    def stops(self, count):
        """ms from each press of the space bar until its stop is where the loop would be."""
        already = len(json.loads(self.server.get("mock/stops")))
        self.page.run("window.pressed = []")
        for n in range(count):
            self.page.press(" ")
            # at another moment of what goes on each time
            time.sleep(0.2 + 0.09 * (n % 5))
        deadline = time.monotonic() + 300
        while True:
            came = json.loads(self.server.get("mock/stops"))[already:]
            if len(came) >= count:
                break
            self.assertLess(time.monotonic(), deadline, f"{len(came)} of {count} stops")
            time.sleep(0.2)
        return sorted(b - a for a, b in zip(self.page.run("return window.pressed"), came))

    @campaign
    def test_a_stop_waits_for_no_picture(self):
        self.page.wait("palpateViewer.volumeWork.pictures > 0")
        self.page.run("""window.long = [];
            addEventListener("keydown", (event) => event.key === " " && window.pressed.push(performance.timeOrigin + event.timeStamp), { capture: true });
            new PerformanceObserver((list) => window.long.push(...list.getEntries().map((entry) => entry.duration))).observe({ type: "longtask" });
            const stack = document.querySelector("#picture-volume .stack"), lines = document.querySelectorAll(".structure");
            const slab = (kind) => {
              const one = document.getElementById("slab");
              one.value = kind;
              one.dispatchEvent(new Event("change"));
            };
            let n = 0, timers = [];
            window.keepBusy = () => {
              slab("maximum");
              timers = [setInterval(() => stack.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowRight" })), 40), setInterval(() => {
                const [colour, opacity] = lines[n++ % lines.length].querySelectorAll("input");
                colour.value = n % 2 ? "#3060c0" : "#c06030";
                opacity.value = n % 3 ? 1 : 0.5;
                for (const input of [colour, opacity]) input.dispatchEvent(new Event("input", { bubbles: true }));
                lines[n % lines.length].querySelector(".eye").click();
              }, 350)];
            };
            window.rest = () => {
              timers.forEach(clearInterval);
              slab("none");
            };""")
        self.slide("#slab-mm", 10)
        idle, busy, long, elapsed, work = [], [], [], 0, {"appearances": 0, "pictures": 0, "texels": 0}
        # by turns, so that what else the machine does makes both wait
        for _ in range(STOPS // 5):
            idle += self.stops(3)
            before = self.page.run("window.long.length = 0; window.since = performance.now(); window.keepBusy(); return palpateViewer.volumeWork")
            busy += self.stops(5)
            after, some, took = self.page.run("window.rest(); return [palpateViewer.volumeWork, window.long, performance.now() - window.since]")
            work = {of: work[of] + after[of] - before[of] for of in work}
            long += some
            elapsed += took
        idle, busy = sorted(idle), sorted(busy)
        above = lambda part: busy[len(busy) - 1 - int(part * len(busy))]  # noqa: E731
        print(f"  {len(busy)} stops: idle {idle[len(idle) // 2]:.1f} ms, busy {above(0.5):.1f} ms, a quarter above {above(0.25):.1f}, "
              f"a twentieth above {above(0.05):.1f}, at most {busy[-1]:.0f}; {len(long)} tasks above 50 ms, "
              f"the longest {max(long, default=0):.0f}", flush=True)
        # what went on: looks were changed, pictures drawn, and no voxel touched
        self.assertGreater(work["appearances"], 5)
        self.assertGreater(work["pictures"], 2)
        self.assertEqual(work["texels"], 0)
        # a quarter took hundreds of times as long while the voxels were coloured on the page's own thread
        self.assertLess(above(0.25), 30 * idle[len(idle) // 2] + 30)
        # nor is the page's own thread held for long
        self.assertLess(sum(task for task in long if task > 250), 0.3 * elapsed)

    @campaign
    def test_a_slab_is_coarse_while_it_moves_and_sharp_where_it_rests(self):
        # one that takes seconds at full size
        self.page.run("document.getElementById('follow').click()")
        self.slide("#slab-mm", 50)
        self.page.run("const slab = document.getElementById('slab'); slab.value = 'mean'; slab.dispatchEvent(new Event('change'))")
        seen = lambda: numpy.array(self.page.run("""const { width, height } = document.querySelector("#picture-oblique canvas");
            return Array.from({ length: 400 }, (_, n) => palpateViewer.colourAt("oblique", (0.2 + 0.03 * (n % 20)) * width, (0.2 + 0.03 * Math.floor(n / 20)) * height));"""))  # noqa: E731
        step = "document.querySelector('#picture-oblique .stack').dispatchEvent(new WheelEvent('wheel', { deltaY: %d, cancelable: true }));"
        coarse = self.run_async("""let n = 0, coarse = 0;
            const timer = setInterval(() => {
              coarse += !palpateViewer.areSectionsSharp;
              %s
              if (++n < 40) return;
              clearInterval(timer);
              done(coarse);
            }, 50);""" % (step % 1))
        self.assertGreater(coarse, 20)
        # at once, before it is sharp
        moving = seen()
        self.page.wait("palpateViewer.areSectionsSharp")
        resting = seen()
        self.assertGreater((abs(moving - resting) > 2).mean(), 0.01)
        # what was drawn in bands is what is drawn at once
        for way in (1, -1):
            self.page.run(step % way + "palpateViewer.draw()")
        self.assertLessEqual(abs(seen() - resting).max(), 1)

    @campaign
    def test_the_volume_is_drawn_from_every_voxel_where_there_is_room(self):
        # the graphics and the memory are what a script says; it is drawn by what there is
        dims = self.page.run("return palpateViewer.scene.volume.dims")
        self.page.wait("palpateViewer.volumeWork.pictures > 0")
        frugal, coarse = self.page.run("return palpateViewer.volumeTexels"), self.volume_pixels()
        self.assertLessEqual(numpy.prod(frugal), 1.2e6)

        # without a graphics card it is asked for
        self.page.click("#picture-volume details summary")
        self.page.click("#every-voxel")
        self.assertEqual(self.page.run("return palpateViewer.volumeTexels"), dims)
        fine = self.volume_pixels()
        made = self.page.run("return palpateViewer.volumeWork.texels")
        self.assertGreaterEqual(made, numpy.prod(dims))
        self.page.click("#every-voxel")
        self.assertEqual(self.page.run("return palpateViewer.volumeTexels"), frugal)

        for side, memory, expected in ((2048, 8, dims), (128, 8, [-(-n // 2) for n in dims]), (2048, 2, None)):
            spoof = self.page.developer_tools("Page.addScriptToEvaluateOnNewDocument", source="""{
                const honest = WebGL2RenderingContext.prototype.getParameter;
                const says = { 0x9246: "A card", 0x8073: %d };
                WebGL2RenderingContext.prototype.getParameter = function (name) { return says[name] ?? honest.call(this, name); };
                Object.defineProperty(Navigator.prototype, "deviceMemory", { get: () => %d });
            }""" % (side, memory))
            self.open_page()
            self.page.developer_tools("Page.removeScriptToEvaluateOnNewDocument", **spoof)
            texels = self.page.run("return palpateViewer.volumeTexels")
            if expected:
                self.assertEqual(texels, expected)
            else:
                self.assertLessEqual(numpy.prod(texels), 2e6)
            self.assertIsNone(self.page.run("return document.getElementById('every-voxel')"))
            if texels == dims:
                # on a card it is what was asked for, pixel by pixel, and no other volume than the coarse one
                self.assertEqual(abs(self.volume_pixels() - fine).max(), 0)
        is_ground = lambda pixels: abs(pixels - (9, 12, 14)).max(-1) < 4  # noqa: E731
        same = (is_ground(fine) == is_ground(coarse)).mean()
        print(f"  {frugal} texels, {dims} when asked for and on a card; {same:.4f} of the outline agree", flush=True)
        self.assertGreater(same, 0.98)
        self.assertGreater((~is_ground(fine)).mean(), 0.1)
        self.assertGreater((abs(fine - coarse).max(-1) > 2).mean(), 0.01, "finer")


class VolumeWithPointer(PointerSession):
    """The volume of an object that stands still, drawn by the browser."""

    def projected(self, mask, size, mm, rotation=(1, 0, 0, 0)):
        """Which pixels a mask covers, seen by a camera above World looking down: anterior of a patient that is not turned."""
        patient = self.points_of(mask)
        world_from_patient = numpy.array(self.scene["world_from_patient"])
        turn = rotation_matrix(rotation)
        to_world = lambda p: (p @ world_from_patient[:3, :3].T + world_from_patient[:3, 3]) @ turn.T  # noqa: E731
        centre = (numpy.array(self.scene["volume"]["dims"]) - 1) / 2 @ self.patient_from_voxel[:3, :3].T + self.patient_from_voxel[:3, 3]
        focus = to_world(centre[None])[0] if rotation == (1, 0, 0, 0) else self.focus
        seen = numpy.zeros(size, bool)
        # points all over every voxel, so close that no pixel between two of them stays empty
        count = math.ceil(numpy.linalg.norm(self.patient_from_voxel[:3, 0]) / (0.7 * mm))
        for part in numpy.ndindex(count, count, count):
            within = (numpy.array(part) + 0.5) / count - 0.5
            offset = (to_world(patient + self.patient_from_voxel[:3, :3] @ within) - focus)[:, :2]
            x = numpy.floor(offset[:, 0] / mm + size[1] / 2).astype(int)
            y = numpy.floor(size[0] / 2 - offset[:, 1] / mm).astype(int)
            inside = (x >= 0) & (x < size[1]) & (y >= 0) & (y < size[0])
            seen[y[inside], x[inside]] = True
        self.focus = focus
        return seen

    def silhouette(self, size, mm):
        answer = self.page.run("return palpateViewer.silhouette(arguments[0], arguments[1], arguments[2])", size[1], size[0], mm)
        return numpy.array(answer["seen"], bool).reshape(size)

    def assert_overlap(self, seen, expected, least):
        overlap = (seen & expected).sum() / (seen | expected).sum()
        print(f"  intersection over union {overlap:.4f}", flush=True)
        self.assertGreater(expected.sum(), 500)
        self.assertGreaterEqual(overlap, least)

    def test_silhouette_is_the_labels_projection(self):
        size, mm = (340, 340), 0.5
        self.page.click("[data-look=anterior]")
        expected = self.projected(self.labels > 0, size, mm)
        self.assert_overlap(self.silhouette(size, mm), expected, 0.95)

    @campaign
    def test_silhouette_turns_with_the_object(self):
        size, mm = (340, 340), 0.5
        self.page.click("[data-look=anterior]")
        self.projected(self.labels > 0, size, mm)  # the camera looks at where the middle was
        self.page.run("palpateViewer.draw()")
        self.page.click("#turn")
        self.drag("#picture-volume .stack", 60, 45)
        # it has turned when it turns no more
        look = "return [palpateViewer.pose.sequence, ...palpateViewer.pose.rotation]"
        before, now = [], self.page.run(look)
        for _ in range(30):
            if now[1:] == before[1:] and abs(now[1]) < 0.99:
                break
            self.page.wait(f"palpateViewer.pose.sequence > {now[0]} + 20")
            before, now = now, self.page.run(look)
        rotation = tuple(now[1:])
        self.assertLess(abs(rotation[0]), 0.99)
        self.assert_overlap(self.silhouette(size, mm), self.projected(self.labels > 0, size, mm, rotation), 0.95)

    @campaign
    def test_a_turned_object_opens_from_anterior_in_the_middle(self):
        size, mm = (340, 340), 0.5
        self.page.click("#turn")
        self.drag("#picture-volume .stack", 60, 45)
        self.page.wait("palpateViewer.pose.rotation[0] < 0.99")
        self.open_page()
        self.assertLess(self.page.run("palpateViewer.draw(); return palpateViewer.pose.rotation[0]"), 0.99)
        self.assert_overlap(self.silhouette(size, mm), self.projected(self.labels > 0, size, mm), 0.95)

    def test_fibula_of_a_left_knee_is_on_image_right_seen_from_anterior(self):
        self.assertEqual(self.scene["side"], "left")
        self.page.click("[data-look=anterior]")
        for structure in self.scene["structures"]:
            if structure["name"] != "fibula":
                self.page.run("document.querySelector(`[aria-label='Show ${arguments[0]}']`).click()",
                              structure["name"].replace("_", " "))
        self.page.run("palpateViewer.draw()")
        size, mm = (340, 340), 0.5
        seen = self.silhouette(size, mm)
        self.assertGreater(seen.sum(), 100)
        self.assertGreater(numpy.argwhere(seen)[:, 1].mean() * mm, size[1] / 2 * mm + 10)
        label = next(s["label"] for s in self.scene["structures"] if s["name"] == "fibula")
        self.assert_overlap(seen, self.projected(self.labels == label, size, mm), 0.85)  # a slim one: more border

    def section_pixels(self):
        return numpy.array(self.page.run(
            """const out = [];
               palpateViewer.draw();
               const { width, height } = document.querySelector("#picture-oblique canvas");
               for (let y = 0.1; y < 1; y += 0.08) for (let x = 0.3; x < 0.7; x += 0.03) out.push(palpateViewer.colourAt("oblique", x * width, y * height));
               return out;"""))

    def pixels_of_colour(self, pixels, colour):
        """Where a picture has a colour, in whatever light."""
        unit = numpy.array(colour) / numpy.linalg.norm(colour)
        size = numpy.linalg.norm(pixels, axis=2)
        return (size > 60) & (pixels @ unit > 0.98 * size)

    def set_appearance(self, structure, opacity=None, colour=None, toggle=False):
        """As a person sets how a structure looks, in the list."""
        name = structure["name"].replace("_", " ")
        self.page.run(
            """const [name, opacity, colour, toggle] = arguments;
               const set = (kind, value) => {
                 const input = document.querySelector(`[aria-label="${kind} of ${name}"]`);
                 input.value = value;
                 input.dispatchEvent(new Event("input", { bubbles: true }));
               };
               if (opacity !== null) set("Opacity", opacity);
               if (colour !== null) set("Colour", colour);
               if (toggle) document.querySelector(`[aria-label="Show ${name}"]`).click();""", name, opacity, colour, toggle)

    @campaign
    def test_a_picture_that_moves_is_rougher_and_shows_the_same(self):
        self.page.run("palpateViewer.lookFrom(150, 60, false)")
        is_ground = lambda pixels: abs(pixels - (9, 12, 14)).max(-1) < 4  # noqa: E731
        femur = next(one for one in self.scene["structures"] if one["name"] == "femur")
        pictures = []
        # solid, seen through, seen through otherwise, solid again, other voxels
        for opacity in (1, 0.4, 0.7, 1, None):
            if opacity is not None:
                self.set_appearance(femur, opacity=opacity)
            else:
                lo = [n // 4 for n in self.scene["volume"]["dims"]]
                self.page.run("return palpateViewer.fillBox(...arguments)", lo, lo, 0)
            fine, rough = (numpy.frombuffer(base64.b64decode(self.page.run("return palpateViewer.volumePicture(150, 150, 1, arguments[0])", is_fine)), numpy.uint8)
                           .reshape(150, 150, 4)[:, :, :3].astype(int) for is_fine in (True, False))
            off = abs(fine - rough).max(-1)
            print(f"  opacity {opacity}: {(is_ground(fine) == is_ground(rough)).mean():.4f} of the outline the same, {off.mean():.2f} of 255 off, more than 40 off {(off > 40).mean():.4f}", flush=True)
            self.assertGreater((~is_ground(fine)).mean(), 0.1)
            self.assertGreater((is_ground(fine) == is_ground(rough)).mean(), 0.985)
            self.assertLess(off.mean(), 6)
            self.assertLess((off > 40).mean(), 0.03)
            pictures.append(rough)
        for a, b in zip(pictures, pictures[1:]):
            self.assertGreater((abs(a - b).max(-1) > 10).mean(), 0.005, "it has changed")
        self.assertEqual(abs(pictures[0] - pictures[3]).max(), 0)

    @campaign
    def test_a_look_is_looked_up_and_no_voxel_is_made_anew(self):
        self.page.click("[data-look=anterior]")
        femur = next(s for s in self.scene["structures"] if s["name"] == "femur")
        before = self.volume_pixels()
        self.assertTrue(self.page.run("return palpateViewer.isDrawnInWorker"))
        made = self.page.run("return palpateViewer.volumeWork.texels")
        self.assertGreater(made, 1e5)
        self.set_appearance(femur, colour="#00ff00")
        green = self.volume_pixels()
        changed = abs(green - before).max(2) > 40
        self.assertGreater(changed.sum(), 500)
        self.assertGreater(self.pixels_of_colour(green, (0, 255, 0))[changed].mean(), 0.9)
        # through half of it what lies behind is seen, or the ground
        self.set_appearance(femur, opacity=0.5)
        thin = self.volume_pixels()
        whole = self.pixels_of_colour(green, (0, 255, 0))
        self.assertGreater((abs(thin - green).max(2)[whole] > 10).mean(), 0.7)
        self.assertGreater(thin[whole][:, 1].mean(), 60, "and it is still there")
        self.set_appearance(femur, toggle=True)
        hidden = self.volume_pixels()
        self.assertLess(self.pixels_of_colour(hidden, (0, 255, 0)).sum(), 0.01 * whole.sum())
        self.assertEqual(self.page.run("return palpateViewer.volumeWork.texels"), made)
        opacity = self.scene["tissues"][femur["tissue"]]["opacity"]
        self.set_appearance(femur, opacity=opacity, colour="#%02x%02x%02x" % tuple(femur["colour"]), toggle=True)
        self.assertEqual(abs(self.volume_pixels() - before).max(), 0)

    def coverage(self, mask):
        """Mask smoothed by [1 2 1] / 4 along each axis, padded by one voxel of zeros."""
        share = mask.astype(float)
        for axis in range(3):
            padded = numpy.pad(share, [(1, 1) if a == axis else (0, 0) for a in range(3)], mode="edge")
            part = lambda begin: numpy.take(padded, range(begin, begin + share.shape[axis]), axis)  # noqa: E731
            share = (part(0) + 2 * part(1) + part(2)) / 4
        return numpy.pad(share, 1)

    def first_met(self, shares, eye, rays, nearest):
        """
        Label fractions at the first surface along each ray (total coverage 0.45), all 0 for rays that hit nothing.
        `eye` is one origin or one per ray.
        shares: of each label, by `coverage`; linear between the middles of voxels
        """
        voxel_from_patient = numpy.linalg.inv(self.patient_from_voxel)
        step = 0.15 * numpy.linalg.norm(self.patient_from_voxel[:3, :3], axis=0).min()
        covered = sum(shares.values())
        # of the eight voxels that a place lies between: few places need to be looked at closely
        largest = covered
        for axis in range(3):
            largest = numpy.maximum(largest, numpy.roll(largest, -1, axis))
        eye = numpy.broadcast_to(eye, rays.shape)
        met = numpy.zeros((len(rays), len(shares)))
        alive = numpy.arange(len(rays))
        for way in numpy.arange(nearest, numpy.linalg.norm(self.patient_from_voxel[:3, :3] @ self.labels.shape), step):
            at = (eye[alive] + way * rays[alive]) @ voxel_from_patient[:3, :3].T + voxel_from_patient[:3, 3] + 1
            inside = ((at >= 0) & (at < numpy.array(covered.shape) - 1)).all(1)
            low = numpy.floor(numpy.where(inside[:, None], at, 0)).astype(int)
            within = at - low

            def linear(field, which):
                return sum(numpy.prod(numpy.where(corner, within[which], 1 - within[which]), 1) * field[tuple((low[which] + corner).T)]
                           for corner in map(numpy.array, numpy.ndindex(2, 2, 2)))

            hit = inside & (largest[tuple(low.T)] >= 0.45)
            hit[hit] = linear(covered, hit) >= 0.45
            if hit.any():
                met[alive[hit]] = numpy.transpose([linear(field, hit) for field in shares.values()])
            alive = alive[~hit]
        return met

    def assign_distinct_colours(self):
        """Assigns colours that remain distinguishable under shading. @returns a function of (pixels, label fractions):
        share of pixels whose colour agrees"""
        structures = self.scene["structures"]
        palette = []
        for n, structure in enumerate(structures):
            hue = 6 * n / len(structures)
            palette.append(numpy.clip([abs(hue - 3) - 1, 2 - abs(hue - 2), 2 - abs(hue - 4)], 0, 1))
            self.set_appearance(structure, opacity=1, colour="#%02x%02x%02x" % tuple((255 * palette[-1]).astype(int)))

        def agree(pixels, met):
            expected = met @ numpy.array(palette)
            is_ground = abs(pixels - (9, 12, 14)).max(1) < 4
            along = (pixels * expected).sum(1) / (numpy.linalg.norm(pixels, axis=1) * numpy.linalg.norm(expected, axis=1) + 1e-9)
            # 14 degrees, of 90 between two colours
            return numpy.where(met.sum(1) == 0, is_ground, ~is_ground & (along > 0.97)).mean()
        return agree

    def lead_to_the_open_middle(self):
        """The tip, to the place nearest to the volume's middle that has room around it."""
        clear = self.labels == 0
        for axis, by in ((axis, by) for axis in range(3) for by in (-6, -3, 3, 6)):
            clear &= numpy.roll(self.labels == 0, by, axis)
        points = self.points_of(clear)
        middle = points[numpy.linalg.norm(points - points.mean(0), axis=1).argsort()[0]]
        self.take_hand()
        self.come_to(middle.tolist())
        return middle

    @campaign
    def test_the_scope_sees_what_an_independent_ray_meets(self):
        structures = self.scene["structures"]
        agree = self.assign_distinct_colours()
        free = self.points_of(self.labels == 0)
        shares = {s["label"]: self.coverage(self.labels == s["label"]) for s in structures}
        solid = self.points_of(self.labels > 0)
        generator = random.Random(test_seed())
        size, tangent = 72, math.tan(math.radians(40))
        at = (numpy.arange(size) + 0.5) * 2 / size - 1
        x, y = (part.ravel() for part in numpy.meshgrid(at, at))
        disc = numpy.hypot(x, y) < 0.97
        agreed = []
        while len(agreed) < 5:
            # in the open, near to something, and towards it
            eye = free[generator.randrange(len(free))]
            towards = solid[generator.randrange(len(solid))] - eye
            away = numpy.sqrt(((solid - eye) ** 2).sum(1).min())
            if not 2 < away < 15:
                continue
            forward = towards / numpy.linalg.norm(towards)
            right = numpy.cross(forward, (0.3, 0.2, 1))
            right /= numpy.linalg.norm(right)
            up = numpy.cross(right, forward)
            frame = {"eye": eye.tolist(), "forward": forward.tolist(), "right": right.tolist(), "up": up.tolist()}
            data = base64.b64decode(self.page.run("return palpateViewer.scopePicture(arguments[0], arguments[1])", frame, size))
            pixels = numpy.frombuffer(data, numpy.uint8).reshape(-1, 4)[:, :3].astype(float)
            rays = forward + numpy.outer(x * tangent, right) - numpy.outer(y * tangent, up)
            rays /= numpy.linalg.norm(rays, axis=1)[:, None]
            met = self.first_met(shares, eye, rays[disc], 0.5)
            agreed.append(agree(pixels[disc], met))
            self.assertGreater(len(set(zip(met.any(1), met.argmax(1)))), 1, "more than one thing is seen")
            # outside of the round field there is nothing
            self.assertEqual(abs(pixels[numpy.hypot(x, y) > 1.03] - (9, 12, 14)).max(), 0)
        print("  of the pixels agree " + ", ".join(f"{share:.4f}" for share in agreed), flush=True)
        self.assertGreaterEqual(min(agreed), 0.95)

    @campaign
    def test_what_is_cut_away_at_the_tip_shows_what_lies_behind(self):
        agree = self.assign_distinct_colours()
        shares = {s["label"]: self.coverage(self.labels == s["label"]) for s in self.scene["structures"]}
        tip = self.lead_to_the_open_middle()
        size = 48
        at = numpy.arange(size) + 0.5 - size / 2
        x, y = (part.ravel() for part in numpy.meshgrid(at, at))
        choose = ("for (const [id, value] of Object.entries(arguments[0])) { const one = document.getElementById(id); one.type === 'checkbox' ? one.checked = value : one.value = value;"
                  "one.dispatchEvent(new Event('change')); } palpateViewer.draw();")
        mm = numpy.linalg.norm(numpy.subtract(*self.page.run("return [0, 1].map((x) => palpateViewer.volumeRay(x, 0).from)")))
        seen = {}
        for cutting, is_perspective in (("none", False), ("plane", False), ("hole", False), ("hole", True), ("none", True)):
            self.page.run(choose, {"cutting": cutting, "perspective": is_perspective})
            rays = self.page.run("return arguments[0].map((x, n) => palpateViewer.volumeRay(x, arguments[1][n]))", x.tolist(), y.tolist())
            begin, into = (numpy.array([ray[part] for ray in rays]) for part in ("from", "into"))
            data = base64.b64decode(self.page.run("return palpateViewer.volumePicture(arguments[0], arguments[0], arguments[1])", size, mm))
            pixels = numpy.frombuffer(data, numpy.uint8).reshape(-1, 4)[:, :3].astype(float)
            towards = (tip - begin[0]) / numpy.linalg.norm(tip - begin[0]) if is_perspective else into[0]
            # of places on each ray, from before the volume to behind the tip, the last that is taken away
            ways = (tip - begin[0]) @ towards + numpy.arange(-150, 30, 0.2)
            off = begin[:, None] + ways[:, None] * into[:, None] - tip
            height = -off @ towards
            aside = numpy.linalg.norm(off + height[..., None] * towards, axis=2)
            gone = (height > 0) & {"none": aside < 0, "plane": aside >= 0, "hole": aside < 8 + 0.4 * height}[cutting]
            start = numpy.where(gone.any(1), ways[gone.shape[1] - 1 - gone[:, ::-1].argmax(1)], ways[0])
            seen[cutting, is_perspective] = pixels
            share = agree(pixels, self.first_met(shares, begin + start[:, None] * into, into, 0))
            print(f"  {cutting}{', perspective' if is_perspective else ''}: {share:.4f} of the pixels agree", flush=True)
            self.assertGreaterEqual(share, 0.95)
        # each of them shows something else; what is near the middle is hardly moved by perspective
        for a, b, least in ((("none", False), ("plane", False), 0.02), (("none", False), ("hole", False), 0.02),
                            (("none", True), ("hole", True), 0.02), (("none", False), ("none", True), 0.003)):
            self.assertGreater((abs(seen[a] - seen[b]).max(1) > 30).mean(), least, (a, b))

    @campaign
    def test_the_scope_stands_at_the_tip_and_is_moved_by_keys(self):
        stack = "document.querySelector('#picture-scope .stack')"
        key = stack + ".dispatchEvent(new KeyboardEvent('keydown', { key: arguments[0], bubbles: true })); palpateViewer.draw(); return palpateViewer.scopeFrame"
        degrees = lambda a, b: math.degrees(math.acos(min(1, numpy.dot(a, b))))  # noqa: E731
        self.lead_to_the_open_middle()
        self.page.click("[data-layout=inside]")
        self.page.wait("document.querySelector('#picture-scope canvas')?.width > 50")
        # of two pictures that get sharp at rest neither ends the other
        self.page.wait("palpateViewer.isVolumeSharp && palpateViewer.isScopeSharp", 60)
        back = "const back = document.querySelector('#picture-scope select'); back.value = arguments[0]; back.dispatchEvent(new Event('change'));"
        at = self.page.run("return [palpateViewer.scopeFrame, palpateViewer.pose.devices[0]]")
        self.assertAlmostEqual(numpy.linalg.norm(numpy.subtract(at[0]["eye"], at[1]["tip"])), 8, 3)
        self.page.run(back, "0")
        at = self.page.run("return [palpateViewer.scopeFrame, palpateViewer.pose.devices[0]]")
        self.assertLess(numpy.linalg.norm(numpy.subtract(at[0]["eye"], at[1]["tip"])), 1e-3)
        # the tool's shaft goes up from the tip: away from it, and 30 degrees beside
        shaft = numpy.array(self.scene["world_from_patient"])[:3, :3].T @ rotation_matrix(at[1]["orientation"])[:, 2]
        self.assertAlmostEqual(degrees(at[0]["forward"], -shaft), 30, 2)
        turned = self.page.run(key, ".")
        self.assertAlmostEqual(degrees(turned["forward"], -shaft), 30, 2)
        self.assertGreater(degrees(turned["forward"], at[0]["forward"]), 5)
        self.page.run(key, ",")
        for angle in (70, 0):
            self.page.run("const optics = document.querySelectorAll('#picture-scope select')[1]; optics.value = arguments[0];"
                          "optics.dispatchEvent(new Event('change'))", str(angle))
            straight = self.page.run("return palpateViewer.scopeFrame")
            self.assertAlmostEqual(degrees(straight["forward"], -shaft), angle, 2)
        # behind the tip the camera is on the shaft
        self.page.run(back, "15")
        behind = self.page.run("return palpateViewer.scopeFrame")
        self.assertLess(numpy.linalg.norm(numpy.subtract(behind["eye"], straight["eye"]) - 15 * shaft), 1e-3)
        self.assertEqual(behind["forward"], straight["forward"])
        self.page.run(back, "0")
        # ahead by a millimetre, and to the right
        ahead = self.page.run(key, "+")
        self.assertLess(numpy.linalg.norm(numpy.subtract(ahead["eye"], straight["eye"]) - straight["forward"]), 1e-6)
        aside = self.page.run(key, "ArrowRight")
        self.assertAlmostEqual(degrees(aside["forward"], straight["forward"]), 5, 4)
        self.assertGreater(numpy.dot(aside["forward"], straight["right"]), 0)
        self.assertEqual(self.page.run(key, "Home"), straight)
        # within a solid it says so in words
        place = next(n for n, s in enumerate(self.scene["structures"]) if s["name"] == "lateral_meniscus")
        lo = numpy.round(numpy.linalg.inv(self.patient_from_voxel) @ [*straight["eye"], 1])[:3].astype(int) - 4
        size = numpy.minimum(9, self.labels.shape - lo) + numpy.minimum(lo, 0)
        lo = numpy.maximum(lo, 0)
        words = "palpateViewer.scopeWords"
        self.page.wait(f"(palpateViewer.draw(), {words} !== '' && !{words}.includes('inside'))")
        self.page.run("return palpateViewer.fillBox(arguments[0], arguments[1], arguments[2])", lo.tolist(), size.tolist(), place)
        self.page.wait(f"(palpateViewer.draw(), {words} === 'inside lateral meniscus: nothing to see')")
        self.page.run("return palpateViewer.fillBox(arguments[0], arguments[1], -1)", lo.tolist(), size.tolist())
        self.page.wait(f"(palpateViewer.draw(), !{words}.includes('inside'))")

    @campaign
    def test_the_scope_stands_off_what_the_shaft_goes_through(self):
        agree = self.assign_distinct_colours()
        shares = {s["label"]: self.coverage(self.labels == s["label"]) for s in self.scene["structures"]}
        shaft = numpy.array(self.scene["world_from_patient"])[:3, :3].T @ [0, 0, 1]
        voxel_from_patient = numpy.linalg.inv(self.patient_from_voxel)

        def label_at(p):
            voxel = numpy.round((voxel_from_patient @ [*p, 1])[:3]).astype(int)
            return self.labels[tuple(voxel)] if (voxel >= 0).all() and (voxel < self.labels.shape).all() else 0
        places = []
        for name, count in (("patella", 2), ("femur", 1), ("tibia", 1)):
            label = next(s["label"] for s in self.scene["structures"] if s["name"] == name)
            ways = self.approaches(label, 40, random.Random(test_seed()))
            through = [way for way in ways if all(label_at(way[1] + off * shaft) for off in (5.5, 7, 8, 9, 10.5))]
            self.assertGreater(len(through), 0, name)
            places += [(label, *way) for way in through[:count]]
        self.take_hand()
        self.page.click("[data-layout=inside]")
        self.page.wait("document.querySelector('#picture-scope canvas')?.width > 50")
        size, tangent = 48, math.tan(math.radians(40))
        at = (numpy.arange(size) + 0.5) * 2 / size - 1
        x, y = (part.ravel() for part in numpy.meshgrid(at, at))
        disc = numpy.hypot(x, y) < 0.97
        words = "palpateViewer.scopeWords"
        agreed = []
        for label, start, end in places:
            self.press_on(label, start, end)
            frame, device = self.page.run("return [palpateViewer.scopeFrame, palpateViewer.pose.devices[0]]")
            off = numpy.subtract(frame["eye"], device["proxy"])
            self.assertTrue(0 < numpy.linalg.norm(off) < 8.001, frame)
            self.assertGreater(numpy.dot(off, device["normal"]), 0.999 * numpy.linalg.norm(off))
            self.assertEqual(label_at(frame["eye"]), 0)
            forward, right, up = (numpy.array(frame[axis]) for axis in ("forward", "right", "up"))
            data = base64.b64decode(self.page.run("return palpateViewer.scopePicture(arguments[0], arguments[1])", frame, size))
            pixels = numpy.frombuffer(data, numpy.uint8).reshape(-1, 4)[:, :3].astype(float)
            rays = forward + numpy.outer(x * tangent, right) - numpy.outer(y * tangent, up)
            rays /= numpy.linalg.norm(rays, axis=1)[:, None]
            agreed.append(agree(pixels[disc], self.first_met(shares, frame["eye"], rays[disc], 0.5)))
            self.page.wait(f"(palpateViewer.draw(), {words}.includes('from the touched surface'))")
        print("  of the pixels agree " + ", ".join(f"{share:.4f}" for share in agreed), flush=True)
        self.assertGreaterEqual(min(agreed), 0.95)
        # where there is nothing but something solid as far as it may stand off, it says so
        lo = numpy.maximum(0, numpy.round((voxel_from_patient @ [*frame["eye"], 1])[:3]).astype(int) - 20)
        size = numpy.minimum(41, self.labels.shape - lo)
        self.page.run("return palpateViewer.fillBox(arguments[0], arguments[1], 0)", lo.tolist(), size.tolist())
        self.page.wait(f"(palpateViewer.draw(), {words}.includes('nothing to see'))")

    @campaign
    def test_where_a_worker_cannot_draw_the_page_does(self):
        self.page.click("[data-look=anterior]")
        in_worker = self.volume_pixels()
        fake = self.page.developer_tools("Page.addScriptToEvaluateOnNewDocument", source="""
            window.Worker = class {
              set onmessage(listener) { setTimeout(() => listener({ data: { type: "unable", why: "no WebGL 2" } })); }
              postMessage() {}
              terminate() {}
            };""")
        try:
            self.open_page()
        finally:
            self.page.developer_tools("Page.removeScriptToEvaluateOnNewDocument", identifier=fake["identifier"])
        self.page.run("palpateViewer.draw()")
        self.page.click("[data-look=anterior]")
        self.assertEqual(abs(self.volume_pixels() - in_worker).max(), 0)
        self.assertFalse(self.page.run("return palpateViewer.isDrawnInWorker"))

    @campaign
    def test_a_box_of_voxels_changes_where_it_is_and_nowhere_else(self):
        width, height, mm = self.PICTURE
        self.page.click("[data-look=anterior]")
        dims = self.scene["volume"]["dims"]
        others = self.volume_pixels()
        made = self.page.run("return palpateViewer.volumeWork.texels")
        # in front of everything, to the patient's right of the middle: on picture left
        lo, size = [round(0.12 * dims[0]), 2, round(0.72 * dims[2])], [14, 5, 11]
        place = next(n for n, s in enumerate(self.scene["structures"]) if s["name"] == "lateral_meniscus")
        self.set_appearance(self.scene["structures"][place], colour="#ff00ff")
        self.page.run("return palpateViewer.fillBox(arguments[0], arguments[1], arguments[2])", lo, size, place)
        box = numpy.zeros(dims, bool)
        box[lo[0]:lo[0] + size[0], lo[1]:lo[1] + size[1], lo[2]:lo[2] + size[2]] = True
        with_box = self.volume_pixels()
        # no structure is in front of it, so that the whole of it is seen
        self.page.run("palpateViewer.draw()")
        self.projected(self.labels > 0, (height, width), mm)
        expected = self.projected(box, (height, width), mm, (1, 0, 0, 1e-12))
        seen = self.pixels_of_colour(with_box, (255, 0, 255)) & ~self.pixels_of_colour(others, (255, 0, 255))
        # the structure itself has that colour, too
        near = expected | self.projected(self.labels == self.scene["structures"][place]["label"], (height, width), mm, (1, 0, 0, 1e-12))
        for shift, axis in ((1, 0), (-1, 0), (1, 1), (-1, 1)) * 2:
            near |= numpy.roll(near, shift, axis)
        self.assertGreater((seen & expected).sum(), 0.8 * expected.sum())
        self.assertLess((seen & ~near).sum(), 3)
        some = self.page.run("return palpateViewer.volumeWork.texels") - made
        self.assertGreater(some, 0)
        self.assertLess(some, 0.02 * numpy.prod(dims))
        # gone again, everything is as it was
        self.page.run("return palpateViewer.fillBox(arguments[0], arguments[1], -1)", lo, size)
        self.set_appearance(self.scene["structures"][place], colour="#%02x%02x%02x" % tuple(self.scene["structures"][place]["colour"]))
        self.assertEqual(abs(self.volume_pixels() - others).max(), 0)

    @campaign
    def test_lost_graphics_are_reported_and_restored(self):
        note = "document.getElementById('graphics')"
        self.resting_plane()
        section = self.section_pixels()
        self.assertGreater(section.max(), 100)
        volume = self.volume_pixels()
        lost = time.monotonic()
        self.page.run("palpateViewer.loseGraphics('sections', false); palpateViewer.loseGraphics('volume', false)")
        self.page.wait(f"!{note}.hidden && {note}.textContent.includes('the sections and the volume cannot be drawn')")
        said_ms = 1e3 * (time.monotonic() - lost)
        self.assertIn("by themselves", self.page.run(f"return {note}.textContent"))
        self.assertIn("emergency stop", self.page.run(f"return {note}.textContent"))
        # no old picture stands where the tip moves on
        self.assertLess(self.section_pixels().max(), 20)
        self.page.wait(f"{note}.textContent.includes('Reload this page')")
        # the sections come first, whatever came back first
        self.page.run("palpateViewer.loseGraphics('volume', true)")
        time.sleep(0.3)
        self.assertIn("the sections and the volume", self.page.run(f"return {note}.textContent"))
        lost = time.monotonic()
        self.page.run("palpateViewer.loseGraphics('sections', true)")
        self.page.wait(f"{note}.hidden")
        self.assertEqual(abs(self.section_pixels() - section).max(), 0)
        sections_ms = 1e3 * (time.monotonic() - lost)
        self.assertEqual(abs(self.volume_pixels() - volume).max(), 0)
        print(f"  lost graphics said within {said_ms:.0f} ms, sections back within {sections_ms:.0f}, the volume within {1e3 * (time.monotonic() - lost):.0f}", flush=True)
        # and one alone
        self.page.run("palpateViewer.loseGraphics('volume', false)")
        self.page.wait(f"!{note}.hidden && {note}.textContent.includes('the volume cannot be drawn')")
        self.assertEqual(abs(self.section_pixels() - section).max(), 0)
        self.page.run("palpateViewer.loseGraphics('volume', true)")
        self.page.wait(f"{note}.hidden")
        self.assertEqual(abs(self.volume_pixels() - volume).max(), 0)


if __name__ == "__main__":
    viewer_page.main(sys.argv[1:], sys.modules["__main__"])
