"""Changes the layout of the pictures from each to each, in headless Chromium, and looks at the pixels.

usage: layout_test.py NODE MOCK_SERVER PAGE

Exit code 77 (a skip) where there is no browser, except in CI, where that is a failure.
"""

import base64
import os
import sys
import time

sys.dont_write_bytecode = True  # nothing is left in the source tree
import browser  # noqa: E402
import viewer_page  # noqa: E402
from viewer_page import numpy  # noqa: E402

LAYOUTS = ["two", "five", "volume", "section", "inside", "scope"]
# each visible picture: name, size, and its pixels, reduced to 48 columns and rows by their means
PICTURES = """
    return [...document.querySelectorAll(".picture")].filter((one) => one.clientWidth > 0).map((one) => {
      const canvas = one.querySelector("canvas");
      const small = new OffscreenCanvas(48, 48).getContext("2d", { willReadFrequently: true });
      small.imageSmoothingQuality = "high";
      small.drawImage(canvas, 0, 0, 48, 48);
      return [one.id.slice(8), [one.querySelector(".stack").clientWidth, one.querySelector(".stack").clientHeight],
              [canvas.width, canvas.height], btoa(String.fromCharCode(...small.getImageData(0, 0, 48, 48).data))];
    });"""


def pixels(encoded):
    return numpy.frombuffer(base64.b64decode(encoded), numpy.uint8).reshape(48, 48, 4)[:, :, :3].astype(float)


def shape(picture, size):
    """Width over height of what is brighter than the background, or None where it reaches the picture's edge.

    They are standard deviations of the brightness, because a border moves by whole pixels, of which a narrow picture has few.
    """
    light = numpy.clip(picture.max(2) - 40, 0, None)
    bright = light > 0
    rows, columns = numpy.flatnonzero(bright.any(1)), numpy.flatnonzero(bright.any(0))
    if rows.size == 0 or min(rows[0], columns[0]) == 0 or max(rows[-1], columns[-1]) == 47:
        return None
    at = numpy.arange(48)
    spreads = [numpy.sqrt(numpy.cov(at, aweights=light.sum(axis), ddof=0)) for axis in (0, 1)]
    return spreads[0] * size[0] / (spreads[1] * size[1])


class Layouts(viewer_page.Viewer):
    limits_frame_rate = False

    @classmethod
    def setUpClass(cls):
        cls.server = viewer_page.Server("pointer").__enter__()
        cls.addClassCleanup(cls.server.__exit__)
        cls.open_browser()

    def setUp(self):
        super().setUp()
        # the coronal plane through the tip, which starts in front of the knee, shows air
        self.choose("five")
        self.redrawn()
        self.page.run("""const number = document.querySelector("#picture-coronal .slices input[type=number]");
            number.value = 50;
            number.dispatchEvent(new Event("change"));""")

    def choose(self, layout):
        self.page.run("document.querySelector(`[data-layout=${arguments[0]}]`).click()", layout)

    def redrawn(self):
        self.page.wait("palpateViewer.isRedrawn")
        return {name: (size, drawn, pixels(data)) for name, size, drawn, data in self.page.run(PICTURES)}

    def test_each_change_of_the_layout_shows_the_same_pictures(self):
        first = {}
        for layout in LAYOUTS:
            self.choose(layout)
            first[layout] = self.redrawn()
            for name, (size, drawn, picture) in first[layout].items():
                self.assertEqual(size, drawn, (layout, name))
                self.assertGreater(picture.std(), 12, f"{name} in {layout} is empty")
        stretched = 0
        for before in LAYOUTS:
            for after in LAYOUTS:
                with self.subTest(before=before, after=after):
                    self.choose(before)
                    self.redrawn()
                    self.choose(after)
                    # pictures on the way: never empty, and never stretched
                    for _ in range(4):
                        for name, size, drawn, data in self.page.run(PICTURES):
                            if size != drawn:
                                continue  # the canvas has the size of the layout before, until the next frame
                            picture = pixels(data)
                            self.assertGreater(picture.std(), 5, f"{name} is empty on the way")
                            whole, now = shape(first[after][name][2], size), shape(picture, size)
                            if name == "volume" and whole and now:
                                stretched += 1
                                self.assertLess(abs(now / whole - 1), 0.15, f"{name} is stretched")
                        time.sleep(0.02)
                    there = self.redrawn()
                    self.assertEqual(set(there), set(first[after]))
                    for name, (size, drawn, picture) in there.items():
                        self.assertEqual(size, drawn, name)
                        self.assertLess(numpy.abs(picture - first[after][name][2]).mean(), 4, f"{name} is another picture")
        self.assertGreater(stretched, 20, "the volume's shape was measured too seldom")

    def test_a_screenshot_right_after_a_change_has_all_pictures(self):
        for before, after in (("section", "two"), ("scope", "five"), ("volume", "inside")):
            with self.subTest(before=before, after=after):
                self.choose(before)
                self.redrawn()
                url = self.run_async(f"document.querySelector('[data-layout={after}]').click(); palpateViewer.screenshot().then(done);")
                _, _, shot = viewer_page.decode_png(base64.b64decode(url.split(",")[1]))
                boxes = self.page.run("""const area = document.getElementById("pictures").getBoundingClientRect();
                    return [...document.querySelectorAll(".picture")].filter((one) => one.clientWidth > 0).map((one) => {
                      const { left, top, width, height } = one.getBoundingClientRect();
                      return [one.id.slice(8), ...[left - area.left, top - area.top + 30, width, height].map(Math.round)];
                    });""")
                self.assertGreater(len(boxes), 1)
                for name, left, top, width, height in boxes:
                    share = (shot[top:top + height, left:left + width, :3].max(2) > 60).mean()
                    self.assertGreater(share, 0.05, f"{name} is missing")


if __name__ == "__main__":
    if len(sys.argv) < 4:
        sys.exit(__doc__)
    node, mock, page = (os.path.abspath(argument) if n else argument for n, argument in enumerate(sys.argv[1:4]))
    del sys.argv[1:4]
    viewer_page.use_mock(node, mock, page)
    browser.run_tests(viewer_page.NUMPY_NEEDED)
