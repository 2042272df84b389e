"""Moving the tip and touching in the viewer page: by mouse, fingers and keys, by the simulated hand and by a device.

usage: contact_test.py [--campaigns] palpate PALPATE [TEST ...]
       contact_test.py [--campaigns] mock NODE MOCK_SERVER PAGE_FOLDER [TEST ...]

viewer_test.py explains the arguments and runs these tests with those of the other scripts in one browser.
"""

import base64
import json
import os
import random
import struct
import sys
import tempfile
import time

sys.dont_write_bytecode = True  # nothing is left in the source tree
import viewer_page  # noqa: E402
from pointer_session import PointerSession  # noqa: E402
from viewer_page import INSIDE, POSITIONS, SIZE, STRUCTURES, Server, Viewer, campaign, decode_png, numpy, speak, test_seed  # noqa: E402


class WithHand(Viewer):
    """The simulated hand moves."""

    limits_frame_rate = False

    def setUp(self):
        self.serve("script")
        super().setUp()

    @classmethod
    def setUpClass(cls):
        cls.open_browser()

    def test_tip_moves_with_the_hand_and_the_section_follows(self):
        places = []
        for _ in range(8):
            time.sleep(0.4)
            if places:
                self.page.wait(f"palpateViewer.pose.sequence > {places[-1][0]}")
            sample = self.page.run("palpateViewer.draw(); const tip = palpateViewer.pose.devices[0].tip;"
                                   "return [palpateViewer.pose.sequence, ...tip, palpateViewer.pixelOf('oblique', tip).off_mm]")
            places.append(sample)
            self.assertLess(sample[4], 0.05)
        self.assertTrue(all(a[0] < b[0] for a, b in zip(places, places[1:])))
        self.assertGreater(numpy.ptp(numpy.array(places)[:, 1:4], axis=0).max(), 2)


