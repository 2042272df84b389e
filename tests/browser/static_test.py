"""Opens the page without a server in headless Chromium: palpate runs in a worker, a press is felt, and nothing leaves the origin.

usage: static_test.py FOLDER [PICTURE]

FOLDER is what `make web` writes. It is served from a path below the root by a server that knows nothing of palpate. PICTURE
receives a screenshot. Exit code 77 (a skip) where there is no browser or no folder, except in CI, where that is a failure.
"""

import functools
import http.server
import json
import os
import pathlib
import sys
import tempfile
import threading
import time
import unittest
from urllib.parse import urlsplit

sys.dont_write_bytecode = True  # nothing is left in the source tree
import browser  # noqa: E402

FOLDER = PICTURE = None
TOUCH_WITHIN_S = 10
MIN_RATE_HZ = 500
# middle of a structure's voxels, every third of which is looked at
MIDDLE = """
const scene = palpateViewer.scene, [ni, nj, nk] = scene.volume.dims, m = scene.volume.patient_from_voxel;
const wanted = scene.structures.findIndex(({ name }) => name === arguments[0]), sum = [0, 0, 0];
let count = 0;
for (let k = 0; k < nk; k += 3) for (let j = 0; j < nj; j += 3) for (let i = 0; i < ni; i += 3) {
  const p = [0, 1, 2].map((r) => m[r][0] * i + m[r][1] * j + m[r][2] * k + m[r][3]);
  if (palpateViewer.structureAt(p) !== wanted) continue;
  count += 1;
  p.forEach((x, axis) => (sum[axis] += x));
}
return { middle: sum.map((x) => x / count), label: scene.structures[wanted].label };
"""


class Static(http.server.SimpleHTTPRequestHandler):
    """Serves the folder at /a/folder/ only."""

    def translate_path(self, path):
        path = urlsplit(path).path
        return super().translate_path(path.removeprefix("/a/folder") if path.startswith("/a/folder/") else "/missing")

    def log_message(self, *_):
        pass


class InBrowser(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Static, directory=FOLDER))
        threading.Thread(target=server.serve_forever, daemon=True).start()
        cls.addClassCleanup(server.server_close)
        cls.addClassCleanup(server.shutdown)
        cls.origin = f"http://127.0.0.1:{server.server_port}"
        cls.log = os.path.join(tempfile.mkdtemp(prefix="palpate-static-"), "net.json")
        browser.ARGUMENTS.append("--log-net-log=" + cls.log)
        cls.page = browser.Browser().__enter__()

    def requested(self):
        """URLs that the page and its workers requested; ends the browser, which completes its log of the network."""
        self.page.__exit__()
        events = [event.get("params", {}) for event in json.loads(pathlib.Path(self.log).read_text())["events"]]
        # the browser's own requests have no origin
        return {params["url"] for params in events if "url" in params and params.get("initiator") == self.origin}

    def press(self, name):
        """Presses in the picture of the volume where the middle of a structure is; seconds until there is force."""
        place = self.page.run(MIDDLE, name)
        left, top, width, height = self.page.run(
            "const b = document.querySelector('#picture-volume .stack').getBoundingClientRect();"
            "return [b.left, b.top, b.width, b.height]")
        x, y = self.page.run("return palpateViewer.project(arguments[0])", place["middle"])
        self.page.pointer({"type": "pointerMove", "x": round(left + width / 2 + x), "y": round(top + height / 2 + y)},
                          {"type": "pointerDown", "button": 0})
        self.page.wait(f"palpateViewer.pose.devices[0].label === {place['label']} && "
                       "Math.hypot(...palpateViewer.pose.devices[0].force) > 0")

    def test_a_press_is_felt_and_nothing_leaves_the_origin(self):
        self.page.post("/url", {"url": self.origin + "/a/folder/"})
        self.page.wait("document.querySelector('#scenes button')")
        begun = time.monotonic()
        self.page.click("#scenes button")
        self.page.wait("window.palpateViewer && palpateViewer.isLoaded && palpateViewer.state && palpateViewer.state.pointer && palpateViewer.isVolumeSharp")
        self.press("patella")
        touched_s = time.monotonic() - begun
        ticks, before = self.page.run("return palpateViewer.pose.tick"), time.monotonic()
        time.sleep(2)
        rate_hz = (self.page.run("return palpateViewer.pose.tick") - ticks) / (time.monotonic() - before)
        force_N = self.page.run("return Math.hypot(...palpateViewer.pose.devices[0].force)")
        if PICTURE:
            self.page.screenshot(PICTURE)
        self.page.pointer({"type": "pointerUp", "button": 0})
        # the emergency stop passes the same protocol
        self.page.press(" ")
        self.page.wait("palpateViewer.state.emergency_stop")
        print(f"from the click to the first touch {touched_s:.1f} s; {rate_hz:.0f} ticks/s; pressed with {force_N:.2f} N")
        self.assertGreater(force_N, 0.1)
        self.assertGreater(rate_hz, MIN_RATE_HZ)
        requested = self.requested()
        self.assertTrue(any(url.endswith("/palpate.wasm") for url in requested), "the log lacks the worker's requests")
        self.assertEqual([], [url for url in sorted(requested) if not url.startswith(self.origin + "/a/folder/")])


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    FOLDER = os.path.abspath(sys.argv.pop(1))
    PICTURE = sys.argv.pop(1) if len(sys.argv) > 1 and not sys.argv[1].startswith("-") else None
    browser.run_tests(None if os.path.exists(os.path.join(FOLDER, "assets", "palpate.wasm")) else "`make web` has not been run")
