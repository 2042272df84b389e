"""Opens the page without a server in headless Chromium: palpate runs in a worker, presses are felt, soft tissue deforms, a burr
removes bone, and nothing leaves the origin. Prints the rate of ticks and the lengths of the worker's steps.

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
import unittest.mock
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


# served before the worker's script: measures palpate's steps, and sends them to the page
PROBE = """
{
  const instantiate = WebAssembly.instantiate;
  WebAssembly.instantiate = async (...all) => {
    const { instance, module } = await instantiate(...all);
    const channel = new BroadcastChannel("palpate-steps");
    let steps = [];
    const palpate_step = () => {
      const begin = performance.now(), more = instance.exports.palpate_step();
      steps.push([begin, performance.now()]);
      if (steps.length === 100) channel.postMessage(steps.splice(0));
      return more;
    };
    return { instance: { exports: { ...instance.exports, palpate_step } }, module };
  };
}
"""


class Static(http.server.SimpleHTTPRequestHandler):
    """Serves the folder at /a/folder/ only."""

    def translate_path(self, path):
        path = urlsplit(path).path
        return super().translate_path(path.removeprefix("/a/folder") if path.startswith("/a/folder/") else "/missing")

    def do_GET(self):
        if "palpate_worker" not in self.path:
            return super().do_GET()
        script = PROBE.encode() + pathlib.Path(self.translate_path(self.path)).read_bytes()
        self.send_response(200)
        self.send_header("Content-Type", "text/javascript")
        self.send_header("Content-Length", str(len(script)))
        self.end_headers()
        self.wfile.write(script)

    def log_message(self, *_):
        pass


class InBrowser(unittest.TestCase):
    def setUp(self):
        server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Static, directory=FOLDER))
        threading.Thread(target=server.serve_forever, daemon=True).start()
        self.addCleanup(server.server_close)
        self.addCleanup(server.shutdown)
        self.origin = f"http://127.0.0.1:{server.server_port}"
        self.log = os.path.join(tempfile.mkdtemp(prefix="palpate-static-"), "net.json")
        self.enterContext(unittest.mock.patch.object(browser, "ARGUMENTS", browser.ARGUMENTS + ["--log-net-log=" + self.log]))
        self.page = browser.Browser().__enter__()
        self.addCleanup(lambda: self.page and self.page.__exit__())

    def open(self, scene):
        """Opens a scene by its name in the address; seconds until it can be touched."""
        begun = time.monotonic()
        self.page.post("/url", {"url": f"{self.origin}/a/folder/?scene={scene}"})
        self.wait_until_ready()
        return time.monotonic() - begun

    def wait_until_ready(self):
        self.page.wait("window.palpateViewer && palpateViewer.isLoaded && palpateViewer.state && palpateViewer.state.pointer && palpateViewer.isVolumeSharp")
        self.page.run("window.steps = []; new BroadcastChannel('palpate-steps').onmessage = ({ data }) => steps.push(...data)")

    def check_requests(self):
        """Page and workers requested files of their folder only. Ends the browser, which completes its log of the network."""
        page, self.page = self.page, None
        page.__exit__()
        events = [event.get("params", {}) for event in json.loads(pathlib.Path(self.log).read_text())["events"]]
        # the browser's own requests have no origin
        requested = {params["url"] for params in events if "url" in params and params.get("initiator") == self.origin}
        self.assertTrue(any(url.endswith("/palpate.wasm") for url in requested), "the log lacks the worker's requests")
        self.assertEqual([], [url for url in sorted(requested) if not url.startswith(self.origin + "/a/folder/")])

    def press(self, name):
        """Presses in the picture of the volume where the middle of a structure is; the label of that structure."""
        place = self.page.run(MIDDLE, name)
        left, top, width, height = self.page.run(
            "const b = document.querySelector('#picture-volume .stack').getBoundingClientRect();"
            "return [b.left, b.top, b.width, b.height]")
        x, y = self.page.run("return palpateViewer.project(arguments[0])", place["middle"])
        self.at = round(left + width / 2 + x), round(top + height / 2 + y)
        self.page.pointer({"type": "pointerMove", "x": self.at[0], "y": self.at[1]}, {"type": "pointerDown", "button": 0})
        self.page.wait("Math.hypot(...palpateViewer.pose.devices[0].force) > 0")
        return place["label"]

    def slide(self, by):
        self.page.pointer({"type": "pointerMove", "x": self.at[0] + by, "y": self.at[1], "duration": 200})

    def measured(self, what, seconds=3, act=lambda n: None):
        """Ticks a second and the worker's steps while something is done; prints them. Returns the rate."""
        self.page.run("steps.length = 0")
        ticks, begun, n = self.page.run("return palpateViewer.pose.tick"), time.monotonic(), 0
        while time.monotonic() - begun < seconds:
            act(n)
            n += 1
            time.sleep(0.05)
        rate_hz = (self.page.run("return palpateViewer.pose.tick") - ticks) / (time.monotonic() - begun)
        steps = self.page.run("return steps.splice(0)")
        intervals = sorted(after[0] - before[0] for before, after in zip(steps, steps[1:]))
        lengths = sorted(end - begin for begin, end in steps)
        at = lambda of, part: of[min(len(of) - 1, int(part * len(of)))]  # noqa: E731
        print(f"{what}: {rate_hz:.0f} ticks/s; between steps {at(intervals, 0.5):.1f} ms in the median, p99 {at(intervals, 0.99):.1f}, "
              f"at most {intervals[-1]:.1f}; a step takes p99 {at(lengths, 0.99):.1f} ms, at most {lengths[-1]:.1f}")
        self.assertGreater(rate_hz, MIN_RATE_HZ)
        return rate_hz

    def test_a_press_is_felt_and_nothing_leaves_the_origin(self):
        self.page.post("/url", {"url": self.origin + "/a/folder/"})
        self.page.wait("document.querySelector('#scenes button')")
        begun = time.monotonic()
        self.page.click("#scenes button")
        self.wait_until_ready()
        label = self.press("patella")
        self.page.wait(f"palpateViewer.pose.devices[0].label === {label}")
        touched_s = time.monotonic() - begun
        print(f"from the click to the first touch {touched_s:.1f} s")
        self.measured("pressing a patella")
        force_N = self.page.run("return Math.hypot(...palpateViewer.pose.devices[0].force)")
        if PICTURE:
            self.page.screenshot(PICTURE)
        self.page.pointer({"type": "pointerUp", "button": 0})
        # the emergency stop passes the same protocol
        self.page.press(" ")
        self.page.wait("palpateViewer.state.emergency_stop")
        self.assertGreater(force_N, 0.1)
        self.check_requests()

    def test_soft_tissue_deforms(self):
        print(f"palpation block: {self.open('lump'):.1f} s until it can be touched")
        self.press("soft_tissue")
        self.page.wait("palpateViewer.isDeformed")
        self.measured("pressing soft tissue")
        self.measured("sliding over soft tissue", act=lambda n: self.slide(40 if n % 2 else -40))
        cells = self.page.run("return palpateViewer.state.law_cells")
        print(f"cells of {cells['mm']:.2f} mm, the scene requests {cells['requested_mm']:.2f}")
        said = self.page.run("return document.getElementById('law-cells').textContent")
        self.assertEqual(cells["mm"] > cells["requested_mm"], said != "", "coarser cells are said in the page")
        self.check_requests()

    def test_a_burr_removes_bone_and_the_stroke_is_undone(self):
        print(f"temporal bone: {self.open('mastoid'):.1f} s until it can be touched")
        self.page.click("#motor")
        self.page.wait("palpateViewer.state.motor_is_on")
        self.press("temporal_bone")
        self.page.wait("palpateViewer.state.removed.some(({ mm3 }) => mm3 > 1)")
        self.measured("milling", act=lambda n: self.slide(20 if n % 2 else -20))
        self.page.pointer({"type": "pointerUp", "button": 0})
        self.page.click("#motor")
        self.page.wait("!palpateViewer.state.motor_is_on && palpateViewer.state.strokes.undo === 1")
        self.page.click("#undo-stroke")
        self.page.wait("palpateViewer.state.strokes.redo === 1 && palpateViewer.state.removed.every(({ mm3 }) => mm3 === 0)")
        self.check_requests()


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    FOLDER = os.path.abspath(sys.argv.pop(1))
    PICTURE = sys.argv.pop(1) if len(sys.argv) > 1 and not sys.argv[1].startswith("-") else None
    browser.run_tests(None if os.path.exists(os.path.join(FOLDER, "assets", "palpate.wasm")) else "`make web` has not been run")
