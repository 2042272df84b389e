"""Opens the page without a server in headless Chromium: palpate runs in a worker, presses are felt, soft tissue deforms, a burr
removes bone, own files are read in the page, and nothing leaves the origin. Prints the rate of ticks and the lengths of the
worker's steps.

usage: static_test.py FOLDER [PICTURE]

FOLDER is what `make web` writes. It is served from a path below the root by a server that knows nothing of palpate. PICTURE
receives a screenshot. Exit code 77 (a skip) where there is no browser or no folder, except in CI, where that is a failure.
"""

import base64
import functools
import gzip
import http.server
import json
import os
import pathlib
import random
import struct
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
      steps.push([begin, performance.now(), instance.exports.memory.buffer.byteLength]);
      if (steps.length === 100) channel.postMessage(steps.splice(0));
      return more;
    };
    return { instance: { exports: { ...instance.exports, palpate_step } }, module };
  };
}
"""
# drops files, of [name, bytes in base64], on the page
DROP = """
const transfer = new DataTransfer();
for (const [name, text] of arguments[0])
  transfer.items.add(new File([Uint8Array.from(atob(text), (c) => c.charCodeAt(0))], name));
document.body.dispatchEvent(new DragEvent("drop", { dataTransfer: transfer, bubbles: true, cancelable: true }));
"""
READY = ("window.palpateViewer && palpateViewer.isLoaded && palpateViewer.state && palpateViewer.state.pointer && "
         "palpateViewer.isVolumeSharp")
REFUSED = "document.querySelector('#scenes button') && document.getElementById('cover-text').textContent.includes('could not')"
SEED = int(os.environ.get("PALPATE_TEST_SEED", "20261130"))
# number of randomly damaged files that are dropped
MUTATIONS = int(os.environ.get("PALPATE_MUTATIONS", "300"))


def ball(voxels, radius):
    """Bytes of a ball in a cube of voxels: 1 inside, 0 outside."""
    middle = (voxels - 1) / 2
    return bytes((i - middle) ** 2 + (j - middle) ** 2 + (k - middle) ** 2 <= radius ** 2
                 for k in range(voxels) for j in range(voxels) for i in range(voxels))


def nifti_ball(voxels=40, radius=14):
    """A NIfTI-1 of a ball of label 1, voxels of 1.5 mm."""
    header = bytearray(352)
    struct.pack_into("<i", header, 0, 348)
    struct.pack_into("<8h", header, 40, 3, voxels, voxels, voxels, 1, 1, 1, 1)
    struct.pack_into("<hh", header, 70, 2, 8)
    struct.pack_into("<8f", header, 76, *[1.5] * 8)
    struct.pack_into("<f", header, 108, 352)
    header[123] = 2
    struct.pack_into("<hh", header, 252, 0, 1)
    struct.pack_into("<12f", header, 280, -1.5, 0, 0, 0, 0, -1.5, 0, 0, 0, 0, 1.5, 0)
    header[344:348] = b"n+1\0"
    return gzip.compress(bytes(header) + ball(voxels, radius))


def nrrd_balls(voxels=40):
    """A .seg.nrrd of two segments, one within the other, each in its layer."""
    layers = zip(ball(voxels, 16), ball(voxels, 8))
    header = (f"NRRD0004\ntype: uint8\ndimension: 4\nspace: LPS\nsizes: 2 {voxels} {voxels} {voxels}\n"
              "space directions: none (1.5,0,0) (0,1.5,0) (0,0,1.5)\nkinds: list domain domain domain\nencoding: gzip\n"
              "space origin: (0,0,0)\nSegment0_Name:=femur\nSegment0_Layer:=0\nSegment0_LabelValue:=1\n"
              "Segment1_Name:=tumour\nSegment1_Layer:=1\nSegment1_LabelValue:=1\n\n")
    return header.encode() + gzip.compress(bytes(value for pair in layers for value in pair))


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
        self.page.wait(READY)
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
        lengths = sorted(end - begin for begin, end, _ in steps)
        at = lambda of, part: of[min(len(of) - 1, int(part * len(of)))]  # noqa: E731
        print(f"{what}: {rate_hz:.0f} ticks/s; between steps {at(intervals, 0.5):.1f} ms in the median, p99 {at(intervals, 0.99):.1f}, "
              f"at most {intervals[-1]:.1f}; a step takes p99 {at(lengths, 0.99):.1f} ms, at most {lengths[-1]:.1f}")
        self.assertGreater(rate_hz, MIN_RATE_HZ)
        return rate_hz

    def start(self):
        self.page.post("/url", {"url": self.origin + "/a/folder/"})
        self.page.wait("document.querySelector('#scenes button')")

    def drop(self, **files):
        """Drops files, whose names have __ for a dot."""
        self.page.run(DROP, [[name.replace("__", "."), base64.b64encode(content).decode()] for name, content in files.items()])

    def refusal(self):
        """What the page says about files that it refuses, beside the choice that it offers again."""
        self.page.wait(REFUSED)
        return self.page.run("return document.getElementById('cover-text').textContent")

    def test_a_dropped_nifti_is_felt(self):
        self.start()
        self.assertIn("Nothing is uploaded", self.page.run("return document.getElementById('scenes').textContent"))
        # its only structure is named by its file
        self.drop(femur__nii__gz=nifti_ball())
        self.wait_until_ready()
        self.press("femur")
        self.check_requests()

    def test_a_dropped_segmentation_of_layers_is_felt(self):
        self.start()
        self.drop(case__seg__nrrd=nrrd_balls())
        self.page.wait(READY)
        names = self.page.run("return palpateViewer.scene.structures.map((one) => one.name)")
        self.assertEqual(["femur", "tumour"], sorted(name for name in names if name))
        self.press("femur")

    def test_what_is_refused_is_explained_and_the_page_goes_on(self):
        self.start()
        self.drop(femur__nii__gz=nifti_ball()[:-500])
        self.assertIn("femur.nii.gz: the voxel data end after", self.refusal())
        self.drop(picture__png=b"\x89PNG\r\n\x1a\n" + bytes(50))
        self.assertIn("picture.png: is a picture", self.refusal())
        self.drop(a__nrrd=b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 800 800 800\nencoding: gzip\n\n" + bytes(600_000))
        refusal = self.refusal()
        self.assertIn("512000000 voxels", refusal)
        self.assertIn("MiB", refusal)
        self.drop(a__nii__gz=nifti_ball(), b__nii__gz=nifti_ball(), c__nii__gz=nifti_ball())
        self.assertIn("third of 3 volumes", self.refusal())
        # structures without a name that is known all feel alike
        self.drop(case__nii__gz=nifti_ball())
        self.page.wait(READY)
        self.assertIn("feel alike", self.page.run("return document.getElementById('caveats').textContent"))

    def test_files_are_picked_and_a_table_names_them(self):
        self.start()
        with tempfile.TemporaryDirectory() as folder:
            files = pathlib.Path(folder, "case.nii.gz"), pathlib.Path(folder, "case.tsv")
            files[0].write_bytes(nifti_ball())
            files[1].write_text("value\tname\n1\tpatella\n")
            self.page.type("#own-files", "\n".join(map(str, files)))
            self.wait_until_ready()
        self.press("patella")
        self.check_requests()

    def test_the_shared_knee_is_felt(self):
        knees = [file for root in os.environ.get("PALPATE_DATA", "").split(":") if root
                 for file in pathlib.Path(root).glob("knee_dess/*label.nrrd")]
        for knee in knees:
            self.start()
            begun = time.monotonic()
            self.page.type("#own-files", f"{knee}\n{knee.with_name('labels.tsv')}")
            self.page.wait(READY)
            self.wait_until_ready()
            self.press("patella")
            print(f"from the choice of {knee.name} to the first touch {time.monotonic() - begun:.1f} s, load {os.getloadavg()[0]:.1f}")
            self.measured("pressing the shared knee")
            self.page.wait("steps.length")
            print(f"memory of the worker {self.page.run('return steps.at(-1)[2]') / 2 ** 20:.0f} MiB")
            self.check_requests()

    def test_damaged_files_get_one_message_each_and_the_page_goes_on(self):
        print(f"PALPATE_TEST_SEED={SEED}")
        numbers = random.Random(SEED)
        whole = {"a.nii.gz": nifti_ball(16, 5), "a.nii": gzip.decompress(nifti_ball(16, 5)), "a.seg.nrrd": nrrd_balls(16)}
        messages, opened = {}, 0
        self.start()
        for _ in range(MUTATIONS):
            name = numbers.choice(sorted(whole))
            content = bytearray(whole[name])
            # most of the damage is in the header, where it is not only a different voxel
            for _ in range(numbers.randint(1, 8)):
                content[numbers.randrange(min(len(content), numbers.choice((60, 400, len(content)))))] = numbers.randrange(256)
            if numbers.random() < 0.3:
                del content[numbers.randrange(len(content)):]
            self.page.run(DROP, [[name, base64.b64encode(content).decode()]])
            self.page.wait(f"({READY}) || ({REFUSED})")
            if self.page.run(f"return !!({READY})"):
                opened += 1
                self.start()
                continue
            message = self.page.run("return document.getElementById('cover-text').textContent")
            messages[message] = messages.get(message, 0) + 1
            for trap in ("unreachable", "out of bounds", "bug:"):
                self.assertNotIn(trap, message)
        print(f"{MUTATIONS} damaged files: {opened} opened, {sum(messages.values())} refused with {len(messages)} messages")
        self.assertGreater(len(messages), 10)
        self.check_requests()

    def test_a_press_is_felt_and_nothing_leaves_the_origin(self):
        self.start()
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
