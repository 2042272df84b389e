"""Opens the page without a server in headless Chromium: palpate runs in a worker, a press is felt, own files are read in the
page, and nothing leaves the origin.

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
import struct
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


# drops files, of [name, bytes in base64], on the page
DROP = """
const transfer = new DataTransfer();
for (const [name, text] of arguments[0])
  transfer.items.add(new File([Uint8Array.from(atob(text), (c) => c.charCodeAt(0))], name));
document.body.dispatchEvent(new DragEvent("drop", { dataTransfer: transfer, bubbles: true, cancelable: true }));
"""
READY = ("window.palpateViewer && palpateViewer.isLoaded && palpateViewer.state && palpateViewer.state.pointer && "
         "palpateViewer.isVolumeSharp")


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
        cls.addClassCleanup(lambda: cls.page and cls.page.__exit__())

    def requested(self):
        """URLs that the page and its workers requested; ends the browser, which completes its log of the network."""
        type(self).page = self.page.__exit__()
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

    def start(self):
        self.page.post("/url", {"url": self.origin + "/a/folder/"})
        self.page.wait("document.querySelector('#scenes button')")

    def drop(self, **files):
        """Drops files, whose names have __ for a dot."""
        self.page.run(DROP, [[name.replace("__", "."), base64.b64encode(content).decode()] for name, content in files.items()])

    def refusal(self):
        """What the page says about files that it refuses, beside the choice that it offers again."""
        self.page.wait("document.querySelector('#scenes button') && document.getElementById('cover-text').textContent.includes('could not')")
        return self.page.run("return document.getElementById('cover-text').textContent")

    def test_1_a_dropped_nifti_is_felt(self):
        self.start()
        self.assertIn("Nothing is uploaded", self.page.run("return document.getElementById('scenes').textContent"))
        # its only structure is named by its file
        self.drop(femur__nii__gz=nifti_ball())
        self.page.wait(READY)
        self.press("femur")
        self.page.pointer({"type": "pointerUp", "button": 0})

    def test_2_a_dropped_segmentation_of_layers_is_felt(self):
        self.start()
        self.drop(case__seg__nrrd=nrrd_balls())
        self.page.wait(READY)
        names = self.page.run("return palpateViewer.scene.structures.map((one) => one.name)")
        self.assertEqual(["femur", "tumour"], sorted(name for name in names if name))
        self.press("femur")
        self.page.pointer({"type": "pointerUp", "button": 0})

    def test_3_what_is_refused_is_explained_and_the_page_goes_on(self):
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

    def test_4_files_are_picked_and_a_table_names_them(self):
        knee = next((file for root in os.environ.get("PALPATE_DATA", "").split(":") if root
                     for file in pathlib.Path(root).glob("knee_dess/*label.nrrd")), None)
        self.start()
        if knee is None:
            with tempfile.TemporaryDirectory() as folder:
                files = pathlib.Path(folder, "case.nii.gz"), pathlib.Path(folder, "case.tsv")
                files[0].write_bytes(nifti_ball())
                files[1].write_text("value\tname\n1\tpatella\n")
                self.page.type("#own-files", "\n".join(map(str, files)))
                self.page.wait(READY)
        else:
            begun = time.monotonic()
            self.page.type("#own-files", f"{knee}\n{knee.with_name('labels.tsv')}")
            self.page.wait(READY)
        self.press("patella")
        if knee:
            print(f"from the choice of {knee.name} to the first touch {time.monotonic() - begun:.1f} s, load {os.getloadavg()[0]:.1f}")
        self.page.pointer({"type": "pointerUp", "button": 0})

    def test_5_a_press_is_felt_and_nothing_leaves_the_origin(self):
        self.start()
        begun = time.monotonic()
        self.page.click("#scenes button")
        self.page.wait(READY)
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
    lack = browser.missing() or (not os.path.exists(os.path.join(FOLDER, "assets", "palpate.wasm")) and "`make web` has not been run")
    if lack:
        print("skipped: " + lack)
        sys.exit(1 if os.environ.get("CI") == "true" else 77)
    unittest.main(verbosity=2)