class WithFinger(Viewer):
    """The mock's pointer, which fingers press on."""

    uses_mock = True

    @classmethod
    def setUpClass(cls):
        cls.server = Server("pointer").__enter__()
        cls.addClassCleanup(cls.server.__exit__)
        cls.open_browser(own=True)

    def touch(self, kind, *points):
        self.page.developer_tools("Input.dispatchTouchEvent", type="touch" + kind, touchPoints=[{"x": x, "y": y, "id": n} for n, (x, y) in enumerate(points)])

    def tip(self):
        # of a pose that came after what was done before
        self.page.run("window.sequence = palpateViewer.pose.sequence")
        self.page.wait("palpateViewer.pose.sequence > window.sequence + 15")
        return self.page.run("return palpateViewer.pose.devices[0].tip")

    def test_two_fingers_zoom_and_one_moves_the_tip(self):
        self.page.wait("palpateViewer.state.pointer")
        before = self.tip()
        scale = "const at = (x) => palpateViewer.patientAt('oblique', x, 0); return Math.hypot(...at(1).map((x, c) => x - at(0)[c]))"
        centre = "palpateViewer.draw(); const c = document.querySelector('#picture-oblique canvas'); return palpateViewer.patientAt('oblique', c.width / 2, c.height / 2)"
        for name in ("oblique", "volume"):
            left, top, width, height = self.box(f"#picture-{name} .stack")
            x, y = round(left + 0.3 * width), round(top + 0.3 * height)
            mm, middle = self.page.run(scale), self.page.run(centre)
            self.touch("Start", (x, y), (x + 40, y))
            for apart in range(45, 145, 10):
                self.touch("Move", (x, y), (x + apart, y))
            if name == "oblique":
                self.page.run("palpateViewer.draw()")
                self.assertLess(self.page.run(scale), 0.5 * mm)
                # one finger rests: the middle has gone by half of the other's way, and no farther after a tip that is out of the picture now
                self.assertLess(numpy.linalg.norm(numpy.subtract(self.page.run(centre), middle)), 52 * mm)
            self.assertEqual(self.tip(), before)
            self.touch("Move", (x, y + 60), (x + 140, y))
            self.touch("End")
            self.assertEqual(self.tip(), before)
        # one finger moves it, and no plane below itself
        self.page.run("document.querySelector('#picture-oblique .stack').dispatchEvent(new KeyboardEvent('keydown', { key: 'Home' }));"
                      "document.querySelector('#picture-oblique .stack').dispatchEvent(new WheelEvent('wheel', { deltaY: 120, cancelable: true }));"
                      "palpateViewer.draw()")
        left, top, width, height = self.box("#picture-oblique .stack")
        x, y = round(left + 0.03 * width), round(top + 0.6 * height)
        plane = self.page.run("palpateViewer.draw(); return palpateViewer.plane('oblique')")
        wanted = self.page.run("return palpateViewer.patientAt('oblique', arguments[0], arguments[1])", x - left, y - top)
        self.touch("Start", (x, y))
        self.page.wait("Math.hypot(...palpateViewer.pose.devices[0].tip.map((x, i) => x - %s[i])) < 0.01" % json.dumps(wanted))
        held = self.page.run("palpateViewer.draw(); return palpateViewer.plane('oblique')")
        self.assertLess(numpy.linalg.norm(numpy.subtract(held["centre"], plane["centre"])), 1e-3)
        # a second one ends the hold, whatever it does then
        self.touch("Start", (x, y), (x + 60, y))
        for way in range(10):
            self.touch("Move", (x, y), (x + 60 + 10 * way, y + 10 * way))
        self.page.wait("(palpateViewer.pose.devices[0].flags & 512) !== 0")
        self.touch("End")
        self.assertLess(numpy.linalg.norm(numpy.subtract(self.tip(), wanted)), 0.01)
        self.page.wait("(palpateViewer.draw(), document.getElementById('flags').textContent.includes('hold the mouse button'))")

    @campaign
    def test_a_second_finger_on_the_slider_leads_the_tip_deeper(self):
        self.page.wait("palpateViewer.state.pointer")
        left, top, width, height = self.box("#picture-oblique .stack")
        hold = (round(left + 0.3 * width), round(top + 0.6 * height))
        held = self.page.run("palpateViewer.draw(); return palpateViewer.patientAt('oblique', arguments[0], arguments[1])",
                             hold[0] - left, hold[1] - top)
        left, top, width, height = self.box("#picture-oblique .track")
        slide = lambda part: (round(left + width / 2), round(top + part * height))  # noqa: E731
        self.touch("Start", hold)
        self.page.wait("(palpateViewer.pose.devices[0].flags & 512) === 0")
        # the hold is heard before the tip has come there
        self.page.wait("Math.hypot(...palpateViewer.pose.devices[0].tip.map((x, i) => x - %s[i])) < 0.01" % json.dumps(held))
        before, normal = self.tip(), self.page.run("palpateViewer.draw(); return palpateViewer.plane('oblique').normal")
        at = self.page.run("const s = document.querySelector('#picture-oblique .slices input'); return (s.value - 1) / (s.max - 1)")
        self.touch("Start", hold, slide(at))
        for part in (0.05, 0.1, 0.15):
            self.touch("Move", hold, slide(at + part))
        self.page.wait("palpateViewer.pose.devices[0].tip.reduce((sum, x, i) => sum + (x - %s[i]) * %s[i], 0) > 10" % (json.dumps(before), json.dumps(normal)))
        self.touch("End")
        way = numpy.subtract(self.tip(), before)
        # straight through the picture, and no plane was taken away from the tip
        self.assertLess(numpy.linalg.norm(way - numpy.dot(way, normal) * numpy.array(normal)), 0.05)
        self.assertEqual(self.page.run("return document.getElementById('follow').getAttribute('aria-pressed')"), "true")
        # without a hold the same finger goes through the slices
        self.touch("Start", slide(0.5))
        self.touch("Move", slide(0.2))
        self.touch("End")
        self.assertEqual(self.page.run("palpateViewer.draw(); return document.getElementById('follow').getAttribute('aria-pressed')"), "false")
        self.assertLess(self.page.run("const s = document.querySelector('#picture-oblique .slices input'); return (s.value - 1) / (s.max - 1)"), 0.25)

    @campaign
    def test_a_key_moves_the_tip_by_what_is_seen(self):
        self.page.wait("palpateViewer.state.pointer")
        key = "document.querySelector('#picture-oblique .stack').dispatchEvent(new KeyboardEvent(arguments[0], { key: arguments[1], bubbles: true }))"
        for _ in range(3):
            pixel = self.page.run("palpateViewer.draw(); const at = (x) => palpateViewer.patientAt('oblique', x, 0); return Math.hypot(...at(1).map((x, c) => x - at(0)[c]))")
            before = self.tip()
            self.page.run(key, "keydown", "ArrowRight")
            self.page.wait("Math.hypot(...palpateViewer.pose.devices[0].tip.map((x, i) => x - %s[i])) > 1e-6" % json.dumps(before))
            after = self.tip()
            self.page.run(key, "keyup", "ArrowRight")
            self.assertAlmostEqual(numpy.linalg.norm(numpy.subtract(after, before)), 2 * pixel, 4)
            self.page.run("for (let n = 0; n < 6; n++) document.querySelector('#picture-oblique .stack').dispatchEvent(new KeyboardEvent('keydown', { key: '+' }))")

    def voxels(self):
        scene = self.server.scene()
        labels, patient_from_voxel = self.server.labels(scene)
        to_voxel = numpy.linalg.inv(patient_from_voxel)

        def label_at(points):
            voxel = numpy.round(points @ to_voxel[:3, :3].T + to_voxel[:3, 3]).astype(int)
            inside = ((voxel >= 0) & (voxel < labels.shape)).all(1)
            return numpy.where(inside, labels[tuple(numpy.where(inside[:, None], voxel, 0).T)], 0)
        return scene, label_at

    def ray_at(self, x, y):
        """Of a pixel of the volume's picture: where its line begins, far in front of all, and where it goes."""
        return [numpy.array(part) for part in self.page.run(
            "const { from, into } = palpateViewer.volumeRay(arguments[0], arguments[1]); return [from.map((v, i) => v - 300 * into[i]), into]", x, y)]

    @campaign
    def test_the_tool_is_dashed_where_something_is_in_front_of_it(self):
        _, label_at = self.voxels()
        self.let_another_viewer_lead()
        generator = random.Random(test_seed())
        hit = {True: 0, False: 0}
        for is_perspective in (False, True):
            # from somewhere where every one of them is in the picture
            self.page.run("palpateViewer.lookFrom(arguments[0], arguments[1], arguments[2])", 60, 25, is_perspective)
            self.page.run("palpateViewer.draw()")
            self.page.wait("palpateViewer.isVolumeSharp")
            before = dict(hit)
            while min(hit[key] - before[key] for key in hit) < 13:
                p = numpy.array([generator.uniform(-45, 45), generator.uniform(-45, 45), generator.uniform(-40, 50)])
                around = p + numpy.argwhere(numpy.ones((9, 9, 9))) - 4
                if label_at(around).any():
                    continue
                start, into = self.ray_at(*self.page.run("return palpateViewer.project(arguments[0])", p.tolist()))
                far = numpy.linalg.norm(p - start)
                # by its own way to the viewer and those 3 mm beside it: where they differ, it is at an edge
                aside = numpy.linalg.svd(into[None])[2][1:]
                ways = start + numpy.arange(far - 250, far - 4, 0.3)[:, None] * into
                hidden = [label_at(ways + 3 * (a * aside[0] + b * aside[1])).any() for a in (-1, 0, 1) for b in (-1, 0, 1)]
                if min(hidden) != max(hidden) or hit[hidden[0]] - before[hidden[0]] >= 13:
                    continue
                self.page.run("window.lead(arguments[0])", p.tolist())
                self.page.wait("Math.hypot(...palpateViewer.pose.devices[0].tip.map((x, i) => x - %s[i])) < 0.01" % json.dumps(p.tolist()))
                drawn = self.page.run("palpateViewer.draw(); return palpateViewer.drawnAround(5)")
                # the ring's gaps show the darker one beneath it, which is half clear
                self.assertEqual(min(drawn) < 200, hidden[0], (p, drawn))
                hit[hidden[0]] += 1
        print(f"  {hit[True]} behind something, {hit[False]} in front", flush=True)

    @campaign
    def test_a_press_touches_the_first_surface_under_it(self):
        scene, label_at = self.voxels()
        self.page.wait("palpateViewer.state.pointer")
        generator = random.Random(test_seed())
        left, top, width, height = self.box("#picture-volume .stack")
        felt = {s["label"] for s in scene["structures"] if scene["tissues"][s["tissue"]]["touchable"]}
        self.assertEqual(len(felt), len(scene["structures"]))
        self.page.click("#follow")
        self.page.wait("document.getElementById('follow').getAttribute('aria-pressed') === 'false'")
        met = set()
        pressed = 0
        while pressed < 8:
            is_perspective = pressed % 2 == 1
            self.page.run("palpateViewer.lookFrom(arguments[0], arguments[1], arguments[2]); palpateViewer.draw()", 80 * pressed, 20, is_perspective)
            x, y = round(left + generator.uniform(0.3, 0.7) * width), round(top + generator.uniform(0.2, 0.8) * height)
            start, into = self.ray_at(x - left - width / 2, y - top - height / 2)
            ways = start + numpy.arange(0, 1600, 0.05)[:, None] * into
            labels = label_at(ways)
            first = int(numpy.argmax(labels > 0))
            # not beside something, or through its edge
            if labels[first] == 0 or len(set(labels[first:first + 20])) > 1:
                continue
            self.page.pointer({"type": "pointerMove", "x": x, "y": y}, {"type": "pointerDown", "button": 0})
            there = ways[first]
            self.page.wait("Math.hypot(...palpateViewer.pose.devices[0].proxy.map((x, i) => x - %s[i])) < 2 && Math.abs(Math.hypot(...palpateViewer.pose.devices[0].force) - 1) < 0.3" % json.dumps(there.tolist()))
            touched = self.page.run("return palpateViewer.pose.devices[0].label")
            self.assertEqual(touched, labels[first])
            # and the planes go there
            tip = self.tip()
            self.page.wait("(palpateViewer.draw(), palpateViewer.pixelOf('oblique', %s).off_mm < 0.5)" % json.dumps(tip))
            self.page.pointer({"type": "pointerUp", "button": 0})
            met.add(labels[first])
            pressed += 1
        self.assertGreater(len(met), 2)


