"""Opens the report of the example run in headless Chromium and uses it as a reader would.

usage: report_test.py REPORT_EXAMPLE    (a program that writes its report to the file it is given)

Exit code 77 (a skip) where there is no browser, except in CI, where that is a failure.
"""

import os
import re
import subprocess
import sys
import tempfile
import time
import unittest

sys.dont_write_bytecode = True  # nothing is left in the source tree
import browser  # noqa: E402

program = None


class ReportInABrowser(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory(prefix="palpate-report-")
        cls.addClassCleanup(folder.cleanup)
        cls.file = os.path.join(folder.name, "report.html")
        subprocess.run([program, cls.file], check=True)
        cls.page = browser.Browser().__enter__()
        cls.addClassCleanup(cls.page.__exit__)

    def setUp(self):
        self.page.dark(False)
        self.page.resize(1280, 900)
        self.page.log()
        self.page.open(self.file)
        self.page.wait("document.readyState === 'complete' && document.querySelectorAll('.uplot').length === 3")

    def tearDown(self):
        # an error, a refused style or script, or a request is a message in the console
        self.assertEqual(self.page.log(), [])

    def painted(self, colour):
        """How many pixels of each plot's canvas are close to a theme colour."""
        return self.page.run(
            """const wanted = getComputedStyle(document.documentElement).getPropertyValue("--" + arguments[0]).trim();
               const [r, g, b] = [1, 3, 5].map((i) => parseInt(wanted.slice(i, i + 2), 16));
               return [...document.querySelectorAll(".uplot canvas")].map((canvas) => {
                 const copy = new OffscreenCanvas(canvas.width, canvas.height);
                 const context = copy.getContext("2d", { willReadFrequently: true });
                 context.drawImage(canvas, 0, 0);
                 const { data } = context.getImageData(0, 0, canvas.width, canvas.height);
                 let count = 0;
                 for (let i = 0; i < data.length; i += 4) {
                   const off = Math.abs(data[i] - r) + Math.abs(data[i + 1] - g) + Math.abs(data[i + 2] - b);
                   if (data[i + 3] > 200 && off < 40) count += 1;
                 }
                 return count;
               });""", colour)

    def curves(self):
        """Pixels of each plot's own curve."""
        return [self.painted(colour)[plot] for plot, colour in enumerate(("force", "depth", "speed"))]

    def selected(self):
        return self.page.run(
            """return { tab: document.querySelector("[aria-selected=true]").textContent.trim(),
                        focus: document.activeElement.id,
                        visible: [...document.querySelectorAll(".panel")].filter((p) => !p.hidden)
                                   .map((p) => p.querySelector("h3").textContent.trim()) };""")

    def test_notice_is_always_visible(self):
        self.page.run("scrollTo(0, document.documentElement.scrollHeight)")
        box = self.page.run("const b = document.querySelector('.banner').getBoundingClientRect();"
                            "return [b.top, b.bottom, innerHeight]")
        self.assertEqual(box[0], 0)
        self.assertGreater(box[1], 20)
        text = self.page.run("return document.querySelector('.banner').innerText")
        self.assertIn("not for clinical use", text)
        self.assertIn("Simulated hand", text)

    def test_nothing_is_fetched(self):
        requests = self.page.run("return performance.getEntriesByType('resource').map((entry) => entry.name)")
        self.assertEqual([name for name in requests if not name.startswith("data:")], [])
        with open(self.file, encoding="utf-8") as page:
            html = page.read()
        # the plotting library's licence line names its home; nothing else looks like an address
        self.assertEqual(re.findall(r"\w+://[^\s\"')]+", html), ["https://github.com/leeoniya/uPlot"])

    def test_policy_stops_what_is_not_part_of_the_page(self):
        ran = self.page.run(
            """const script = document.createElement("script");
               script.textContent = "window.intruder = true";
               document.body.append(script);
               return window.intruder === true;""")
        self.assertFalse(ran)
        refusals = self.page.log()
        self.assertEqual(len(refusals), 1)
        self.assertIn("Content Security Policy", refusals[0]["message"])

    def test_plots_are_drawn(self):
        self.assertGreater(min(self.curves()), 500)
        self.assertGreater(self.painted("limit")[0], 200)

    def test_plots_follow_the_colour_scheme(self):
        light = self.page.run("return getComputedStyle(document.body).backgroundColor")
        self.page.dark(True)
        self.page.wait(f"getComputedStyle(document.body).backgroundColor !== '{light}'")
        # drawn again with the next frame
        deadline = time.monotonic() + 120
        while min(self.curves()) < 500 and time.monotonic() < deadline:
            time.sleep(0.02)
        self.assertGreater(min(self.curves()), 500)

    def test_plots_follow_the_width(self):
        for width in (820, 1280):
            self.page.resize(width, 900)
            self.page.wait("Math.abs(document.querySelector('.uplot').clientWidth - "
                           "document.getElementById('plot-force').clientWidth) <= 1")
            self.assertLessEqual(self.page.run("return document.documentElement.scrollWidth"), width)

    def zoom_shown(self):
        """The time under the cursor at the left and the right end of the first plot, by its legend."""
        ends = []
        for side in (2, -2):
            x, y = self.page.run(
                """const over = document.querySelector(".u-over");
                   over.scrollIntoView({ block: "center" });
                   const box = over.getBoundingClientRect();
                   return [Math.round(arguments[0] > 0 ? box.left + 2 : box.right - 2), Math.round(box.top + 50)];""", side)
            self.page.pointer({"type": "pointerMove", "x": x, "y": y})
            # the plots draw their legends in a later frame; until then one without a cursor is "-"
            self.page.wait("[...document.querySelectorAll('.u-legend')].every((l) => "
                           "l.querySelector('.u-value').textContent !== '-')")
            legends = self.page.run(
                "return [...document.querySelectorAll('.u-legend')].map((l) => l.querySelector('.u-value').textContent)")
            self.assertEqual(len(set(legends)), 1, "the cursors move together")
            ends.append(float(legends[0].split(" s")[0]))
        return ends

    def test_drag_zooms_all_plots_and_double_click_resets(self):
        begin, end = self.zoom_shown()
        self.assertAlmostEqual(begin, 0, delta=0.1)
        self.assertAlmostEqual(end, 9.6, delta=0.1)

        left, width, y = self.page.run(
            "const b = document.querySelector('.u-over').getBoundingClientRect();"
            "return [Math.round(b.left), Math.round(b.width), Math.round(b.top + 60)]")
        self.page.pointer({"type": "pointerMove", "x": left + width // 4, "y": y},
                          {"type": "pointerDown", "button": 0},
                          {"type": "pointerMove", "x": left + width // 2, "y": y, "duration": 100},
                          {"type": "pointerUp", "button": 0})
        begin, end = self.zoom_shown()
        self.assertAlmostEqual(begin, 2.4, delta=0.1)
        self.assertAlmostEqual(end, 4.8, delta=0.1)

        click = [{"type": "pointerDown", "button": 0}, {"type": "pointerUp", "button": 0}]
        self.page.pointer({"type": "pointerMove", "x": left + 100, "y": y}, *click, *click)
        begin, end = self.zoom_shown()
        self.assertAlmostEqual(end - begin, 9.6, delta=0.2)

    def test_a_contact_is_found_in_the_plots(self):
        self.page.click("#tab-2")
        self.page.click("#zoom-contact")
        begin, end = self.zoom_shown()
        # the patella is touched from 5.37 to 6.69 s
        self.assertTrue(4.9 < begin < 5.37, begin)
        self.assertTrue(6.69 < end < 7.2, end)

    def test_tabs_work_with_mouse_and_keyboard(self):
        self.assertEqual(self.selected()["visible"], ["tibia"])
        self.page.click("#tab-2")
        self.assertEqual(self.selected(), {"tab": "patella", "focus": "tab-2", "visible": ["patella"]})
        self.page.press(browser.ARROW_RIGHT)
        self.assertEqual(self.selected(), {"tab": "fibula", "focus": "tab-3", "visible": ["fibula"]})
        self.page.press(browser.ARROW_RIGHT)  # around the end
        self.assertEqual(self.selected()["tab"], "tibia")
        self.page.press(browser.ARROW_LEFT)
        self.assertEqual(self.selected()["tab"], "fibula")
        self.page.press(browser.HOME)
        self.assertEqual(self.selected()["tab"], "tibia")
        self.page.press(browser.END)
        self.assertEqual(self.selected()["tab"], "fibula")
        # one stop on the way through the page, as tabs ought to be
        self.assertEqual(self.page.run("return document.querySelectorAll('[role=tab][tabindex=\"0\"]').length"), 1)

    def test_sections_carry_what_a_reader_needs(self):
        sections = self.page.run(
            """return [...document.querySelectorAll(".panel")].map((panel) =>
                 [...panel.querySelectorAll(".section")].map((section) => ({
                   caption: section.querySelector("figcaption span").textContent,
                   texts: [...section.querySelectorAll("text")].map((t) => t.textContent),
                   decoded: [...section.querySelectorAll("img")].every((i) => i.complete && i.naturalWidth === 400),
                   contact: section.querySelectorAll(".contact").length,
                   force: section.querySelectorAll(".force, .end-on").length,
                 })));""")
        letters = {"Axial": ["R", "L", "A", "P"], "Coronal": ["R", "L", "S", "I"], "Sagittal": ["A", "P", "S", "I"]}
        self.assertEqual(len(sections), 4)
        for panel in sections:
            self.assertEqual([section["caption"] for section in panel], list(letters))
            for section in panel:
                self.assertEqual(section["texts"], ["10 mm", *letters[section["caption"]], "Side: LEFT"])
                self.assertTrue(section["decoded"])
                self.assertEqual(section["contact"], 1)
                self.assertGreaterEqual(section["force"], 1)

    def test_side_mark_is_no_orientation_letter(self):
        """It stands clear of every letter, in the lower right corner."""
        boxes = self.page.run(
            """const box = (text) => { const { left, top, right, bottom } = text.getBoundingClientRect();
                                       return [left, top, right, bottom]; };
               return [...document.querySelectorAll("#contact-0 .section svg")].map((svg) => ({
                 picture: box(svg), side: box(svg.querySelector(".side-mark")),
                 others: [...svg.querySelectorAll(".letter, .scale-text")].map(box),
               }));""")
        self.assertEqual(len(boxes), 3)
        for section in boxes:
            left, top, right, bottom = section["side"]
            picture = section["picture"]
            self.assertLess(picture[2] - right, 20)
            self.assertLess(picture[3] - bottom, 20)
            self.assertGreater(top, 0.85 * picture[3] + 0.15 * picture[1])
            for other in section["others"]:
                apart = other[2] < left or other[0] > right or other[3] < top or other[1] > bottom
                self.assertTrue(apart, (section["side"], other))

    def test_what_was_not_reached_is_in_view(self):
        card = self.page.run("return document.querySelector('.card.notice').innerText")
        self.assertIn("Script steps that failed", card)
        self.assertIn("asked for 2.00 N, felt 1.50 N on patella", card)

    def test_structures_and_marks_can_be_hidden(self):
        opacity = "return getComputedStyle(document.querySelector('.structures')).opacity"
        self.assertEqual(self.page.run(opacity), "1")
        self.page.run("document.getElementById('structures').focus()")
        self.page.press(browser.HOME)
        self.assertEqual(self.page.run(opacity), "0")
        marks = "return getComputedStyle(document.querySelector('.marks')).display"
        self.assertNotEqual(self.page.run(marks), "none")
        self.page.click("#marks")
        self.assertEqual(self.page.run(marks), "none")

    def test_every_contact_is_on_paper(self):
        self.page.developer_tools("Emulation.setEmulatedMedia", media="print")
        try:
            heights = self.page.run("return [...document.querySelectorAll('.panel')].map((p) => p.clientHeight)")
        finally:
            self.page.developer_tools("Emulation.setEmulatedMedia", media="")
        self.assertEqual(len(heights), 4)
        self.assertGreater(min(heights), 100)


class MilledReportInABrowser(unittest.TestCase):
    def test_what_was_removed_is_drawn_in_light_and_dark(self):
        with tempfile.TemporaryDirectory(prefix="palpate-report-") as folder, browser.Browser() as page:
            file = os.path.join(folder, "milled.html")
            subprocess.run([program, file, "milled"], check=True)
            page.resize(1280, 900)
            page.open(file)
            for dark in (False, True):
                page.dark(dark)
                page.wait("document.querySelectorAll('.uplot').length === 4")
                # each curve in its structure's colour, which is legible on either card
                legend, drawn = page.run(
                    """const plot = document.getElementById("plot-removed");
                       const canvas = plot.querySelector("canvas");
                       const copy = new OffscreenCanvas(canvas.width, canvas.height);
                       const context = copy.getContext("2d", { willReadFrequently: true });
                       context.drawImage(canvas, 0, 0);
                       const { data } = context.getImageData(0, 0, canvas.width, canvas.height);
                       const drawn = [[220, 140, 90], [200, 110, 150]].map((wanted) => {
                         let count = 0;
                         for (let i = 0; i < data.length; i += 4)
                           if (data[i + 3] > 200 && wanted.every((c, n) => Math.abs(data[i + n] - c) < 40)) count += 1;
                         return count;
                       });
                       return [[...plot.querySelectorAll(".u-legend .u-label")].map((l) => l.textContent), drawn];""")
                self.assertEqual([name.strip(": ") for name in legend], ["Time", "tibia", "patella"])
                self.assertGreater(min(drawn), 300, f"dark: {dark}")
            table = page.run("return document.querySelector('section[aria-labelledby=removal-title]').innerText")
            for text in ("What was removed", "Motor switched on", "2.00 s", "All"):
                self.assertIn(text, table)
            self.assertEqual(page.log(), [])


class PlannedReportInABrowser(unittest.TestCase):
    def test_plan_and_way_are_drawn_with_their_distances(self):
        with tempfile.TemporaryDirectory(prefix="palpate-report-") as folder, browser.Browser() as page:
            file = os.path.join(folder, "planned.html")
            subprocess.run([program, file, "planned"], check=True)
            page.resize(1280, 900)
            page.open(file)
            page.wait("document.querySelectorAll('.uplot').length === 4")
            legend, lines, text = page.run(
                """const card = document.querySelector("section[aria-labelledby=plan-title]");
                   const lines = [...card.querySelectorAll("line.planned")].map((line) => {
                     const { width, height } = line.getBoundingClientRect();
                     return [Math.max(width, height), getComputedStyle(line).stroke];
                   });
                   const names = document.querySelectorAll("#plot-clearance .u-legend .u-label");
                   return [[...names].map((name) => name.textContent), lines, card.innerText];""")
            # what is to be kept away from comes first
            self.assertEqual([name.strip(": ") for name in legend][:2], ["Time", "fibula"])
            self.assertEqual(len(legend), 6)
            # in each of two sections the trajectory, 5 of 40 mm, and the bar at its entry
            self.assertEqual(len(lines), 4)
            for length, stroke in lines:
                self.assertGreater(length, 8)
                self.assertEqual(stroke, "rgb(92, 224, 138)")
            for words in ("Plan and result", "way & target", "not kept", "Planned mm\u00b3"):
                self.assertIn(words, text)
            self.assertEqual(page.log(), [])


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    program = sys.argv.pop()
    browser.run_tests()
