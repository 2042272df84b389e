"""Planes, controls, words, measures and the history of the viewer page, on a scene of many structures.

usage: planes_test.py [--campaigns] mock NODE MOCK_SERVER PAGE_FOLDER [TEST ...]

viewer_test.py explains the arguments and runs these tests with those of the other scripts in one browser.
"""

import csv
import math
import os
import sys
import tempfile
import time

sys.dont_write_bytecode = True  # nothing is left in the source tree
import viewer_page  # noqa: E402
from viewer_page import SIZE, Server, Viewer, campaign, numpy, speak  # noqa: E402


class WithManyStructures(Viewer):
    """The mock's unsigned 16-bit scan on a grid with permuted, mirrored and oblique axes and 116 structures; the tip
    moves continuously."""

    uses_mock = True

    @classmethod
    def setUpClass(cls):
        cls.server = Server("script", extra=["--scan", "ramp", "--more", "108"]).__enter__()
        cls.addClassCleanup(cls.server.__exit__)
        cls.scene = cls.server.scene()
        cls.labels, cls.patient_from_voxel = cls.server.labels(cls.scene)
        volume = cls.scene["volume"]
        cls.scan = numpy.frombuffer(cls.server.get("api/volume/scan/" + volume["hash"]), "<i2").reshape(volume["dims"][::-1]) \
            .transpose(2, 1, 0) * volume["scan"]["scale"] + volume["scan"]["offset"]
        cls.names = {s["label"]: s["name"].replace("_", " ") for s in cls.scene["structures"]}
        cls.open_browser()
        # one page for all of them
        cls.open_page(cls)

    def setUp(self):
        # as the page begins: what a test scrolled away from would leave another with a plane beside the scan
        self.page.run("""for (const stack of document.querySelectorAll(".stack")) stack.dispatchEvent(new KeyboardEvent("keydown", { key: "Home" }));
            const along = document.querySelector("#picture-oblique select");
            along.value = "tool";
            along.dispatchEvent(new Event("change"));""")
        self.follow(True)
        self.page.click("[data-tool=window]")
        self.let_it_glide()

    def let_it_glide(self):
        """The section's plane comes to where the tool wants it."""
        self.page.wait("""(() => {
            const before = palpateViewer.plane("oblique").normal;
            for (let n = 0; n < 80; n++) palpateViewer.draw();
            return palpateViewer.isFresh && palpateViewer.plane("oblique").normal.every((x, i) => Math.abs(x - before[i]) < 1e-9);
          })()""")

    def show_all_planes(self):
        # a picture that was hidden has no size until the page has measured it
        self.page.click("[data-layout=five]")
        self.page.wait("document.querySelector('#picture-axial canvas').width > 50 && document.querySelector('#picture-axial').offsetParent !== null")
        self.page.run("palpateViewer.draw()")

    def follow(self, wanted):
        if (self.page.run("return document.getElementById('follow').getAttribute('aria-pressed')") == "true") != wanted:
            self.page.click("#follow")
            self.page.wait("document.getElementById('follow').getAttribute('aria-pressed') === '%s'" % str(wanted).lower())

    def voxel_of(self, p):
        return (numpy.linalg.inv(self.patient_from_voxel) @ [*p, 1])[:3]

    def test_the_readout_is_of_the_plane_that_is_drawn(self):
        left, top, width, height = self.box("#picture-oblique .stack")
        x, y = round(left + 0.47 * width), round(top + 0.53 * height)
        self.page.pointer({"type": "pointerMove", "x": x - 3, "y": y}, {"type": "pointerMove", "x": x, "y": y})
        # a tilted plane: along the force
        for tissue in range(len(self.scene["tissues"])):
            self.slide(f"input[data-tissue='{tissue}']", 0.7)
        self.page.run("const along = document.querySelector('#picture-oblique select'); along.value = 'force'; along.dispatchEvent(new Event('change'))")
        self.page.wait("(palpateViewer.draw(), palpateViewer.plane('oblique').normal.every((x) => Math.abs(x) < 0.98))")
        # the mouse rests from here on; poses come, the plane glides after the tip, or is led by the wheel and the keys
        shown = self.page.run("""return (async (x, y) => {
            const surface = document.querySelector("#picture-oblique .stack");
            const words = (id) => document.getElementById(id).textContent;
            const shown = [];
            for (let n = 0; n < 200; n++) {
              const way = n % 40 < 20 ? 1 : -1;
              if (n % 4 === 1) surface.dispatchEvent(new WheelEvent("wheel", { deltaY: 120 * way, cancelable: true }));
              if (n % 4 === 2) surface.dispatchEvent(new KeyboardEvent("keydown", { key: way > 0 ? "PageDown" : "ArrowUp" }));
              if (n % 4 === 3) document.getElementById("follow").click();
              palpateViewer.draw();
              shown.push({ p: palpateViewer.patientAt("oblique", x + 0.5, y + 0.5), position: words("position"),
                           value: words("value"), structure: words("structure") });
              if (n % 4 === 0) await new Promise((later) => setTimeout(later, 30));
            }
            return shown;
          })(...arguments);""", math.floor(x - left), math.floor(y - top))
        planes = {tuple(numpy.round(one["p"], 2)) for one in shown}
        self.assertGreater(len(planes), 100, "the plane hardly moved")
        wrong = []
        for one in shown:
            voxel = numpy.floor(self.voxel_of(one["p"]) + 0.5).astype(int)
            inside = (voxel >= 0).all() and (voxel < self.labels.shape).all()
            position = "LPS " + "  ".join(f"{x:+.1f}".replace("-", "−") for x in one["p"]) + " mm"
            expected = (f"value {self.scan[tuple(voxel)]:.0f}" if inside else "", self.names.get(self.labels[tuple(voxel)], "") if inside else "")
            # a figure that ends in 5 may be rounded either way
            off = max(abs(float(a.replace("−", "-")) - b) for a, b in zip(one["position"].split()[1:4], one["p"])) if one["position"].startswith("LPS") else 99
            if (one["value"], one["structure"]) != expected or off > 0.0501:
                wrong.append((one, position, expected))
        self.assertEqual(len(wrong), 0, f"{len(wrong)} of {len(shown)}, such as {wrong[:2]}")

    def test_a_tools_shaft_is_drawn_where_it_is(self):
        # all at once: the tip moves on
        drawn = self.page.run("""
            const worldFromPatient = arguments[0];
            palpateViewer.draw();
            const { devices: [device], rotation } = palpateViewer.pose, { normal } = palpateViewer.plane("oblique");
            const [w, x, y, z] = device.orientation;
            const world = [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)];
            const axis = [0, 1, 2].map((c) => world.reduce((sum, v, r) => sum + v * worldFromPatient[r][c], 0));
            // across it in the picture, whose plane holds it
            const crossed = [0, 1, 2].map((i) => axis[(i + 1) % 3] * normal[(i + 2) % 3] - axis[(i + 2) % 3] * normal[(i + 1) % 3]);
            const held = device.flags & 1 << 4 && !(device.flags & 1 << 17) ? device.proxy : device.tip;
            const place = (along, aside) => held.map((v, i) => v + along * axis[i] + aside * crossed[i] / Math.hypot(...crossed));
            const places = [[8, -3], [20, -3], [32, -3], [8, 3], [20, 3], [32, 3], [30, -7], [30, 7]].map(([along, aside]) => place(along, aside));
            const drawn = palpateViewer.drawnOver("oblique", places);
            return { rotation, outline: drawn.slice(0, 6), beside: drawn.slice(6) };
            """, self.scene["world_from_patient"])
        self.assertEqual(drawn["rotation"], [1, 0, 0, 0])
        self.assertGreater(min(drawn["outline"]), 60, drawn)
        self.assertEqual(drawn["beside"], [0, 0])

    @campaign
    def test_a_bookmark_brings_back_what_was_seen_and_the_page_is_as_it_was_left(self):
        rotation = "palpateViewer.pose.rotation"
        self.addCleanup(lambda: (self.page.run("document.getElementById('unturn').click()"), self.page.wait(rotation + "[0] > 0.9999999")))
        self.addCleanup(self.page.click, "[data-layout=two]")
        preset = "const preset = document.getElementById('preset'); preset.value = arguments[0]; preset.dispatchEvent(new Event('change', { bubbles: true }))"
        self.addCleanup(self.page.run, preset, "percentiles")
        key = "document.querySelector(`#picture-${arguments[0]} .stack`).dispatchEvent(new KeyboardEvent('keydown', { key: arguments[1], altKey: arguments[2] ?? false }))"
        seen = """palpateViewer.draw();
            const points = [[0, 0, 0], [10, -7, 21], [-31, 4, 12]];
            return [...points.flatMap((p) => palpateViewer.project(p)), ...["oblique", "axial"].flatMap((kind) => points.flatMap((p) => Object.values(palpateViewer.pixelOf(kind, p)))),
              Number(document.getElementById("width").value), ...palpateViewer.pose.rotation];"""
        layout = "return document.querySelector('[data-layout][aria-checked=true]').dataset.layout"
        self.show_all_planes()
        self.page.run(key, "volume", "ArrowRight", True)
        self.page.wait(rotation + "[0] < 0.9999 && Math.abs(%s[2] - palpateViewer.state.rotation_wxyz[2]) < 1e-6" % rotation)
        self.follow(False)
        self.page.run("const n = document.querySelector('#picture-axial .slices input[type=number]'); n.value = 17; n.dispatchEvent(new Event('change'))")
        self.page.run(key, "oblique", "+")
        self.page.click("[data-look=left]")
        self.page.run(preset, "all")
        self.let_it_glide()
        self.page.run("document.getElementById('bookmark-form').closest('details').open = true; document.getElementById('bookmark-name').value = 'notch'; document.querySelector('#bookmark-form button').click()")
        self.assertEqual(self.page.run("return document.activeElement.textContent"), "notch")
        was = self.page.run(seen)
        recall = "document.querySelector('#bookmarks .figure').click()"

        def assert_seen_again():
            self.page.run(recall)
            self.page.wait("Math.abs(%s[2] - %.9g) < 1e-6" % (rotation, was[-2]))
            self.assertEqual(self.page.run(layout), "five")
            for before, now in zip(was, self.page.run(seen)):
                self.assertLess(abs(before - now), 0.02 + 1e-5 * abs(before), (was, now))

        self.page.click("[data-layout=two]")
        self.page.run(key, "oblique", "Home")
        self.page.run("document.getElementById('unturn').click()")
        self.page.wait(rotation + "[0] > 0.9999999")
        self.follow(True)
        self.page.click("[data-look=superior]")
        self.page.run(preset, "percentiles")
        self.assertGreater(numpy.abs(numpy.subtract(was, self.page.run(seen))).max(), 50)
        assert_seen_again()
        # another page of the same scene has it too, and opens as this one was left
        self.page.wait("Number(document.getElementById('width').value) > 60000")
        self.open_page(keep_storage=True)
        self.assertEqual(self.page.run(layout), "five")
        self.assertTrue(self.page.run("return document.getElementById('bookmark-form').closest('details').open"))
        self.page.wait("Number(document.getElementById('width').value) > 60000")
        assert_seen_again()
        # one in which the volume was not seen before
        self.page.click("[data-layout=section]")
        self.open_page(keep_storage=True)
        self.assertEqual(self.page.run(layout), "section")
        assert_seen_again()
        self.page.run("document.querySelector('#bookmarks button:last-child').click()")
        self.assertEqual(self.page.run("return document.querySelectorAll('#bookmarks li').length"), 0)

    def test_nothing_stands_in_anybodys_way(self):
        self.addCleanup(self.page.resize, *SIZE)
        self.addCleanup(self.page.dark, True)
        self.page.run("document.querySelectorAll('details').forEach((card) => (card.open = true))")
        label = "palpateViewer.pose.devices[0].label"
        for is_dark in (True, False):
            self.page.dark(is_dark)
            with self.subTest(dark=is_dark):
                self.page.wait(f"{label} === 0")
                self.assertEqual(self.accessibility_violations(), [])
                self.page.wait(f"{label} > 0")
                self.assertEqual(self.accessibility_violations(), [])
                self.page.press(" ")
                self.page.wait("document.getElementById('stop').classList.contains('stopped')")
                self.page.run("document.getElementById('help').click()")
                self.assertEqual(self.accessibility_violations(), [])
                self.page.run("document.getElementById('help-close').click()")
                # as a refused request is told
                self.page.run("const toast = document.getElementById('toast'); toast.textContent = 'There was another stop.'; toast.hidden = false")
                self.assertEqual(self.accessibility_violations(), [])
                self.page.resize(390, 844)
                self.page.wait("innerWidth <= 390")
                self.assertEqual(self.accessibility_violations(), [])
                self.page.resize(*SIZE)
                self.page.run("window.rearming = setInterval(() => document.getElementById('rearm').click(), 50)")
                self.page.wait("!palpateViewer.state.emergency_stop")
                self.page.run("clearInterval(window.rearming)")

    def test_what_is_spoken_comes_once_a_second_at_most_and_all_controls_are_reached_by_keys(self):
        # whatever a reader of the screen would speak by itself
        spoken = self.page.run("""return (async () => {
            const live = [...document.querySelectorAll("output, [role=status], [role=alert], [role=log], [aria-live]")].filter((one) => one.ariaLive !== "off");
            const spoken = live.map(() => []);
            live.forEach((one, n) => new MutationObserver(() => one.textContent && spoken[n].push([performance.now(), one.textContent]))
              .observe(one, { childList: true, characterData: true, subtree: true }));
            for (let n = 0; n < 40; n++) {
              document.getElementById("pause").click();
              await new Promise((later) => setTimeout(later, 100));
              palpateViewer.draw();
            }
            await new Promise((later) => setTimeout(later, 1500));
            return spoken.map((times, n) => [live[n].id, times]);
          })()""")
        for name, times in spoken:
            self.assertTrue(all(b[0] - a[0] > 990 for a, b in zip(times, times[1:])), (name, times))
        said = dict(spoken)["spoken"]
        self.assertGreater(len(said), 1, spoken)
        self.assertTrue(any("paused" in text for _, text in said), said)
        self.page.run("if (palpateViewer.state.paused) document.getElementById('pause').click()")
        # in the order in which they stand: nothing is left out, nothing comes first, and the list of structures is one line
        self.page.run("document.querySelectorAll('details').forEach((card) => (card.open = true))")
        wrong = self.page.run("""return [...document.querySelectorAll("button, input, select, summary, .stack")]
            .filter((one) => one.offsetParent && (one.tabIndex !== 0) !== (one.closest(".structure") !== null && one.closest(".structure") !== document.querySelector(".structure")))
            .map((one) => one.outerHTML)""")
        self.assertEqual(wrong, [])
        seen = set()
        self.page.run("document.getElementById('help').focus()")
        for _ in range(120):
            self.page.press("\ue004")
            name, shown = self.page.run("""const one = document.activeElement, style = getComputedStyle(one);
                return [one.id || one.className || one.outerHTML, one === document.body || (style.outlineStyle !== "none" && parseFloat(style.outlineWidth) >= 2)]""")
            self.assertTrue(shown, name)
            seen.add(name)
            if name == "convention":
                break
        self.assertLessEqual({"language", "stop", "undo" if self.page.run("return !document.getElementById('undo').disabled") else "clear", "record", "stack", "find", "limit", "slab", "convention"}, seen)

    def test_every_screen_holds_the_stop_and_no_control_lies_on_another(self):
        self.addCleanup(self.page.resize, 1440, 900)
        self.addCleanup(self.speak, "en")
        for language, width, height in [(language, *size) for language in ("de", "en") for size in ((390, 844), (768, 1024), (1024, 768), (1920, 1080))]:
            with self.subTest(language=language, width=width):
                self.speak(language)
                self.page.resize(width, height)
                self.page.wait(f"innerWidth <= {width}")
                self.page.run("palpateViewer.draw()")
                self.assertLessEqual(self.page.run("return document.documentElement.scrollWidth"), width)
                left, top, wide, high = self.box("#stop")
                self.assertTrue(0 <= left and left + wide <= width and 0 <= top and top + high <= height / 3, self.box("#stop"))
                self.assertEqual(self.page.run("return document.elementFromPoint(...arguments).id", left + wide / 2, top + high / 2), "stop")
                boxes = self.page.run("""return [...document.querySelectorAll(".notice, .bar > *, .bar .badge, .tools button, .picture header > *, .slices > *, .readout > *")]
                    .filter((one) => one.offsetParent && one.offsetWidth > 0 && !one.matches(".facts, .spacer"))
                    .map((one) => { const r = one.getBoundingClientRect(); return [one.id || one.textContent, r.left, r.top, r.right, r.bottom, one.closest(".tools") !== null]; });""")
                # one row, which is scrolled where it is too narrow
                self.assertLess(self.box(".tools")[3], 56)
                over = [(a[0], b[0]) for n, a in enumerate(boxes) for b in boxes[n + 1:]
                        if min(a[3], b[3]) - max(a[1], b[1]) > 1 and min(a[4], b[4]) - max(a[2], b[2]) > 1]
                self.assertEqual(over, [])
                self.assertEqual([one for one in boxes if not one[5] and (one[1] < -1 or one[3] > width + 1)], [])

    def speak(self, language):
        speak(self.page, language)

    def test_german_is_the_whole_pages_and_is_kept(self):
        self.addCleanup(self.speak, "en")
        said = """return [...document.querySelectorAll("body :not(#cover-text)")].flatMap((one) => [one.title, one.ariaLabel ?? "", one.placeholder ?? "",
            ...[...one.childNodes].filter((node) => node.nodeType === Node.TEXT_NODE).map((node) => node.data.trim())]).filter((text) => /[A-Za-z]{3}/.test(text));"""
        self.assertEqual(self.page.run("return document.documentElement.lang"), "en")
        english = self.page.run(said)
        self.speak("de")
        german = self.page.run(said)
        self.assertEqual(self.page.run("return document.documentElement.lang"), "de")
        self.assertIn("Nur für Forschung und Lehre — nicht für den klinischen Einsatz", german)
        # names are the same, of what the scene has and of planes, and so are palpate's own sentences
        names = {"palpate", "Esc", "Maximum (MIP)", "Minimum (MinIP)", "English", "Deutsch", "Pause", "Motor", "Vibration", "ChainMail", "Axial", "Sagittal", "axial", "sagittal", "LPS (DICOM)", "RAS (Slicer)", "Training"}
        names |= {s["name"].replace("_", " ") for s in self.scene["structures"] + self.scene["tissues"]} | set(self.scene["methods"]) | {c["text"] for c in self.scene["caveats"]}
        same = {text for text in set(english) & set(german) - names if not text.startswith(("palpate ", "LPS "))}
        self.assertEqual(same, set())
        self.assertGreater(len(german), 120)
        # over the pictures, too, and after the page was opened anew
        self.open_page(keep_storage=True)
        self.page.wait("document.documentElement.lang === 'de'")
        self.assert_light()
        self.assertEqual(self.page.run("return document.getElementById('stop').textContent"), "Not-Halt")
        self.page.run("palpateViewer.draw()")
        self.assertIn("Spitze", self.page.run("return document.getElementById('position').textContent"))

    def test_help_leaves_the_stop_in_reach(self):
        self.page.click("#help")
        self.assertFalse(self.page.run("return document.getElementById('help-box').hidden"))
        left, top, width, height = self.box("#stop")
        self.assertEqual(self.page.run("return document.elementFromPoint(...arguments).id", left + width / 2, top + height / 2), "stop")
        box = self.box("#help-box")
        self.assertGreaterEqual(box[1], top + height)
        self.page.click("#help-close")

    def test_no_figure_moves_another(self):
        places = self.page.run("""
            const all = [...document.querySelectorAll(".force *, .touch dt, .touch dd")];
            const force = document.getElementById("force"), depth = document.getElementById("depth");
            return [["0.00", "0.00 mm"], ["0.0123", "−0.0123 mm"], ["9.99", "123 mm"]].map(([first, second]) => {
              force.textContent = first;
              depth.textContent = second;
              return all.map((one) => { const { left, top, right } = one.getBoundingClientRect(); return [left, top, right]; });
            });""")
        self.assertEqual(places[0], places[1])
        self.assertEqual(places[0], places[2])

    @campaign
    def test_greys_are_those_of_the_values_beside_an_outlier(self):
        self.slide("#fill", 0)
        self.page.run("document.getElementById('outlines').click()")
        # a plane through much of the scan
        for _ in range(50):
            self.follow(True)
            self.page.wait("Math.abs(palpateViewer.pose.devices[0].tip[0]) < 20")
            self.follow(False)
            if abs(self.page.run("palpateViewer.draw(); return palpateViewer.plane('oblique').centre[0]")) < 20:
                break
        # every pixel of a grid over the picture: where it is, and its grey
        width, height = self.page.run("const c = document.querySelector("
                                      "'#picture-oblique canvas'); return [c.width, c.height]")
        shown = self.page.run("""
            const shown = [];
            const [width, height] = arguments;
            palpateViewer.draw();
            for (let y = Math.floor(0.1 * height); y < 0.9 * height; y += 37) {
              for (let x = 2; x < width - 2; x++) shown.push([...palpateViewer.patientAt("oblique", x + 0.5, y + 0.5), ...palpateViewer.colourAt("oblique", x, y)]);
            }
            return shown;""", width, height)
        low, high = 1000, 1255
        greys, wanted, worst = set(), set(), 0
        for x, y, z, red, green, blue in shown:
            voxel = self.voxel_of((x, y, z))
            base = numpy.floor(voxel).astype(int)
            if (base < 0).any() or (base + 1 >= self.scan.shape).any():
                continue
            value = 0
            for corner in numpy.ndindex(2, 2, 2):
                weight = numpy.prod(numpy.where(corner, voxel - base, 1 - (voxel - base)))
                value += weight * self.scan[tuple(base + corner)]
            expected = 255 * min(1, max(0, (value - low) / (high - low)))
            self.assertTrue(red == green == blue, (red, green, blue))
            worst = max(worst, abs(red - expected))
            greys.add(red)
            wanted.add(round(expected))
        print(f"  {len(greys)} greys of {len(wanted)}, at most {worst:.2f} of 255 off", flush=True)
        self.assertLessEqual(worst, 1)
        self.assertGreater(len(wanted), 100)
        self.assertGreaterEqual(len(greys), len(wanted) - 2)


    def test_a_slice_is_chosen_by_its_number_and_by_keys(self):
        self.addCleanup(self.page.click, "[data-layout=two]")
        self.show_all_planes()
        # once the page has drawn a slice it is the one that is shown
        choose = """const number = document.querySelector("#picture-axial .slices input[type=number]");
            number.value = arguments[0];
            number.dispatchEvent(new Event("change"));
            palpateViewer.draw();
            return [palpateViewer.plane("axial"), palpateViewer.plane("coronal"), Number(number.value)];"""
        press = """const slider = document.querySelector("#picture-axial .slices input[type=range]");
            slider.dispatchEvent(new KeyboardEvent("keydown", { key: arguments[0], cancelable: true, bubbles: true }));
            palpateViewer.draw();
            return [palpateViewer.plane("axial"), palpateViewer.plane("coronal"), Number(slider.value)];"""
        step = numpy.linalg.norm(self.patient_from_voxel[:3, 0])
        corners = [(self.patient_from_voxel @ [*numpy.multiply(corner, numpy.subtract(self.labels.shape, 1)), 1])[2] for corner in numpy.ndindex(2, 2, 2)]
        count = round((max(corners) - min(corners)) / step) + 1
        self.assertEqual(self.page.run("return document.querySelector('#picture-axial .slices span').textContent"), f"/ {count}")
        others = []
        for script, asked, slice_ in ((choose, 20, 20), (choose, 26, 26), (press, "ArrowDown", 27), (press, "PageUp", 17), (press, "End", count), (press, "ArrowDown", count), (choose, -3, 1)):
            axial, coronal, shown = self.page.run(script, asked)
            self.assertEqual(shown, slice_)
            self.assertAlmostEqual(axial["centre"][2], min(corners) + (slice_ - 1) * step, 6)
            others.append(coronal["centre"][1])
        # it rests there, where the tip moves on, and the other planes rest too
        self.assertEqual(len(set(others)), 1)
        self.assertEqual(self.page.run("return document.getElementById('follow').getAttribute('aria-pressed')"), "false")
        # the middle of the slider is the middle slice
        left, top, width, height = self.box("#picture-axial .track")
        self.page.pointer({"type": "pointerMove", "x": round(left + width / 2), "y": round(top + 4)}, {"type": "pointerDown", "button": 0},
                          {"type": "pointerMove", "x": round(left + width / 2), "y": round(top + height / 2), "duration": 100}, {"type": "pointerUp", "button": 0})
        self.assertLessEqual(abs(self.page.run("palpateViewer.draw(); return Number(document.querySelector('#picture-axial .slices input').value)") - (count + 1) / 2), 0.01 * count + 1)

    def linear(self, voxels):
        """The scan between voxels, and whether it has a value there."""
        last = numpy.array(self.scan.shape) - 1
        within = numpy.clip(voxels, 0, last)
        low = numpy.minimum(within.astype(int), last - 1)
        share = within - low
        value = sum(numpy.prod(numpy.where(corner, share, 1 - share), axis=-1) * self.scan[tuple(numpy.moveaxis(low + corner, -1, 0))] for corner in numpy.ndindex(2, 2, 2))
        return value, ((voxels >= -0.5) & (voxels <= last + 0.5)).all(-1)

    @campaign
    def test_a_slab_is_its_mean_its_largest_or_its_least_value(self):
        reset = "for (const [id, value, type] of [['slab', 'none', 'change'], ['fill', 0.45, 'input']]) { const one = document.getElementById(id); one.value = value; one.dispatchEvent(new Event(type)); }"
        self.addCleanup(self.page.click, "[data-layout=two]")
        self.addCleanup(self.page.run, reset + "document.getElementById('outlines').click()")
        self.show_all_planes()
        self.page.run("document.getElementById('outlines').click()")
        self.slide("#fill", 0)
        self.slide("#slab-mm", 14)
        self.follow(False)
        self.page.run("const n = document.querySelector('#picture-axial .slices input[type=number]'); n.value = 20; n.dispatchEvent(new Event('change'))")
        low, high, mm = 1000, 1255, 14
        # two for each voxel that it goes through
        samples = 2 * math.ceil(abs(numpy.linalg.inv(self.patient_from_voxel)[:3, :3] @ [0, 0, mm]).max()) + 1
        seen = {}
        for kind, of in (("mean", numpy.ma.mean), ("maximum", numpy.ma.max), ("minimum", numpy.ma.min)):
            shown = numpy.array(self.page.run("""
                const slab = document.getElementById("slab");
                slab.value = arguments[0];
                slab.dispatchEvent(new Event("change"));
                palpateViewer.draw();
                const { width, height } = document.querySelector("#picture-axial canvas");
                const shown = [];
                for (let y = 9; y < height; y += 11) for (let x = 3; x < width; x += 4) shown.push([...palpateViewer.patientAt("axial", x + 0.5, y + 0.5), ...palpateViewer.colourAt("axial", x, y)]);
                return shown;""", kind))
            patient = shown[:, None, :3] + numpy.outer(numpy.linspace(-mm / 2, mm / 2, samples), [0, 0, 1])
            inverse = numpy.linalg.inv(self.patient_from_voxel)
            value, inside = self.linear(patient @ inverse[:3, :3].T + inverse[:3, 3])
            expected = 255 * numpy.clip((of(numpy.ma.array(value, mask=~inside), axis=1) - low) / (high - low), 0, 1)
            # at the very border a rounding decides what is in
            clear = (self.linear(patient @ inverse[:3, :3].T + inverse[:3, 3] + 1e-3)[1] == inside).all(1) & (self.linear(patient @ inverse[:3, :3].T + inverse[:3, 3] - 1e-3)[1] == inside).all(1)
            chosen = clear & inside.any(1)
            off = abs(shown[chosen, 3] - expected[chosen]).max()
            print(f"  {kind}: {chosen.sum()} pixels, at most {off:.2f} of 255 off", flush=True)
            self.assertGreater(chosen.sum(), 200)
            self.assertLessEqual(off, 1)
            seen[kind] = shown[chosen, 3].mean()
        self.assertGreater(seen["maximum"], seen["mean"] + 3)
        self.assertLess(seen["minimum"], seen["mean"] - 3)

    @campaign
    def test_turns_views_and_bookmarks_are_undone(self):
        stack = "#picture-volume .stack"
        key = f"document.querySelector('{stack}').dispatchEvent(new KeyboardEvent('keydown', {{ key: arguments[0], altKey: arguments[1] ?? false }}))"
        seen = "palpateViewer.draw(); return [[0, 0, 0], [20, 5, -11]].flatMap((p) => palpateViewer.project(p))"
        turned = "palpateViewer.state.rotation_wxyz"
        self.assertEqual(self.page.run("return " + turned), [1, 0, 0, 0])
        self.addCleanup(lambda: (self.page.run("document.getElementById('unturn').click()"), self.page.wait("palpateViewer.pose.rotation[0] > 0.9999999")))
        views = [self.page.run(seen)]

        def step(do):
            do()
            views.append(self.page.run(seen))
            self.assertGreater(numpy.abs(numpy.subtract(views[-1], views[-2])).max(), 1)
        # a preset, a drag, a run of the wheel and a key: a step each
        step(lambda: self.page.click("[data-look=left]"))
        step(lambda: self.drag(stack, 50, 20))
        step(lambda: self.page.run(f"for (let n = 0; n < 3; n++) document.querySelector('{stack}').dispatchEvent(new WheelEvent('wheel', {{ deltaY: 90, cancelable: true }}))"))
        step(lambda: self.page.run(key, "ArrowRight"))
        for view in views[-2::-1]:
            self.page.click("#undo")
            self.assertLess(numpy.abs(numpy.subtract(self.page.run(seen), view)).max(), 1e-3)
        self.page.click("#redo")
        self.assertLess(numpy.abs(numpy.subtract(self.page.run(seen), views[1])).max(), 1e-3)
        # a turn is asked for again
        self.page.run(key, "ArrowRight", True)
        self.page.wait(turned + "[0] < 0.9999")
        self.page.wait("palpateViewer.state.rotation_wxyz[2] !== 0 && !document.getElementById('undo').disabled")
        self.page.click("#undo")
        self.page.wait(turned + "[0] > 0.9999999")
        # a bookmark that was made, and one that was deleted
        names = "return [...document.querySelectorAll('#bookmarks .figure')].map((one) => one.textContent)"
        before = self.page.run(names)
        self.page.run("document.getElementById('bookmark-form').closest('details').open = true; document.getElementById('bookmark-name').value = 'notch'; document.querySelector('#bookmark-form button').click()")
        self.assertEqual(self.page.run(names), [*before, "notch"])
        self.page.run("document.querySelector('#bookmarks li:last-child button:last-child').click()")
        for wanted in ([*before, "notch"], before):
            self.page.click("#undo")
            self.assertEqual(self.page.run(names), wanted)

    @campaign
    def test_planes_window_perspective_and_the_scope_are_undone(self):
        self.follow(False)
        # the picture from within is made when it is first shown
        self.page.click("[data-layout=inside]")
        self.page.wait("document.querySelector('#picture-scope canvas')?.width > 50")
        self.show_all_planes()
        axial, oblique, scope = (f"document.querySelector('#picture-{kind} .stack')" for kind in ("axial", "oblique", "scope"))
        key = "for (let n = 0; n < arguments[1]; n++) %s.dispatchEvent(new KeyboardEvent('keydown', { key: arguments[0], repeat: n > 0 }))"
        wheel = "for (let n = 0; n < 3; n++) %s.dispatchEvent(new WheelEvent('wheel', { deltaY: 90, ctrlKey: %s, cancelable: true }))"
        choose = "const one = document.querySelector(arguments[0]); one.value = arguments[1]; one.dispatchEvent(new Event('change', { bubbles: true }))"
        state = """palpateViewer.draw();
            const pixels = ["axial", "oblique"].flatMap((kind) => [...palpateViewer.patientAt(kind, 0, 0), ...palpateViewer.patientAt(kind, 100, 100)]);
            const input = (selector) => { const one = document.querySelector(selector); return one.type === "checkbox" ? one.checked : one.value; };
            const inputs = ["#level", "#width", "#cutting", "#perspective", "#planes-in-volume", "#picture-scope select:nth-of-type(1)", "#picture-scope select:nth-of-type(2)"].map(input);
            const free = ![...document.querySelectorAll("#picture-scope button")].at(-1).disabled;
            const { project } = palpateViewer;
            return { pixels, inputs, free, frame: free ? palpateViewer.scopeFrame.forward : [0, 0, 0], project: [[0, 0, 0], [20, 5, -11]].flatMap((p) => project(p)) };"""
        flat = lambda seen: [*seen["pixels"], *seen["frame"], *seen["project"]]  # noqa: E731
        rest = lambda seen: (seen["inputs"], seen["free"])  # noqa: E731
        # the browser may have kept it open, from the test before
        menu = "document.querySelector('#picture-volume details').open = "
        self.page.run(menu + "true")
        self.addCleanup(lambda: (self.page.click("[data-layout=two]"), self.page.run(menu + "false")))
        steps = [
            # a run of the wheel and a key that is held, each a step
            lambda: self.page.run(wheel % (axial, "true")),
            lambda: self.page.run(wheel % (axial, "false")),
            lambda: self.page.run(key % axial, "PageDown", 3),
            lambda: self.page.run(key % oblique, "+", 2),
            # brightness and contrast, by a drag and as a number; and a drag that moves a plane's picture
            lambda: self.drag("#picture-oblique .stack", 40, 30),
            lambda: self.page.run(choose, "#level", "1100"),
            lambda: self.drag("#picture-axial .stack", 30, 20, button=1),
            # a slice of its own
            lambda: self.page.run(choose, "#picture-axial .slices input[type=number]", "7"),
            lambda: self.page.click("#perspective"),
            lambda: self.page.run(choose, "#cutting", "plane"),
            lambda: self.page.click("#planes-in-volume"),
            lambda: self.page.run(choose, "#picture-scope select:nth-of-type(2)", "70"),
        ]
        inside = [
            lambda: self.page.run(key % scope, "ArrowRight", 4),
            lambda: self.page.run(key % scope, "ArrowUp", 1),
            lambda: self.page.run(choose, "#picture-scope select:nth-of-type(1)", "15"),
        ]
        for layout, acts in (("five", steps), ("inside", inside)):
            self.page.click(f"[data-layout={layout}]")
            self.page.run("palpateViewer.draw()")
            time.sleep(0.3)
            seen = [self.page.run(state)]
            for act in acts:
                act()
                time.sleep(0.15)  # the figures are written ten times a second
                seen.append(self.page.run(state))
                is_other = rest(seen[-1]) != rest(seen[-2]) or numpy.abs(numpy.subtract(flat(seen[-1]), flat(seen[-2]))).max() > 1e-3
                self.assertTrue(is_other, f"{layout}, step {len(seen) - 1}")
            self.assertGreater(len(seen), 3)
            for button, wanted in [("#undo", one) for one in seen[-2::-1]] + [("#redo", seen[1])]:
                self.page.click(button)
                time.sleep(0.15)
                now = self.page.run(state)
                self.assertEqual(rest(now), rest(wanted), f"{layout}, to {seen.index(wanted)}")
                self.assertLess(numpy.abs(numpy.subtract(flat(now), flat(wanted))).max(), 1e-3, f"{layout}, to {seen.index(wanted)}")

    def test_measures_are_listed_named_found_and_written_as_a_table(self):
        self.follow(False)
        self.page.click("[data-tool=ruler]")
        self.addCleanup(self.page.click, "#clear")
        self.drag("#picture-oblique .stack", 60, 10, begin=(0.4, 0.5))
        self.drag("#picture-oblique .stack", 20, 50, begin=(0.5, 0.6))
        self.page.wait("palpateViewer.measures.length === 2")
        names = "return [...document.querySelectorAll('#measures input')].map((name) => name.value)"
        self.assertEqual([name.split()[0] for name in self.page.run(names)], ["Ruler", "Ruler"])
        points = self.page.run("return palpateViewer.measures")
        lengths = [float(text.split()[0]) for text in self.page.run("return [...document.querySelectorAll('#measures .figure')].map((one) => one.textContent)")]
        for (a, b), length in zip(points, lengths):
            self.assertLess(abs(numpy.linalg.norm(numpy.subtract(b, a)) / length - 1), 0.006)
        self.page.run("const name = document.querySelectorAll('#measures input')[1]; name.value = 'notch, deep'; name.dispatchEvent(new Event('change'))")
        # a field that is done with does not keep the space bar from being the emergency stop
        self.page.run("document.querySelectorAll('#measures input')[1].focus()")
        self.page.press("\ue007")
        self.assertEqual(self.page.run("return [document.activeElement.className, document.activeElement.title]"), ["figure", "Go to notch, deep"])
        # led to where it is, from another slice
        self.page.run("document.querySelector('#picture-oblique .stack').dispatchEvent(new KeyboardEvent('keydown', { key: 'PageDown' })); palpateViewer.draw()")
        self.assertGreater(self.page.run("return palpateViewer.pixelOf('oblique', arguments[0]).off_mm", points[1][0]), 5)
        self.page.run("document.querySelectorAll('#measures .figure')[1].click(); palpateViewer.draw()")
        for point in points[1]:
            self.assertLess(self.page.run("return palpateViewer.pixelOf('oblique', arguments[0]).off_mm", point), 1e-3)
        with tempfile.TemporaryDirectory(prefix="palpate-download-") as folder:
            self.page.developer_tools("Browser.setDownloadBehavior", behavior="allow", downloadPath=folder)
            self.page.click("#measures-csv")
            deadline = time.monotonic() + 300
            while not [name for name in os.listdir(folder) if name.endswith(".csv")]:
                self.assertLess(time.monotonic(), deadline)
                time.sleep(0.1)
            with open(os.path.join(folder, os.listdir(folder)[0]), encoding="utf-8", newline="") as file:
                rows = list(csv.DictReader(file))
        self.assertEqual([rows[1][key] for key in ("name", "kind", "plane", "angle_deg")], ["notch, deep", "ruler", "oblique", ""])
        for n, row in enumerate(rows):
            for p, point in enumerate(points[n]):
                self.assertLess(numpy.linalg.norm(numpy.subtract([float(row[f"{axis}{p + 1}_lps_mm"]) for axis in "xyz"], point)), 1e-3)
        self.page.run("document.querySelector('#measures button:last-child').click()")
        self.assertEqual(self.page.run(names), ["notch, deep"])
        self.page.click("#undo")
        self.assertEqual(len(self.page.run(names)), 2)

    @campaign
    def test_a_measure_stays_where_it_was_made(self):
        self.page.click("[data-tool=ruler]")
        left, top, width, height = self.box("#picture-oblique .stack")
        begin, end = ((round(left + part * width), round(top + 0.55 * height)) for part in (0.4, 0.6))
        tip = "palpateViewer.pose.devices[0].tip"
        moved = "(window.before ??= %s, Math.abs(%s.reduce((sum, x, c) => sum + (x - window.before[c]) * palpateViewer.plane('oblique').normal[c], 0)) > 4)" % (tip, tip)
        at = "palpateViewer.draw(); return [palpateViewer.patientAt('oblique', ...arguments), palpateViewer.plane('oblique')]"
        click = lambda x, y: self.page.pointer({"type": "pointerMove", "x": x, "y": y}, {"type": "pointerDown", "button": 0}, {"type": "pointerUp", "button": 0})  # noqa: E731
        click(*begin)
        first, plane = self.page.run(at, begin[0] - left, begin[1] - top)
        self.page.wait(moved)
        click(*end)
        self.page.wait("palpateViewer.measures.length === 1")
        points = self.page.run("return palpateViewer.measures[0]")
        # both on the plane of the first click, and as far apart as was seen
        across = numpy.subtract(points[1], points[0])
        mm_per_pixel = numpy.linalg.norm(numpy.subtract(*self.page.run("return [0, 1].map((x) => palpateViewer.patientAt('oblique', x, 0))")))
        self.assertLess(abs(numpy.dot(across, plane["normal"])), 1e-6)
        self.assertAlmostEqual(numpy.linalg.norm(across), (end[0] - begin[0]) * mm_per_pixel, 6)
        self.assertLess(numpy.linalg.norm(numpy.subtract(points[0], first)), 1e-6)
        # then the plane follows again, and the measure stays
        self.page.run("delete window.before")
        self.page.wait(moved)
        self.page.run("palpateViewer.draw()")
        self.assertEqual(self.page.run("return palpateViewer.measures[0]"), points)
        # as strong as it was made on planes that contain it, faint beside, not at all far from it
        self.follow(False)
        strength = """palpateViewer.draw();
            const canvas = document.querySelectorAll("#picture-oblique canvas")[1];
            const copy = new OffscreenCanvas(canvas.width, canvas.height).getContext("2d", { willReadFrequently: true });
            copy.drawImage(canvas, 0, 0);
            const { data } = copy.getImageData(0, 0, canvas.width, canvas.height);
            let most = 0;
            for (let i = 0; i < data.length; i += 4) if ([142, 226, 138].every((x, c) => Math.abs(x - data[i + c]) < 16)) most = Math.max(most, data[i + 3]);
            return [palpateViewer.pixelOf("oblique", arguments[0]).off_mm, most];"""
        step = "document.querySelector('#picture-oblique .stack').dispatchEvent(new WheelEvent('wheel', { deltaY: arguments[0], cancelable: true }))"
        off, _ = self.page.run(strength, points[0])
        self.page.run(step, 120)
        way = 120 if self.page.run(strength, points[0])[0] < off else -120
        seen = {}
        for _ in range(60):
            off, seen_strength = self.page.run(strength, points[0])
            seen[round(off, 2)] = seen_strength
            if min(seen) < 1.16 and off > 14:
                break
            self.page.run(step, way)
        print("  by distance: " + ", ".join(f"{off}: {most}" for off, most in sorted(seen.items())), flush=True)
        for off, most in seen.items():
            if off < 1.1:
                self.assertGreater(most, 240, seen)
            elif 1.3 < off < 11.9:
                self.assertTrue(0 < most < 240, seen)
            elif off > 12.1:
                self.assertEqual(most, 0, seen)
        self.assertTrue(min(seen) < 1.16 and max(seen) > 13, seen)
        self.page.click("#clear")


if __name__ == "__main__":
    viewer_page.main(sys.argv[1:], sys.modules["__main__"])