class WithDevice(Viewer):
    """A physical device, of which somebody agrees to everything after a while: the mock's."""

    uses_mock = True
    limits_frame_rate = False

    def setUp(self):
        self.serve("device")
        self.expected = ()
        self.open_page()

    @classmethod
    def setUpClass(cls):
        cls.open_browser()

    def text(self, name):
        return self.page.run("return document.getElementById(arguments[0]).textContent", name)

    @campaign
    def test_a_turn_is_asked_for_once_when_it_has_come_to_rest(self):
        self.page.wait("palpateViewer.state.armed")
        self.assertIn("device armed", self.text("viewers"))
        self.page.run("""window.asked = [];
            const send = WebSocket.prototype.send;
            WebSocket.prototype.send = function (data) {
              if (JSON.parse(data).type === "set") window.asked.push(JSON.parse(data));
              return send.call(this, data);
            };""")
        self.page.click("#turn")
        self.drag("#picture-volume .stack", 100, 0)
        self.page.wait("document.getElementById('toast').textContent.startsWith('Waiting for consent at the device')")
        self.assertEqual(self.page.run("return palpateViewer.state.rotation_wxyz"), [1, 0, 0, 0], "nobody has agreed yet")
        self.page.wait("palpateViewer.state.rotation_wxyz[0] < 0.99")
        self.assertEqual(self.page.run("return window.asked.length"), 1)

    def stop_here(self):
        self.page.wait("palpateViewer.state.armed")
        self.page.press(" ")
        self.page.wait("palpateViewer.state.emergency_stop && !palpateViewer.state.armed")

    @campaign
    def test_the_field_of_the_code_fits_on_every_screen(self):
        self.addCleanup(self.page.resize, *SIZE)
        self.stop_here()
        self.page.wait("!document.getElementById('arm-line').hidden")
        for language, width, height in [(language, *size) for language in ("de", "en") for size in ((390, 844), (768, 1024), (1920, 1080))]:
            with self.subTest(language=language, width=width):
                speak(self.page, language)
                self.page.resize(width, height)
                self.page.wait(f"innerWidth <= {width}")
                self.assertLessEqual(self.page.run("return document.documentElement.scrollWidth"), width)
                panel, *boxes = self.page.run("""return ["#panel", "#pause", "#rearm", "#arm-line span", "#arm-code"].map((name) => {
                    const one = document.querySelector(name), r = one.getBoundingClientRect();
                    return [name, r.left, r.top, r.right, r.bottom, one.scrollWidth - one.clientWidth];
                })""")
                self.assertEqual([a[0] for a in (panel, *boxes) if a[5] > 0], [], "clipped")
                self.assertEqual([a for a in boxes if a[1] < panel[1] or a[3] > panel[3] or a[4] - a[2] < 12], [])
                self.assertEqual([(a[0], b[0]) for n, a in enumerate(boxes) for b in boxes[n + 1:]
                                  if min(a[3], b[3]) > max(a[1], b[1]) and min(a[4], b[4]) > max(a[2], b[2])], [])


class ContactWithPointer(PointerSession):
    """What the page shows and controls while the tip touches an object that stands still."""

    @campaign
    def test_pixel_under_the_tip_has_the_touched_structures_colour(self):
        seed = test_seed()
        print(f"  seed {seed}", flush=True)
        generator = random.Random(seed)
        self.page.run("document.querySelectorAll('.structure input[type=range]').forEach((slider) => {"
                      "slider.value = 1; slider.dispatchEvent(new Event('input', { bubbles: true })); })")
        self.slide("#fill", 1)
        self.take_hand()
        structures = 0
        # of every tissue the first, then of every one the second: as many colours as there are
        rank = {s["label"]: sum(t["tissue"] == s["tissue"] and t["label"] < s["label"] for t in self.scene["structures"])
                for s in self.scene["structures"]}
        for structure in sorted(self.scene["structures"], key=lambda s: rank[s["label"]]):
            if structures == STRUCTURES or structure["tissue"] < 0 or not self.scene["tissues"][structure["tissue"]]["touchable"]:
                continue
            ways = self.approaches(structure["label"], POSITIONS, generator)
            if len(ways) < POSITIONS:
                continue
            structures += 1
            print("  " + structure["name"], flush=True)
            for start, end in ways:
                with self.subTest(structure=structure["name"], end=end):
                    self.press_on(structure["label"], start, end)
                    time.sleep(0.3)
                    shown = self.page.run(
                        """palpateViewer.draw();
                           const tip = palpateViewer.pose.devices[0].tip;
                           const { x, y, off_mm } = palpateViewer.pixelOf("oblique", tip);
                           return { off_mm, colour: palpateViewer.colourAt("oblique", x, y), label: palpateViewer.pose.devices[0].label };""")
                    self.assertEqual(shown["label"], structure["label"])
                    self.assertLess(shown["off_mm"], 0.05)
                    for seen, expected in zip(shown["colour"], structure["colour"]):
                        self.assertLessEqual(abs(seen - expected), 3, (shown, structure))
        self.assertEqual(structures, STRUCTURES)

    def touch_something(self):
        # nothing rests on it, so it may be as soft as one likes
        felt = next(s for s in self.scene["structures"] if s["name"] == "lateral_meniscus")
        start, end = self.approaches(felt["label"], 1, random.Random(1))[0]
        self.take_hand()
        self.press_on(felt["label"], start, end)
        return felt

    def test_what_is_shown_is_what_is_felt(self):
        felt = self.touch_something()
        name = felt["name"].replace("_", " ")
        self.page.pointer({"type": "pointerMove", "x": 500, "y": 3})
        shown = """palpateViewer.draw();
            const words = (id) => document.getElementById(id).textContent;
            return { touched: words("touched"), footer: words("structure"), stiffness: words("stiffness"), why: words("force-explanation"),
                     rows: [...document.querySelectorAll("#felt tr")].filter((row) => !row.hidden).length,
                     marked: document.querySelectorAll(".structure.touched").length, force: Math.hypot(...palpateViewer.pose.devices[0].force) };"""

        def assert_felt():
            # the session lets go of a tip whose page has sent nothing for 100 ms, as on a busy machine
            for _ in range(20):
                self.page.wait("Math.hypot(...palpateViewer.pose.devices[0].force) > 0")
                now = self.page.run(shown)
                if now["force"] > 0:
                    break
            self.assertEqual([now["touched"], now["footer"], now["marked"]], [name, name, 1], now)
            self.assertGreater(now["rows"], 0, now)
            self.assertNotEqual(now["stiffness"], "–")
            self.assertRegex(now["why"], r" deep at |reduced from .*: | along the surface", now)

        def assert_not_felt(words):
            self.page.wait("Math.hypot(...palpateViewer.pose.devices[0].force) === 0")
            now = self.page.run(shown)
            self.assertEqual([now["touched"], now["footer"], now["rows"], now["marked"], now["stiffness"], now["why"]], [words, words, 0, 0, "–", ""], now)

        assert_felt()
        # the slider goes from 0.01 to 10 N/mm by ratios, and the loop's stiffness with it
        self.assertGreater(self.page.run("return palpateViewer.pose.devices[0].stiffness"), 0)
        for place, stiffness in ((0.4, 0.158), (0.25, 0.0562)):
            self.slide(f"input[data-tissue='{felt['tissue']}']", place)
            self.page.wait(f"Math.abs(palpateViewer.pose.devices[0].stiffness - {stiffness}) < 0.001")
            self.assertEqual(self.page.run(f"return palpateViewer.state.tissues[{felt['tissue']}].stiffness_N_per_mm"), stiffness)
        assert_felt()
        self.page.click("#pause")
        self.page.wait("palpateViewer.state.paused")
        assert_not_felt(f"{name}, not felt")
        # the pause has let go of the surface: the tip is inside, without force, and not free
        self.page.click("#pause")
        self.page.wait("!palpateViewer.state.paused && (palpateViewer.pose.devices[0].flags & %d) !== 0" % INSIDE)
        assert_not_felt(f"{name}, not felt")
        self.choose_method("trilinear")
        assert_felt()
        # nobody holds it any more
        self.page.run("window.hand.letGo()")
        self.page.wait("(palpateViewer.pose.devices[0].flags & 512) !== 0")
        assert_not_felt(f"{name}, not felt")
        self.choose_method("proxy")

    def test_the_mouse_moves_the_tip(self):
        self.page.wait("palpateViewer.state.pointer")
        self.page.wait("document.querySelector('[data-tool=touch]').getAttribute('aria-checked') === 'true'")
        left, top, width, height = self.box("#picture-oblique .stack")
        # 60 pixels of free space: next to an outline it would be touched
        x, y = self.page.run("""palpateViewer.draw();
            const [width, height] = arguments;
            const isFree = (x, y) => palpateViewer.structureAt(palpateViewer.patientAt("oblique", x, y)) === null;
            for (let y = 60; y < height - 40; y += 10) for (let x = 80; x < width - 40; x += 10)
              if ([...Array(9).keys()].every((n) => [-12, 0, 12].every((dy) => isFree(x + 12 - 10 * n, y + dy)))) return [x, y];""", width, height)
        x, y = round(left + x), round(top + y)
        self.page.pointer({"type": "pointerMove", "x": x - 60, "y": y}, {"type": "pointerDown", "button": 0},
                          {"type": "pointerMove", "x": x, "y": y, "duration": 400})
        # it rests there, and is not forgotten
        wanted = self.page.run("return palpateViewer.patientAt('oblique', arguments[0], arguments[1])", x - left, y - top)
        near = "Math.hypot(...palpateViewer.pose.devices[0].tip.map((x, i) => x - %s[i])) < 0.3" % json.dumps(wanted)
        self.page.wait(near)
        time.sleep(0.5)
        self.assertTrue(self.page.run("return " + near))
        self.assertFalse(self.page.run("return (palpateViewer.pose.devices[0].flags & 512) !== 0"), "stale while it is held")
        self.page.pointer({"type": "pointerUp", "button": 0})
        self.page.wait("(palpateViewer.pose.devices[0].flags & 512) !== 0")

    def test_space_only_stops_and_an_out_of_contact_viewer_rearms(self):
        felt = self.touch_something()
        free = self.approaches(felt["label"], 1, random.Random(1))[0][0]
        self.page.press(" ")
        self.page.wait("palpateViewer.state.emergency_stop && (palpateViewer.pose.devices[0].flags & 8192) !== 0")
        first = self.page.run("return palpateViewer.state.stop")
        self.page.press(" ")
        self.page.wait(f"palpateViewer.state.stop > {first}")
        self.assertTrue(self.page.run("return palpateViewer.state.emergency_stop"))
        # the other has the hand, and is refused by name of another stop, and as long as it touches something
        self.page.wait("document.getElementById('flags').textContent.includes('only the viewer moving the tip can rearm')")
        self.assertIn("stopped by this page", self.page.run("return document.getElementById('flags').textContent"))
        self.assertTrue(self.page.run("return document.getElementById('rearm').disabled"))
        self.assertIn("another viewer has the pointer", self.page.run("return document.getElementById('viewers').textContent"))
        for answer, stop, words in ((2, "%d" % first, "another stop"), (3, "palpateViewer.state.stop", "is in contact")):
            self.page.run("window.hand.ask({ type: 'rearm', id: %d, stop: %s })" % (answer, stop))
            self.page.wait(f"window.hand.answers[{answer}]")
            told = self.page.run(f"return window.hand.answers[{answer}]")
            self.assertEqual(told["type"], "refused", told)
            self.assertIn(words, told["what"])
        # this page takes the hand again, from where it is free
        self.lead([free])
        self.page.run("window.hand.ask({ type: 'stop', id: 4 })")
        self.page.wait("document.getElementById('flags').textContent.includes('stopped by another viewer')")
        self.page.run("window.hand.letGo()")
        self.page.wait("(palpateViewer.pose.devices[0].flags & 512) !== 0")
        # a pointer that nobody presses is no trouble
        self.assertNotIn("no current pose", self.page.run("palpateViewer.draw(); return document.getElementById('flags').textContent"))
        self.page.wait("!document.querySelector('[data-tool=touch]').disabled")
        time.sleep(0.3)
        self.page.click("[data-tool=touch]")
        self.page.wait("palpateViewer.state.pointer && !document.getElementById('rearm').disabled")
        self.page.wait("document.getElementById('viewers').textContent.includes('you have the pointer')")
        self.page.click("#rearm")
        self.page.wait("!palpateViewer.state.emergency_stop")

    def test_pause_switches_and_a_turn_reach_the_loop(self):
        for control, told, on in (("pause", "paused", 4), ("friction", "friction", 1), ("viscosity", "viscosity", 2), ("passivity", "passivity", 16)):
            before = self.page.run(f"return palpateViewer.pose.switches & {on}")
            # not where it is, which moves while what is switched is told of
            for sign in ("!==", "==="):
                self.page.run("document.getElementById(arguments[0]).click()", control)
                self.page.wait(f"(palpateViewer.pose.switches & {on}) {sign} {before} && palpateViewer.state.{told} === !!(palpateViewer.pose.switches & {on})")
        self.page.click("[data-look=anterior]")
        self.page.click("#turn")
        self.drag("#picture-volume .stack", 100, 0)
        # 0.8 rad about the picture's vertical, which is World's y; felt as the loop interpolates it
        self.page.wait("Math.abs(palpateViewer.pose.rotation[2] - Math.sin(0.4)) < 0.005 && "
                       "Math.abs(palpateViewer.pose.rotation[0] - Math.cos(0.4)) < 0.005")

    def test_planes_hang_as_in_radiology_and_meet_at_the_cross_hair(self):
        self.page.click("[data-layout=five]")
        self.page.wait("document.querySelector('#picture-axial canvas').width > 50")
        left, posterior, inferior = [1, 0, 0], [0, 1, 0], [0, 0, -1]
        for kind, right, down in (("axial", left, posterior), ("sagittal", posterior, inferior), ("coronal", left, inferior)):
            # a picture has its plane from its first frame on
            self.page.wait(f"(palpateViewer.draw(), JSON.stringify([palpateViewer.plane('{kind}').right, palpateViewer.plane('{kind}').down])"
                           f" === '{json.dumps([right, down], separators=(',', ':'))}')")
        x0, y0, width, height = self.box("#picture-coronal .stack")
        x, y = round(x0 + 0.6 * width), round(y0 + 0.55 * height)
        self.page.post("/actions", {"actions": [
            {"type": "key", "id": "keys", "actions": [{"type": "keyDown", "value": "\ue008"}, {"type": "pause"}, {"type": "pause"}, {"type": "keyUp", "value": "\ue008"}]},
            {"type": "pointer", "id": "mouse", "parameters": {"pointerType": "mouse"}, "actions": [
                {"type": "pointerMove", "x": x - 5, "y": y}, {"type": "pointerMove", "x": x, "y": y}, {"type": "pause"}, {"type": "pause"}]}]})
        self.page.run("palpateViewer.draw()")
        point = self.page.run("return palpateViewer.patientAt('coronal', arguments[0], arguments[1])", x - x0, y - y0)
        for kind in ("axial", "sagittal", "coronal"):
            self.assertLess(self.page.run("return palpateViewer.pixelOf(arguments[0], arguments[1]).off_mm", kind, point), 0.05)
        self.page.wait("document.getElementById('follow').getAttribute('aria-pressed') === 'false'")

    def test_dragging_changes_the_window_and_the_wheel_the_slice(self):
        self.page.click("[data-tool=window]")
        width = float(self.page.run("return document.getElementById('width').value"))
        self.drag("#picture-oblique .stack", 80, 0)
        self.page.wait(f"Number(document.getElementById('width').value) > {1.2 * width}")
        before = self.resting_plane()
        left, top, w, h = self.box("#picture-oblique .stack")
        self.page.post("/actions", {"actions": [{"type": "wheel", "id": "wheel", "actions": [
            {"type": "scroll", "x": round(left + w / 2), "y": round(top + h / 2), "deltaX": 0, "deltaY": 120}]}]})
        self.page.run("palpateViewer.draw()")
        after = self.page.run("return palpateViewer.plane('oblique')")
        moved = numpy.dot(numpy.subtract(after["centre"], before["centre"]), before["normal"])
        voxel = min(numpy.linalg.norm(self.patient_from_voxel[:3, axis]) for axis in range(3))
        self.assertAlmostEqual(moved, voxel, 3)

    def test_notice_is_in_view_and_burned_into_screenshots(self):
        for size in (SIZE, (768, 1024)):
            self.page.resize(*size)
            box = self.box(".notice")
            self.assertEqual(box[:2], [0, 0])
            self.assertGreater(box[3], 15)
            self.assertLessEqual(self.page.run("return document.documentElement.scrollWidth"), size[0])
            stop = self.box("#stop")
            self.assertTrue(stop[0] >= 0 and stop[0] + stop[2] <= size[0], stop)
        self.page.resize(*SIZE)
        text = self.page.run("return document.querySelector('.notice').innerText")
        self.assertEqual(text, "Research and education — not for clinical use")
        picture = self.run_async("palpateViewer.screenshot().then(done)")
        width, height, pixels = decode_png(base64.b64decode(picture.split(",")[1]))
        # the line on top, in its own colours: ground, and letters in the middle of it
        strip = pixels[2:28, width // 4: 3 * width // 4, :3].astype(int)
        self.assertGreater((abs(strip - (0xfd, 0xf0, 0xdc)).sum(2) < 12).mean(), 0.6)
        self.assertGreater((abs(strip - (0x7a, 0x43, 0x00)).sum(2) < 40).sum(), 400)
        # and the pictures below
        self.assertGreater((pixels[40:, :, :3].max(2) > 90).mean(), 0.02)
        self.assertGreater(height, 300)

    @campaign
    def test_recording_is_a_video_and_its_poses(self):
        with tempfile.TemporaryDirectory(prefix="palpate-download-") as folder:
            self.page.developer_tools("Browser.setDownloadBehavior", behavior="allow", downloadPath=folder)
            self.page.click("#record")
            time.sleep(4)
            self.page.click("#record")
            deadline = time.monotonic() + 300
            while len([name for name in os.listdir(folder) if name.endswith((".webm", ".jsonl"))]) < 2:
                self.assertLess(time.monotonic(), deadline, os.listdir(folder))
                time.sleep(0.1)
            time.sleep(0.5)
            files = {os.path.splitext(name)[1]: os.path.join(folder, name) for name in os.listdir(folder)}
            with open(files[".webm"], "rb") as video:
                self.assertEqual(video.read(4), struct.pack(">I", 0x1a45dfa3))
            with open(files[".jsonl"], encoding="utf-8") as poses:
                head, *lines = map(json.loads, poses)
            self.assertIn("not for clinical use", head["notice"])
            self.assertEqual(head["side"], "left")
            self.assertGreater(len(lines), 30)
            self.assertTrue(all(a["sequence"] < b["sequence"] for a, b in zip(lines, lines[1:])))


if __name__ == "__main__":
    viewer_page.main(sys.argv[1:], sys.modules["__main__"])
