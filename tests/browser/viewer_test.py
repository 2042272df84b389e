"""Opens the viewer page in headless Chromium against a running server and uses it as a person would.

usage: viewer_test.py [--campaigns] palpate PALPATE [TEST ...]          (`palpate explore knee-phantom`, coarse)
       viewer_test.py [--campaigns] mock NODE MOCK_SERVER PAGE_FOLDER [TEST ...]

Without TEST the journeys, or the campaigns. What the page decides, writes and asks for without a picture, a layout or real input is tested in
Node (web/test/page_*.test.ts).

Exit code 77 (a skip) where there is no browser, except in CI, where that is a failure.
"""

import base64
import csv
import json
import math
import os
import random
import signal
import struct
import subprocess
import sys
import tempfile
import time
import unittest
import urllib.request
import zlib

sys.dont_write_bytecode = True  # nothing is left in the source tree
import browser  # noqa: E402

try:
    import numpy
except ImportError:
    numpy = None

# Always the software renderer (SwiftShader), also with a graphics card, so that pictures are equal everywhere;
# compositing is done without the GPU. Chromium reports the resulting read-backs in the console (WAITS_FOR_PICTURES).
WITHOUT_WEBGL = [*browser.ARGUMENTS, "--disable-software-rasterizer"]
browser.ARGUMENTS = [argument for argument in browser.ARGUMENTS if argument != "--disable-gpu"] + [
    "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist", "--disable-gpu-compositing"]
WAITS_FOR_PICTURES = "GL Driver Message (OpenGL, Performance"
# from one picture to the next, where tests look at few of them
LEAST_FRAME_MS = 250
SIZE = (1024, 640)  # a small one: the pictures are computed by the processor
LOADED = "window.palpateViewer !== undefined && palpateViewer.isLoaded && palpateViewer.isFresh"
# of the pixel under the tip: how many structures are looked for, and at how many places; all of it is 8 structures
STRUCTURES, POSITIONS = int(os.environ.get("PALPATE_TEST_STRUCTURES", "3")), 3
# of the page while it is busy; a measurement takes 100
STOPS = int(os.environ.get("PALPATE_TEST_STOPS", "20"))
AXE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "web", "node_modules", "axe-core", "axe.min.js")
# maximum size of the page's files fetched until the first section is drawn, uncompressed and as sent; without session
# data and voxels
MOST_PAGE_BYTES = 250_000
HOOK = "/assets/viewer_test_hook.js"  # which only a browser that a test drives fetches
BLENDING, INSIDE = 1 << 15, 1 << 17  # of a pose's flags

command = None  # of the server: (port, input, token file, ...) -> arguments


def campaign(test):
    """Marks a test of the nightly lane: it repeats a journey's check at many places, or takes long."""
    test.is_campaign = True
    return test


class Lane(unittest.TestLoader):
    """Loads the journeys or the campaigns of a class; a test given by name is always run."""

    campaigns = False

    def getTestCaseNames(self, case):
        return [name for name in super().getTestCaseNames(case) if hasattr(getattr(case, name), "is_campaign") == self.campaigns]


def test_seed():
    """The same in every run unless PALPATE_TEST_SEED says another, or "any" (src/core/base/test_seed.h)."""
    asked = os.environ.get("PALPATE_TEST_SEED", "20261121")
    return random.randrange(1 << 30) if asked == "any" else int(asked)


def palpate_command(program):
    def arguments(port, source, tokens):
        # as a developer's machine with other work to do would run it: no lateness is asserted here
        spacing = 0.7 if source == "pointer in finer voxels" else 1.2
        return [program, "explore", f"knee-phantom:spacing={spacing}", "--port", str(port), "--seconds", "600",
                *(["--device", "pointer"] if source.startswith("pointer") else ["--repeat"]),
                *(["--token-file", tokens] if tokens else [])]
    return arguments


def simulated(folder):
    """A recording of some seconds, made by the palpate that is tested, with an edit in it."""
    program = command(0, "pointer", None)[0]
    script, recording = os.path.join(folder, "script.toml"), os.path.join(folder, "run.h5")
    with open(script, "w", encoding="utf-8") as out:
        out.write("\n".join(f'[[step]]\napproach = "{name}"\n[[step]]\npress = 0.8\n[[step]]\nhold = 3.0\n[[step]]\nleave = true'
                            for name in ("patella", "tibia")))
    subprocess.run([program, "-q", "simulate", "knee-phantom:spacing=1.2", "-s", script, "-o", recording], check=True,
                   stdout=subprocess.DEVNULL)
    return program, recording


def mock_command(node, mock, page):
    with open(os.path.join(page, "index.html"), encoding="utf-8"):
        pass  # says so when it is not there
    folder = tempfile.TemporaryDirectory(prefix="palpate-page-")
    os.mkdir(os.path.join(folder.name, "assets"))
    for name in (name for name in os.listdir(page) if name.endswith((".html", ".js", ".css", ".svg"))):
        place = folder.name if name == "index.html" else os.path.join(folder.name, "assets")
        os.symlink(os.path.join(os.path.abspath(page), name), os.path.join(place, name))
    unittest.addModuleCleanup(folder.cleanup)

    def arguments(port, source, tokens):
        return [node, mock, "--port", str(port), "--input", source, "--page", folder.name, "--kept", folder.name,
                *(["--token-file", tokens] if tokens else [])]
    return arguments


class Server:
    """A context manager; `restart` on the same port."""

    def __init__(self, source, tokens=None, extra=()):
        self.port, self.source, self.tokens, self.extra = browser.free_port(), source, tokens, list(extra)
        self.url = f"http://127.0.0.1:{self.port}/"
        self.log = tempfile.TemporaryFile()

    def __enter__(self):
        self.log.seek(0)
        self.process = subprocess.Popen(self.command(), stdin=subprocess.DEVNULL,
                                        stdout=self.log, stderr=self.log)
        deadline = time.monotonic() + 300
        while True:
            try:
                self.get("")
                return self
            except OSError:
                pass
            if self.process.poll() is not None or time.monotonic() > deadline:
                self.log.seek(0)
                raise RuntimeError("the server does not answer: " + self.log.read().decode())
            time.sleep(0.1)

    def command(self):
        return command(self.port, self.source, self.tokens) + self.extra

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGCONT)
            self.process.terminate()
            try:
                self.process.wait(20)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
        self.log.close()

    def get(self, path, token=None):
        request = urllib.request.Request(self.url + path, headers={"Authorization": f"Bearer {token}"} if token else {})
        with urllib.request.build_opener(urllib.request.ProxyHandler({})).open(request, timeout=300) as answer:
            data = answer.read()
            return zlib.decompress(data, 31) if answer.headers.get("Content-Encoding") == "gzip" else data

    def scene(self):
        return json.loads(self.get("api/scene"))

    def labels(self, scene):
        """Array [i, j, k] and the affine from voxels to the patient."""
        volume = scene["volume"]
        voxels = numpy.frombuffer(self.get("api/volume/labels/" + volume["hash"]), volume["labels"]["type"])
        return voxels.reshape(volume["dims"][::-1]).transpose(2, 1, 0), numpy.array(volume["patient_from_voxel"])


def speak(page, language):
    """Chooses a language, and waits for its words, which are fetched."""
    page.run("const choice = document.getElementById('language'); choice.value = arguments[0]; choice.dispatchEvent(new Event('change'))", language)
    page.wait(f"document.documentElement.lang === '{language}'")
    page.run("palpateViewer.draw()")


def rotation_matrix(q):
    w, x, y, z = q
    return numpy.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])


class Viewer(unittest.TestCase):
    """Opens the page of a server; every message in the browser's console is a failure."""

    page = None  # the browser
    server = None
    expected = ()  # parts of messages that a test brings about
    draws_seldom = True  # not where it matters what goes on while it draws

    @classmethod
    def open_browser(cls, own=False):
        """Uses the browser shared by all classes, because starting one costs as much as a test; `own` starts a separate
        one for tests whose effects cannot be undone."""
        if own:
            cls.page = browser.Browser().__enter__()
            cls.addClassCleanup(cls.page.__exit__)
            return
        if Viewer.page is None:
            Viewer.page = browser.Browser().__enter__()
            unittest.addModuleCleanup(Viewer.page.__exit__)
        # left before its server ends, or it says so in the next test
        cls.addClassCleanup(Viewer.page.post, "/url", {"url": "about:blank"})

    def open_page(self, wait=LOADED, keeps=False):
        """@param keeps  what the browser has kept of the page until now"""
        if not keeps:
            # stops the page that is still open from storing more. It is replaced directly: via about:blank Chromium
            # drops the first two touch points after a slider was touched.
            self.page.run("try { localStorage.clear(); } catch { /* the browser's first page has none */ } Storage.prototype.setItem = () => {};")
        self.page.dark(True)
        self.page.resize(*SIZE)
        self.page.log()
        self.page.post("/url", {"url": self.server.url})
        if wait:
            self.page.wait(wait)
            if self.draws_seldom:
                self.page.run(f"palpateViewer.leastFrame_ms = {LEAST_FRAME_MS}")

    def serve(self, *source, **options):
        """A server for this test alone."""
        self.server = Server(*source, **options).__enter__()
        self.addCleanup(self.server.__exit__)
        # before that, or it misses its server and says so in the next test
        self.addCleanup(self.page.post, "/url", {"url": "about:blank"})

    def setUp(self):
        self.expected = ()
        self.open_page()

    def tearDown(self):
        messages = [entry["message"] for entry in self.page.log()]
        expected = (*self.expected, WAITS_FOR_PICTURES)
        self.assertEqual([m for m in messages if not any(part in m for part in expected)], [])

    def run_async(self, script):
        return self.page.post("/execute/async", {"script": "const done = arguments[arguments.length - 1];" + script, "args": []})

    def assert_light(self):
        """What the page weighs: the files that it took to draw the first section."""
        files = self.page.run("""const shown_ms = performance.getEntriesByName("first-section")[0].startTime;
            return [...performance.getEntriesByType("navigation"), ...performance.getEntriesByType("resource")]
              .map(({ name, startTime, decodedBodySize, encodedBodySize }) => [new URL(name).pathname, startTime, decodedBodySize, encodedBodySize])
              .filter(([path, start_ms]) => start_ms < shown_ms && !path.startsWith("/api/") && path !== arguments[0])
              .map(([path, , bytes, sent]) => [path, bytes, sent]);""", HOOK)
        whole, sent = (sum(file[n] for file in files) for n in (1, 2))
        print(f"  {whole / 1000:.1f} kB before the first section, sent as {sent / 1000:.1f}: "
              + ", ".join(f"{path} {size / 1000:.1f}" for path, size, _ in files), flush=True)
        self.assertTrue({"/", "/assets/viewer.js", "/assets/viewer.css"} <= {file[0] for file in files}, files)
        self.assertLessEqual(max(whole, sent), MOST_PAGE_BYTES)

    def slide(self, selector, value):
        """Moves a slider as a hand would."""
        self.page.run("const slider = document.querySelector(arguments[0]); slider.value = arguments[1];"
                      "slider.dispatchEvent(new Event('input', { bubbles: true }));", selector, value)

    def box(self, selector):
        return self.page.run("const b = document.querySelector(arguments[0]).getBoundingClientRect();"
                             "return [b.left, b.top, b.width, b.height]", selector)

    def drag(self, selector, dx, dy, button=0, begin=(0.5, 0.5)):
        left, top, width, height = self.box(selector)
        x, y = round(left + begin[0] * width), round(top + begin[1] * height)
        self.page.pointer({"type": "pointerMove", "x": x, "y": y}, {"type": "pointerDown", "button": button},
                          {"type": "pointerMove", "x": x + dx, "y": y + dy, "duration": 300},
                          {"type": "pointerUp", "button": button})

    PICTURE = (200, 200, 0.8)  # pixels across and down, mm a pixel

    def volume_pixels(self):
        """Array [row, column, rgb] of the volume as it is now."""
        width, height, mm = self.PICTURE
        data = base64.b64decode(self.page.run("return palpateViewer.volumePicture(arguments[0], arguments[1], arguments[2])", width, height, mm))
        return numpy.frombuffer(data, numpy.uint8).reshape(height, width, 4)[:, :, :3].astype(int)

    def barriers(self):
        """Violations of WCAG 2.2 A and AA and of best practice that axe-core finds."""
        if not self.page.run("return window.axe !== undefined"):
            with open(AXE, encoding="utf-8") as source:
                self.page.run(source.read())
        return self.run_async("""axe.run(document, { resultTypes: ["violations"],
                runOnly: { type: "tag", values: ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"] } })
            .then(({ violations }) => done(violations.flatMap(({ id, nodes }) => nodes.map(({ html, failureSummary }) => [id, html, failureSummary]))))""")

    def let_another_viewer_lead(self):
        """Gives the pointer to a second viewer; lead(place) in the page then moves the tip to a position, patient, mm.
        """
        self.page.wait("palpateViewer.state.pointer")
        self.page.click("[data-tool=window]")
        self.page.wait("!palpateViewer.state.pointer")
        self.page.run("""const socket = new WebSocket(`ws://${location.host}/ws`, "palpate.v1");
            socket.onopen = () => {
              socket.send(JSON.stringify({ type: "hello", protocol: 3, poses_hz: 1 }));
              socket.send(JSON.stringify({ type: "pointer", id: 1, take: true }));
            };
            window.lead = (p) => socket.send(JSON.stringify({ type: "tip", patient_mm: p }));
            socket.onmessage = ({ data }) => typeof data === "string" && JSON.parse(data).type === "done" && (window.isTaken = true);""")
        self.page.wait("window.isTaken")


class WithoutWebGl(Viewer):
    """Without 3-D textures in the browser, palpate renders the volume on the server."""

    @classmethod
    def setUpClass(cls):
        if "explore" not in command(0, "pointer", None):
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


class WithPointer(Viewer):
    """The object stands still, and the tip is where the test leads it."""

    @classmethod
    def setUpClass(cls):
        cls.server = Server("pointer").__enter__()
        cls.addClassCleanup(cls.server.__exit__)
        cls.scene = cls.server.scene()
        cls.labels, cls.patient_from_voxel = cls.server.labels(cls.scene)
        cls.open_browser()

    def setUp(self):
        super().setUp()
        self.page.run("if (palpateViewer.state.rotation_wxyz[0] < 1) document.getElementById('unturn').click()")
        self.page.wait("palpateViewer.pose.rotation[0] > 0.9999999")
        # the picture's middle is where the object's was when the page opened
        self.page.run("document.querySelector('#picture-volume .stack').dispatchEvent(new KeyboardEvent('keydown', { key: 'Home' }));"
                      "palpateViewer.draw()")

    def points_of(self, mask):
        return numpy.argwhere(mask) @ self.patient_from_voxel[:3, :3].T + self.patient_from_voxel[:3, 3]

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

    def seen_as(self, pixels, colour):
        """Where a picture has a colour, in whatever light."""
        unit = numpy.array(colour) / numpy.linalg.norm(colour)
        size = numpy.linalg.norm(pixels, axis=2)
        return (size > 60) & (pixels @ unit > 0.98 * size)

    def look(self, structure, opacity=None, colour=None, toggle=False):
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
                self.look(femur, opacity=opacity)
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
        self.look(femur, colour="#00ff00")
        green = self.volume_pixels()
        changed = abs(green - before).max(2) > 40
        self.assertGreater(changed.sum(), 500)
        self.assertGreater(self.seen_as(green, (0, 255, 0))[changed].mean(), 0.9)
        # through half of it what lies behind is seen, or the ground
        self.look(femur, opacity=0.5)
        thin = self.volume_pixels()
        whole = self.seen_as(green, (0, 255, 0))
        self.assertGreater((abs(thin - green).max(2)[whole] > 10).mean(), 0.7)
        self.assertGreater(thin[whole][:, 1].mean(), 60, "and it is still there")
        self.look(femur, toggle=True)
        hidden = self.volume_pixels()
        self.assertLess(self.seen_as(hidden, (0, 255, 0)).sum(), 0.01 * whole.sum())
        self.assertEqual(self.page.run("return palpateViewer.volumeWork.texels"), made)
        opacity = self.scene["tissues"][femur["tissue"]]["opacity"]
        self.look(femur, opacity=opacity, colour="#%02x%02x%02x" % tuple(femur["colour"]), toggle=True)
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

    def tell_structures_apart(self):
        """Assigns colours that remain distinguishable under shading. @returns a function of (pixels, label fractions):
        share of pixels whose colour agrees"""
        structures = self.scene["structures"]
        palette = []
        for n, structure in enumerate(structures):
            hue = 6 * n / len(structures)
            palette.append(numpy.clip([abs(hue - 3) - 1, 2 - abs(hue - 2), 2 - abs(hue - 4)], 0, 1))
            self.look(structure, opacity=1, colour="#%02x%02x%02x" % tuple((255 * palette[-1]).astype(int)))

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
        agree = self.tell_structures_apart()
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
        agree = self.tell_structures_apart()
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
        agree = self.tell_structures_apart()
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
        self.look(self.scene["structures"][place], colour="#ff00ff")
        self.page.run("return palpateViewer.fillBox(arguments[0], arguments[1], arguments[2])", lo, size, place)
        box = numpy.zeros(dims, bool)
        box[lo[0]:lo[0] + size[0], lo[1]:lo[1] + size[1], lo[2]:lo[2] + size[2]] = True
        with_box = self.volume_pixels()
        # no structure is in front of it, so that the whole of it is seen
        self.page.run("palpateViewer.draw()")
        self.projected(self.labels > 0, (height, width), mm)
        expected = self.projected(box, (height, width), mm, (1, 0, 0, 1e-12))
        seen = self.seen_as(with_box, (255, 0, 255)) & ~self.seen_as(others, (255, 0, 255))
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
        self.look(self.scene["structures"][place], colour="#%02x%02x%02x" % tuple(self.scene["structures"][place]["colour"]))
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

    def approaches(self, label, count, generator):
        """Places where a straight way through free space ends `depth` inside a structure: [(start, end)], patient, mm."""
        voxel = numpy.linalg.norm(self.patient_from_voxel[:3, 0])
        deep, free = max(2, round(1.0 / voxel)), round(5 / voxel)
        candidates = numpy.argwhere(self.labels == label)
        order = list(range(len(candidates)))
        generator.shuffle(order)
        directions = [(dx, dy, dz) for dx in (-1, 0, 1) for dy in (-1, 0, 1) for dz in (-1, 0, 1) if (dx, dy, dz) != (0, 0, 0)]
        sides = numpy.vstack([numpy.eye(3, dtype=int), -numpy.eye(3, dtype=int)])
        found = []
        for index in order:
            generator.shuffle(directions)
            for direction in directions:
                end = candidates[index]
                way = end + numpy.outer(numpy.arange(0, deep + free), direction)
                if (way < 1).any() or (way >= numpy.array(self.labels.shape) - 1).any():
                    continue
                passed = self.labels[tuple(way.T)]
                # inside to its own surface, and beside where the tip ends; in front of it room, as between two structures that touch
                # a slit of voxels that share edges alone is closed
                beside = [self.labels[tuple(end + side)] for side in sides]
                room = all(numpy.isin(self.labels[tuple((way[deep:] + side).T)], (0, label)).all() for side in sides)
                if (passed[:deep] == label).all() and (passed[deep:] == 0).all() and all(b == label for b in beside) and room:
                    place = lambda v: (self.patient_from_voxel[:3, :3] @ v + self.patient_from_voxel[:3, 3]).tolist()  # noqa: E731
                    found.append((place(way[-1]), place(end)))
                    break
            if len(found) == count:
                return found
        return found

    def take_hand(self):
        """Passes the tip to a second viewer, which lead() then moves. The page holds the tip when it opens, and
        releases it when another tool is chosen."""
        # the page requests the tip once, on opening. Wait for it: a release before the grant would be ineffective. If
        # the previous test's viewer still held the tip, the request was refused and is not repeated
        asked_s = time.monotonic()
        while not self.page.run("return palpateViewer.state.pointer") and time.monotonic() < asked_s + 2:
            time.sleep(0.02)
        self.page.run("document.querySelector('button[data-tool=window]').click()")
        self.page.wait("!palpateViewer.state.pointer")
        self.page.run("""
            const socket = new WebSocket(`ws://${location.host}/ws`, "palpate.v1");
            let way = null, step = 0;
            const timer = setInterval(() => {
              if (!way) return;
              const at = Math.min(step++ / 30, way.length - 1), i = Math.max(0, Math.min(Math.floor(at), way.length - 2));
              const next = way[Math.min(i + 1, way.length - 1)];
              socket.send(JSON.stringify({ type: "tip", patient_mm: way[i].map((x, c) => x + (at - i) * (next[c] - x)) }));
            }, 16);
            socket.onopen = () => {
              socket.send(JSON.stringify({ type: "hello", protocol: 3, poses_hz: 1 }));
              socket.send(JSON.stringify({ type: "pointer", id: 1, take: true }));
            };
            socket.onmessage = ({ data }) => {
              if (typeof data !== "string") return;
              const message = JSON.parse(data);
              if (message.id !== undefined) window.hand.answers[message.id] = message;
              window.hand.isTaken ||= message.type === "done";
            };
            window.hand = { isTaken: false, answers: {}, lead(points) { way = points; step = 0; },
                            ask: (message) => socket.send(JSON.stringify(message)), letGo() { clearInterval(timer); socket.close(); } };""")
        self.page.wait("window.hand.isTaken")

    def lead(self, way):
        """Along points, half a second from each to the next; it stays at the last."""
        self.page.run("window.hand.lead(arguments[0])", way)
        self.page.wait("Math.hypot(...palpateViewer.pose.devices[0].tip.map((x, i) => x - %s[i])) < 0.05" % json.dumps(way[-1]))

    def choose_method(self, name):
        self.page.run("const method = document.getElementById('method'); method.value = arguments[0];"
                      "method.dispatchEvent(new Event('change', { bubbles: true }));", name)
        self.page.wait(f"palpateViewer.state.method === '{name}'")
        # one force turns into the other
        time.sleep(0.2)
        self.page.wait("(palpateViewer.pose.devices[0].flags & %d) === 0" % BLENDING)

    def come_to(self, place):
        """Comes to a place in free space without minding what is on the way."""
        self.choose_method("trilinear")  # which holds no proxy back behind what lies between
        self.lead([place])
        self.choose_method("proxy")

    def press_on(self, label, start, end):
        """Presses from a place in free space towards another."""
        self.come_to(start)
        self.lead([start, end])
        self.page.wait(f"palpateViewer.pose.devices[0].label === {label}")

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

    def resting_plane(self):
        """The section's, which glides to what it follows: after the object was turned, too. From old poses it does not."""
        look = ("for (let n = 0; n < 20; n++) palpateViewer.draw();"
                "return { isFresh: palpateViewer.isFresh, ...palpateViewer.plane('oblique') }")
        before = None
        for _ in range(100):
            now = self.page.run(look)
            if before and now["isFresh"] and numpy.linalg.norm(numpy.subtract(now["centre"], before["centre"])) < 1e-5:
                return now
            before = now
            time.sleep(0.1)
        raise AssertionError(f"the section goes on gliding: {before}")

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


class WithHand(Viewer):
    """The simulated hand moves."""

    draws_seldom = False

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

# Injected before the page's script: replaces its clock and timers. advance(ms) moves the clock forward and runs the
# timers that become due.
CLOCK = """{
  const own = { now: performance.now.bind(performance), date: Date.now, setTimeout, clearTimeout, setInterval, clearInterval, frame: requestAnimationFrame };
  const timers = new Map();
  let ahead = 0;
  const now = () => own.now() + ahead;
  const add = (real, ends, call, ms = 0, ...all) => {
    const timer = { due: now() + ms, run: () => { ends ? timers.delete(id) : (timer.due += Math.max(ms, 1)); call(...all); } };
    const id = real.call(window, timer.run, ms);
    timers.set(id, Object.assign(timer, { ends, id }));
    return id;
  };
  performance.now = now;
  Date.now = () => own.date() + ahead;
  window.setTimeout = (...all) => add(own.setTimeout, true, ...all);
  window.setInterval = (...all) => add(own.setInterval, false, ...all);
  window.clearTimeout = window.clearInterval = (id) => {
    timers.delete(id);
    own.clearTimeout.call(window, id);
  };
  window.requestAnimationFrame = (call) => own.frame.call(window, (at) => call(at + ahead));
  window.advance = async (ms) => {
    for (const end = now() + ms; ;) {
      const next = [...timers.values()].sort((a, b) => a.due - b.due)[0];
      const to = Math.min(next?.due ?? Infinity, end);
      ahead += Math.max(0, to - now());
      if (to === end) return;
      if (next.ends) own.clearTimeout.call(window, next.id);
      next.run();
      // what waits for it goes on
      await new Promise((later) => own.setTimeout.call(window, later));
    }
  };
}"""


class WithTrouble(Viewer):
    """The mock server with faults: errors that do not resolve by themselves are shown, and retried on request."""

    draws_seldom = False

    def setUp(self):
        self.serve("script")
        super().setUp()
        self.expected = ("ERR_CONNECTION_REFUSED", "ERR_CONNECTION_RESET", "ERR_EMPTY_RESPONSE", "WebSocket connection to", "status of 4")

    @classmethod
    def setUpClass(cls):
        cls.open_browser(own=True)
        cls.page.developer_tools("Page.addScriptToEvaluateOnNewDocument", source="""
            window.workers = [];
            window.Worker = class extends Worker { constructor(...all) { super(...all); window.workers.push(this); } };""" + CLOCK)

    def restart(self, *extra):
        self.server.process.kill()
        self.server.process.wait()
        self.server.extra = list(extra)
        self.server.__enter__()

    def assert_told_and_left_alone(self, *words):
        self.page.wait("palpateViewer.link === 'ended' && !document.getElementById('remedy').hidden")
        told = self.page.run("return document.getElementById('cover').textContent")
        for word in words:
            self.assertIn(word, told)
        self.assertEqual(self.attempts(), 0)

    def attempts(self):
        """How often the page looks for its server in a minute of its own clock: longer than it ever waits between two attempts."""
        return self.page.run("""window.attempts = 0;
            const Socket = WebSocket, get = fetch;
            window.WebSocket = class extends Socket { constructor(...all) { super(...all); window.attempts++; } };
            window.fetch = (...all) => { window.attempts++; return get(...all); };
            return window.advance(60000).then(() => window.attempts)""")

    def assert_mended(self):
        self.restart()
        self.page.click("#again")
        self.page.wait(LOADED + " && palpateViewer.link === 'connected' && document.getElementById('cover').hidden")

    @campaign
    def test_graphics_memory_that_holds_not_even_a_quarter(self):
        name = self.page.developer_tools("Page.addScriptToEvaluateOnNewDocument", source="""
            const get = fetch;
            window.fetched = [];
            window.fetch = (...all) => { window.fetched.push(all[0]); return get(...all); };
            const honest = WebGL2RenderingContext.prototype.getError;
            WebGL2RenderingContext.prototype.getError = function () { return window.isEnough ? honest.call(this) : this.OUT_OF_MEMORY; };""")
        self.open_page(wait="document.getElementById('remedy')?.hidden === false")
        self.page.developer_tools("Page.removeScriptToEvaluateOnNewDocument", **name)
        self.assertIn("memory", self.page.run("return document.getElementById('cover').textContent"))
        self.page.run("return window.advance(60000)")
        scans = [path.split("?")[-1] for path in self.page.run("return window.fetched") if "/scan/" in path]
        self.assertEqual([scans[0][:5], *scans[1:]], ["/api/", "shrink=2", "shrink=4"])
        self.page.run("window.isEnough = true")
        self.page.click("#again")
        self.page.wait(LOADED)

    @campaign
    def test_what_draws_the_volume_is_replaced_once(self):
        self.expected += ("Cannot read properties of null",)
        note = "document.getElementById('graphics')"
        before = self.volume_pixels()
        self.page.run(f"window.told = []; new MutationObserver(() => window.told.push({note}.textContent)).observe({note}, {{ childList: true, subtree: true, characterData: true }})")
        # it throws something where nobody waits for it
        self.page.run("window.workers[0].postMessage({ type: 'draw', id: 0, view: null, isYielding: false })")
        self.page.wait(f"window.told.length > 0 && {note}.hidden")
        told = self.page.run("return window.told[0]")
        for words in ("the volume cannot be drawn", "started anew", "emergency stop"):
            self.assertIn(words, told)
        self.assertEqual(abs(self.volume_pixels() - before).max(), 0)
        self.assertEqual(self.page.run("return [window.workers.length, palpateViewer.isDrawnInWorker]"), [2, True])
        # and the one in its place ends without a word
        self.page.run("window.workers[1].terminate()")
        self.page.wait(f"!{note}.hidden && {note}.textContent.includes('reload this page')")
        self.assertEqual(self.page.run("return window.workers.length"), 2)
        self.page.press(" ")
        self.page.wait("palpateViewer.state.emergency_stop")


class WithoutParts(Viewer):
    """The mock server without some of the page's files."""

    draws_seldom = False
    expected = ("Failed to load resource", "Failed to fetch dynamically imported module")

    @classmethod
    def setUpClass(cls):
        cls.server = Server("script").__enter__()
        cls.addClassCleanup(cls.server.__exit__)
        cls.open_browser(own=True)
        cls.page.developer_tools("Network.enable")

    def setUp(self):
        self.block("viewer_de.js", "viewer_plan_panel.js", "viewer_scope_view.js")
        self.open_page()

    def block(self, *names):
        self.page.developer_tools("Network.setBlockedURLs", urls=["*/" + name for name in names])

    @campaign
    def test_what_cannot_be_fetched_is_told_of_and_the_stop_works(self):
        line = "document.getElementById('missing-parts')"
        self.assertTrue(self.page.run(f"return {line}.hidden"))
        self.page.run("const choice = document.getElementById('language'); choice.value = 'de'; choice.dispatchEvent(new Event('change'))")
        self.page.wait(f"!{line}.hidden && {line}.textContent.includes('language')")
        self.assertEqual(self.page.run("return [document.getElementById('language').value, document.getElementById('stop').textContent]"), ["en", "Emergency stop"])
        self.page.run("document.getElementById('plan-card').open = true")
        self.page.click("[data-layout=inside]")
        self.page.wait(f"['language', 'plan', 'scope view'].every((name) => {line}.textContent.includes(name))")
        # it is in view, and covers no stop
        left, top, width, height = self.box("#missing-parts")
        self.assertTrue(width > 100 and 0 <= top and top + height <= SIZE[1], (left, top, width, height))
        self.page.click("#stop")
        self.page.wait("palpateViewer.state.stop === 1")
        self.page.press(" ")
        self.page.wait("palpateViewer.state.stop === 2")
        # what can be had again is fetched at its next use
        self.block()
        self.page.click("[data-layout=two]")
        self.page.click("[data-layout=inside]")
        self.page.wait(f"document.querySelector('#picture-scope canvas')?.width > 50 && !{line}.textContent.includes('scope view')")
        self.page.click("[data-layout=two]")


class WithLoading(Viewer):
    """The mock, that keeps its volumes until they are released."""

    draws_seldom = False

    def setUp(self):
        self.serve("pointer", extra=["--hold", "yes"])

    @classmethod
    def setUpClass(cls):
        cls.open_browser()

    def test_a_stop_waits_for_no_volume(self):
        self.open_page("window.palpateViewer?.link === 'connected' && palpateViewer.state !== null && palpateViewer.pose !== null")
        bar = self.page.run("const { hidden, value } = document.getElementById('cover-share'); return [hidden, value]")
        self.assertEqual(bar, [False, 0])
        # the button is there beside the cover, and works
        left, top, width, height = self.box("#stop")
        self.assertEqual(self.page.run("return document.elementFromPoint(...arguments).id", left + width / 2, top + height / 2), "stop")
        self.page.click("#stop")
        self.page.wait("palpateViewer.state.stop === 1")
        self.page.press(" ")
        self.page.wait("palpateViewer.state.stop === 2 && palpateViewer.state.stopped_by === 'you'")
        self.assertEqual(self.page.run("return [palpateViewer.isLoaded, document.getElementById('cover').hidden]"), [False, False])
        # nobody has the hand while there is nothing to see
        self.assertFalse(self.page.run("return palpateViewer.state.pointer"))
        self.server.get("mock/release")
        self.page.wait(LOADED + " && document.getElementById('cover').hidden && palpateViewer.state.pointer")


class WithRamp(Viewer):
    """The mock's unsigned 16-bit scan on a grid with permuted, mirrored and oblique axes and 116 structures; the tip
    moves continuously."""

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
        self.open_page(keeps=True)
        self.assertEqual(self.page.run(layout), "five")
        self.assertTrue(self.page.run("return document.getElementById('bookmark-form').closest('details').open"))
        self.page.wait("Number(document.getElementById('width').value) > 60000")
        assert_seen_again()
        # one in which the volume was not seen before
        self.page.click("[data-layout=section]")
        self.open_page(keeps=True)
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
                self.assertEqual(self.barriers(), [])
                self.page.wait(f"{label} > 0")
                self.assertEqual(self.barriers(), [])
                self.page.press(" ")
                self.page.wait("document.getElementById('stop').classList.contains('stopped')")
                self.page.run("document.getElementById('help').click()")
                self.assertEqual(self.barriers(), [])
                self.page.run("document.getElementById('help-close').click()")
                # as a refused request is told
                self.page.run("const toast = document.getElementById('toast'); toast.textContent = 'There was another stop.'; toast.hidden = false")
                self.assertEqual(self.barriers(), [])
                self.page.resize(390, 844)
                self.page.wait("innerWidth <= 390")
                self.assertEqual(self.barriers(), [])
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
        self.open_page(keeps=True)
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


class WithFinger(Viewer):
    """The mock's pointer, which fingers press on."""

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


class WithShaft(Viewer):
    """The mock's pointer with a shaft of 40 mm: what is drawn over the volume, pixel by pixel."""

    @classmethod
    def setUpClass(cls):
        cls.server = Server("pointer", extra=["--shaft", "yes"]).__enter__()
        cls.addClassCleanup(cls.server.__exit__)
        scene = cls.server.scene()
        cls.labels, cls.patient_from_voxel = cls.server.labels(scene)
        cls.axis = numpy.array(scene["world_from_patient"])[2, :3]
        cls.radius = scene["tool"]["capsules"][0]["radius_mm"]
        cls.spacing = numpy.linalg.norm(cls.patient_from_voxel[:3, 0])
        cls.open_browser()

    def label_at(self, points):
        inverse = numpy.linalg.inv(self.patient_from_voxel)
        voxel = numpy.floor(points @ inverse[:3, :3].T + inverse[:3, 3] + 0.5).astype(int)
        inside = ((voxel >= 0) & (voxel < self.labels.shape)).all(-1)
        return numpy.where(inside, self.labels[tuple(numpy.moveaxis(numpy.where(inside[..., None], voxel, 0), -1, 0))], 0)

    def occluded(self, points, slack):
        """For each point, whether it is occluded by voxels more than `slack` mm in front of it; None near an edge,
        where the answer changes within 2 mm laterally or 1.5 mm in depth."""
        into = points - self.eye if self.is_perspective else numpy.broadcast_to(self.into, points.shape)
        into = into / numpy.linalg.norm(into, axis=1)[:, None]
        aside = numpy.cross(into, (0.3, 0.5, 0.8))
        aside /= numpy.linalg.norm(aside, axis=1)[:, None]
        ups = numpy.cross(into, aside)
        found = []
        for a, b in ((0, 0), (2, 0), (-2, 0), (0, 2), (0, -2)):
            places = points + a * aside + b * ups
            solid = self.label_at(places[:, None] - numpy.arange(0.2, 130, 0.4)[:, None] * into[:, None]) > 0
            found += [(solid & (numpy.arange(0.2, 130, 0.4) > slack + more)).any(1) for more in (-1.5, 0, 1.5)]
        found = numpy.array(found)
        return [None if found[:, n].min() != found[:, n].max() else bool(found[0, n]) for n in range(len(points))]

    def drawn(self, *ways):
        """Of points on each way: where they are in the picture of the volume, and RGBA of what is drawn over it there; the greatest alpha beside it."""
        at = numpy.array(self.page.run("return palpateViewer.pixelsOverVolume(arguments[0])", [q.tolist() for way in ways for q in way]))
        x, y = numpy.clip(numpy.floor(at).astype(int), -1, self.size).T + 3
        own = self.over[y, x].astype(int)
        beside = numpy.max([self.over[y + dy, x + dx, 3] for dx in (-1, 0, 1) for dy in (-1, 0, 1)], 0)
        ends = numpy.cumsum([len(way) for way in ways])[:-1]
        return zip(*(numpy.split(one, ends) for one in (at, own, beside)))

    def runs(self, points, at, whole_mm, slack):
        """Masks of the visible and of the hidden points of a line, without points closer than one dash (6 pixels, or
        1/80 of the line) to a change of visibility."""
        states = self.occluded(points, slack)
        step_mm = numpy.linalg.norm(points[1] - points[0])
        step_pixels = numpy.linalg.norm(at[-1] - at[0]) / (len(at) - 1)
        piece_mm = whole_mm / min(80, max(1, math.ceil(whole_mm / step_mm * step_pixels / 6)))
        near = math.ceil(piece_mm / step_mm) + 1
        is_all = lambda n, state: all(one is state for one in states[max(0, n - near):n + near + 1])  # noqa: E731
        return [numpy.array([is_all(n, state) for n in range(len(points))]) for state in (False, True)]

    def judge_shaft(self, p):
        into = self.into if not self.is_perspective else (p - self.eye) / numpy.linalg.norm(p - self.eye)
        side = numpy.cross(self.axis, into)
        axis = p + numpy.arange(8, 34, 0.25)[:, None] * self.axis
        side = self.radius * side / numpy.linalg.norm(side)
        (at, own, _), *sides = self.drawn(axis, axis + side, axis - side)
        is_filled = (own[:, 3] > 130) & (abs(own[:, :3] - (120, 142, 155)).max(1) < 60)
        seen, hidden = self.runs(axis, at, 40, 1.5 * self.spacing + self.radius)
        for which, is_right in ((seen, [is_filled] + [beside > 200 for _, _, beside in sides]), (hidden, [~is_filled] + [beside < 175 for _, _, beside in sides])):
            if which.sum() >= 6:
                # something else may lie over a part of it, or a plane's outline along a side that is hidden: both go along the volume's box
                shares = [one[which].mean() for one in is_right]
                yield which is hidden, shares[0] >= 0.85 and (max if which is hidden else min)(shares[1:]) >= 0.65, shares
        # dashed: drawn and left out by turns
        if hidden.sum() >= 40:
            shares = [((beside[hidden] > 60).mean(), (line[hidden, 3] < 30).mean()) for _, line, beside in sides]
            yield True, all(drawn > 0.3 and left_out > 0.1 for drawn, left_out in shares), shares

    def judge_plane(self, _):
        plane = self.plane
        centre, normal = numpy.array(plane["centre"]), numpy.array(plane["normal"])
        # the polygon in which it meets the volume's box
        dims = numpy.array(self.labels.shape)
        met = []
        for axis in range(3):
            for a, b in numpy.ndindex(2, 2):
                ends = numpy.zeros((2, 3))
                ends[:, (axis + 1) % 3], ends[:, (axis + 2) % 3] = a, b
                ends[1, axis] = 1
                ends = (ends * dims - 0.5) @ self.patient_from_voxel[:3, :3].T + self.patient_from_voxel[:3, 3]
                far = (ends - centre) @ normal
                if (far[0] < 0) != (far[1] < 0):
                    met.append(ends[0] + (ends[1] - ends[0]) * far[0] / (far[0] - far[1]))
        met = numpy.array(met)
        about = met - met.mean(0)
        met = met[numpy.arctan2(about @ plane["down"], about @ plane["right"]).argsort()]
        edges = [(a, b) for a, b in zip(met, numpy.roll(met, -1, 0)) if numpy.linalg.norm(b - a) >= 10]
        ways = [a + numpy.linspace(0.02, 0.98, 80)[:, None] * (b - a) for a, b in edges]
        for (a, b), points, (at, _, beside) in zip(edges, ways, self.drawn(*ways)):
            inside = (at > 40).all(1) & (at < numpy.array(self.size) - 40).all(1)
            for which, is_hidden in zip(self.runs(points, at, numpy.linalg.norm(b - a), 1), (False, True)):
                which &= inside
                if which.sum() < 6:
                    continue
                shares = [(beside[which] < 150).mean(), (beside[which] > 40).mean()] if is_hidden else [(beside[which] > 180).mean(), 1]
                yield is_hidden, shares[0] >= 0.65 and shares[1] > 0.3, shares

    @campaign
    def test_what_is_drawn_in_the_volume_is_hidden_where_something_is_in_front_of_it(self):
        self.let_another_viewer_lead()
        self.page.run("""const planes = document.getElementById("planes-in-volume");
            planes.checked = true;
            planes.dispatchEvent(new Event("change"));""")
        self.size = self.page.run("const { width, height } = document.querySelector('#picture-volume canvas'); return [width, height]")
        generator = random.Random(test_seed())
        judges = {"shaft": self.judge_shaft, "plane": self.judge_plane}
        places, states, wrong = {kind: 0 for kind in judges}, {kind: [0, 0] for kind in judges}, []
        for is_perspective in (False, True):
            self.is_perspective = is_perspective
            self.page.run("palpateViewer.lookFrom(110, 30, arguments[0]); palpateViewer.draw()", is_perspective)
            # the plane glides to where the tool wants it, and stays
            self.page.run("for (let n = 0; n < 60; n++) palpateViewer.draw()")
            self.page.wait("palpateViewer.isVolumeSharp")
            while places["shaft"] < (50 if is_perspective else 25):
                p = numpy.zeros(3)
                while self.label_at(p + 4 * (numpy.argwhere(numpy.ones((3, 3, 3))) - 1)).any():
                    p = numpy.array([generator.uniform(-40, 40), generator.uniform(-35, 45), generator.uniform(-35, 45)])
                self.page.run("window.lead(arguments[0])", p.tolist())
                self.page.wait("Math.hypot(...palpateViewer.pose.devices[0].tip.map((x, i) => x - %s[i])) < 0.01" % json.dumps(p.tolist()))
                # with the eye of that picture, wherever the camera is by now
                answer, self.plane, ray = self.page.run("palpateViewer.draw(); return [palpateViewer.drawnOverVolume(), palpateViewer.plane('oblique'), palpateViewer.volumeRay(0, 0)]")
                self.eye, self.into = numpy.array(ray["from"]), numpy.array(ray["into"])
                over = numpy.frombuffer(base64.b64decode(answer["rgba"]), numpy.uint8).reshape(answer["height"], answer["width"], 4)
                self.over = numpy.pad(over, ((3, 3), (3, 3), (0, 0)))
                for kind, judge in judges.items():
                    judged = list(judge(p))
                    places[kind] += len(judged) > 0
                    for is_hidden, is_right, shares in judged:
                        states[kind][is_hidden] += 1
                        if not is_right:
                            wrong.append((kind, is_perspective, is_hidden, p.round(1).tolist(), shares))
        print("  " + ", ".join(f"{kind}: {places[kind]} places, {states[kind][0]} parts seen, {states[kind][1]} hidden" for kind in judges), flush=True)
        self.assertEqual(wrong, [])
        self.assertGreaterEqual(places["plane"], 50)
        for kind in judges:
            self.assertGreater(min(states[kind]), 8, kind)

    @campaign
    def test_a_line_leads_from_the_tool_to_what_is_felt_nearest(self):
        self.let_another_viewer_lead()
        # alone, so that it is large
        self.page.click("[data-layout=volume]")
        self.addCleanup(self.page.click, "[data-layout=two]")
        self.page.wait("palpateViewer.draw() || document.querySelector('#picture-volume canvas').height > 400")
        self.size = self.page.run("const { width, height } = document.querySelector('#picture-volume canvas'); return [width, height]")
        generator = random.Random(test_seed())
        solid = numpy.pad(self.labels > 0, 1)
        inner = solid[1:-1, 1:-1, 1:-1].copy()
        for axis in range(3):
            for by in (-1, 1):
                inner &= numpy.roll(solid, by, axis)[1:-1, 1:-1, 1:-1]
        surface = numpy.argwhere((self.labels > 0) & ~inner) @ self.patient_from_voxel[:3, :3].T + self.patient_from_voxel[:3, 3]
        places, wrong, points = {"near": 0, "far": 0}, [], {"seen": 0, "hidden": 0}
        for is_perspective in (False, True):
            self.is_perspective = is_perspective
            self.page.run("palpateViewer.lookFrom(110, 30, arguments[0]); palpateViewer.draw()", is_perspective)
            self.page.wait("palpateViewer.isVolumeSharp")
            ray = self.page.run("return palpateViewer.volumeRay(0, 0)")
            self.eye, self.into = numpy.array(ray["from"]), numpy.array(ray["into"])
            wanted = {"near": 8, "far": 2}
            while sum(wanted.values()) > 0:
                p = numpy.array([generator.uniform(-54, 54), generator.uniform(-54, 54), generator.uniform(-60, 60)])
                far = numpy.linalg.norm(surface - p, axis=1)
                nearest = surface[far.argmin()]
                kind = "near" if 6 < far.min() < 18 else "far"
                # places that are as near, but for less than a voxel: the page looks at the nearest of some of them
                as_near = surface[far < far.min() + 0.8]
                if wanted[kind] == 0 or self.label_at(p[None])[0] or (kind == "far" and far.min() < 22) or numpy.linalg.norm(as_near - nearest, axis=1).max() > 8:
                    continue
                foot_of = lambda voxel: p + (voxel - p) * (1 - self.spacing / 2 / numpy.linalg.norm(voxel - p))  # noqa: E731
                foot = foot_of(nearest)
                begin, end, shaft = numpy.array(self.page.run("return palpateViewer.pixelsOverVolume(arguments[0])", [q.tolist() for q in (p, foot, p + 30 * self.axis)]))
                way, shaft = end - begin, shaft - begin
                cosine = way @ shaft / numpy.linalg.norm(way) / numpy.linalg.norm(shaft)
                if numpy.linalg.norm(way) < 30 or cosine > 0.5 or not ((numpy.array([begin, end]) > 10) & (numpy.array([begin, end]) < numpy.array(self.size) - 10)).all():
                    continue
                self.page.run("window.lead(arguments[0])", p.tolist())
                self.page.wait("Math.hypot(...palpateViewer.pose.devices[0].tip.map((x, i) => x - %s[i])) < 0.01" % json.dumps(p.tolist()))
                time.sleep(2.2)  # where the tool was is drawn so long
                answer = self.page.run("palpateViewer.draw(); return palpateViewer.drawnOverVolume()")
                over = numpy.frombuffer(base64.b64decode(answer["rgba"]), numpy.uint8).reshape(answer["height"], answer["width"], 4)
                self.over = numpy.pad(over, ((3, 3), (3, 3), (0, 0)))
                # from the tool's ring to the shadow, at whichever of them it is drawn
                mm = numpy.linalg.norm(foot - p) / numpy.linalg.norm(way)
                line_to = lambda foot: p + numpy.linspace(14 * mm / numpy.linalg.norm(foot - p), 1 - 1.5 / numpy.linalg.norm(foot - p), 60)[:, None] * (foot - p)  # noqa: E731
                # a disc across it where it ends, of which a bar is seen from the side
                angles = numpy.linspace(0, 2 * math.pi, 12, endpoint=False)
                rim_at = lambda foot: foot + 1.2 * numpy.stack([numpy.cos(angles), numpy.sin(angles)], 1) @ numpy.linalg.svd((foot - p)[None])[2][1:]  # noqa: E731
                feet = [foot_of(voxel) for voxel in as_near]
                marks = list(self.drawn(*map(line_to, feet), *map(rim_at, feet)))
                best = numpy.argmax([(on > 40).mean() + (rim > 50).mean() for (_, _, on), (_, _, rim) in zip(marks, marks[len(feet):])])
                foot, shadow = feet[best], (marks[len(feet) + best][2] > 50).mean()
                line, length = line_to(foot), numpy.linalg.norm(foot - p)
                into = self.into if not is_perspective else (p - self.eye) / numpy.linalg.norm(p - self.eye)
                aside = numpy.cross(foot - p, into)
                aside *= 7 * mm / numpy.linalg.norm(aside)
                (at, _, on), (_, _, left), (_, _, right) = self.drawn(line, line + aside, line - aside)
                places[kind] += 1
                wanted[kind] -= 1
                if kind == "far":
                    if (on > 40).mean() > 0.1:
                        wrong.append((kind, is_perspective, p.round(1).tolist(), (on > 40).mean()))
                    continue
                seen, hidden = self.runs(line, at, length, 2)
                # its length stands on one of its sides
                beside = min((left > 80).mean(), (right > 80).mean())
                shares = [(on[seen] > 80).mean() if seen.sum() > 5 else 1, (on[hidden] > 40).mean() if hidden.sum() > 5 else 0.6, beside]
                points["seen"] += int(seen.sum())
                points["hidden"] += int(hidden.sum())
                if shares[0] < 0.9 or shares[1] < 0.3 or beside > 0.2 or shadow < 0.5:
                    wrong.append((kind, is_perspective, p.round(1).tolist(), shares, shadow))
        print(f"  {places['near']} lines, {points['seen']} of their points seen and {points['hidden']} hidden; {places['far']} places without one", flush=True)
        self.assertEqual(wrong, [])
        self.assertGreater(points["seen"], 200)


class WithTwoTools(Viewer):
    """The mock's with a second device, which holds a ball of 4 mm radius on a shaft of 30 mm still."""

    @classmethod
    def setUpClass(cls):
        cls.server = Server("script", extra=["--second", "yes"]).__enter__()
        cls.addClassCleanup(cls.server.__exit__)
        cls.scene = cls.server.scene()
        cls.open_browser()

    @campaign
    def test_each_device_is_drawn_with_its_own_tool(self):
        self.assertEqual(self.scene["tools"][0], self.scene["tool"])
        self.assertEqual(self.page.run("return palpateViewer.pose.devices.map(({ number }) => number)"), [0, 1])
        told = self.page.run("return document.getElementById('device').textContent")
        self.assertIn("probe tool · ball tool", told)
        # where the first one, its force and its trail are not
        drawn = self.page.run("""
            palpateViewer.draw();
            const [first, second] = palpateViewer.pose.devices, { right, down } = palpateViewer.plane("oblique");
            const sum = (...parts) => [0, 1, 2].map((i) => parts.reduce((all, [share, v]) => all + share * v[i], 0));
            const around = (mm) => Array.from({ length: 24 }, (_, n) => (n * Math.PI) / 12)
              .map((turn) => sum([1, second.tip], [mm * Math.cos(turn), right], [mm * Math.sin(turn), down]));
            const [from, to] = palpateViewer.pixelsOverVolume([second.tip, sum([1, second.tip], [30, arguments[0]])]);
            const drawn = palpateViewer.drawnOver("oblique", [...around(4), ...around(7)]);
            return { at: second.tip, ring: drawn.slice(0, 24), farther: drawn.slice(24), shaft: [from, to], over: palpateViewer.drawnOverVolume() };
            """, numpy.array(self.scene["world_from_patient"])[2, :3].tolist())
        self.assertEqual(drawn["at"], [20, -52, 20])
        self.assertGreater(min(drawn["ring"]), 60, drawn["ring"])
        # a shaft, and what the first one has left behind it, and no ring
        self.assertLess(sorted(drawn["farther"])[6], 60, drawn["farther"])
        over = drawn["over"]
        alpha = numpy.frombuffer(base64.b64decode(over["rgba"]), numpy.uint8).reshape(over["height"], over["width"], 4)[..., 3]
        x, y = numpy.mean(drawn["shaft"], 0).astype(int)
        self.assertGreater(alpha[y - 3:y + 4, x - 3:x + 4].max(), 60, "its shaft in the volume")

    @campaign
    def test_the_scope_is_the_second_one_and_may_be_the_first(self):
        stack = "document.querySelector('#picture-scope .stack')"
        holder = "document.querySelectorAll('#picture-scope select')[2]"
        seen = f"""palpateViewer.draw();
            const axis = ({{ orientation: [w, x, y, z] }}) => [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)];
            const {{ devices, rotation }} = palpateViewer.pose, holder = {holder};
            return {{ eye: palpateViewer.scopeFrame.eye, tips: devices.map(({{ tip }}) => tip), hidden: holder.hidden, chosen: holder.value,
                      names: [...holder.options].map(({{ text }}) => text) }};"""
        self.page.press("5")
        self.page.wait("document.querySelector('#picture-scope canvas')?.width > 50")
        at = self.page.run(seen)
        self.assertEqual((at["hidden"], at["chosen"], at["names"]), (False, "1", ["1: probe tool", "2: ball tool"]))
        # 8 mm back along the shaft of the one that is held still
        self.assertAlmostEqual(numpy.linalg.norm(numpy.subtract(at["eye"], at["tips"][1])), 8, delta=0.1)
        choose = f"const holder = {holder}; holder.value = arguments[0]; holder.dispatchEvent(new Event('change'));"
        self.page.run(choose, "0")
        self.page.run("const back = document.querySelector('#picture-scope select'); back.value = '0'; back.dispatchEvent(new Event('change'));")
        at = self.page.run(seen)
        self.assertLess(numpy.linalg.norm(numpy.subtract(at["eye"], at["tips"][0])), 8.1, "it may stand off what the first one touches")
        self.assertGreater(numpy.linalg.norm(numpy.subtract(at["eye"], at["tips"][1])), 10)
        # who holds it can be undone as well
        for _ in range(2):
            self.page.run("document.body.dispatchEvent(new KeyboardEvent('keydown', { key: 'z', ctrlKey: true, bubbles: true, cancelable: true }))")
        at = self.page.run(seen)
        self.assertEqual(at["chosen"], "1")
        self.assertAlmostEqual(numpy.linalg.norm(numpy.subtract(at["eye"], at["tips"][1])), 8, delta=0.1)


class WithBurr(Viewer):
    """The mock's with a tool that cuts away 3 mm around the middle of the first structure when its motor is switched on, and 7 mm above the next time."""

    def serve(self, source, burr="ball"):
        super().serve(source, extra=["--tool", "burr", "--burr", burr])

    def setUp(self):
        self.serve("pointer")
        scene = self.server.scene()
        labels, patient_from_voxel = self.server.labels(scene)
        middle = numpy.argwhere(labels == scene["structures"][0]["label"]).mean(0)
        self.place = (patient_from_voxel @ [*middle, 1])[:3].tolist()
        self.above = [*self.place[:2], self.place[2] + 7]
        super().setUp()

    @classmethod
    def setUpClass(cls):
        cls.open_browser()

    def switch(self, on):
        self.page.click("#motor")
        self.page.wait(f"[palpateViewer.state.motor, palpateViewer.state.motor_is_on].every((is) => is === {json.dumps(on)})")

    def told(self, name):
        return self.page.run("return document.getElementById(arguments[0]).textContent", name)

    def offered(self):
        """Which of undo and redo can be pressed."""
        return self.page.run("return ['undo-stroke', 'redo-stroke'].map((id) => !document.getElementById(id).disabled)")

    def wait_for_strokes(self, undo, redo):
        self.page.wait("JSON.stringify(palpateViewer.state.strokes) === '%s'" % json.dumps({"undo": undo, "redo": redo}, separators=(",", ":")))

    def wait_until_cut(self, place, is_cut):
        self.page.wait("(palpateViewer.structureAt(%s) === null) === %s" % (json.dumps(place), json.dumps(is_cut)))

    @campaign
    def test_strokes_are_undone_and_done_again(self):
        # a plane through the middle, and places in it within both strokes, and off them
        self.page.click("[data-layout=five]")
        self.let_another_viewer_lead()
        self.page.run("lead(arguments[0])", self.place)
        self.page.wait("Math.hypot(...palpateViewer.pose.devices[0].tip.map((x, i) => x - %s[i])) < 1e-6" % json.dumps(self.place))
        aside = [(x, z) for x in (-1, 0, 1, 2) for z in (-1.5, 0, 1.5)]
        parts = {name: [[at[0] + x, at[1], at[2] + z] for x, z in aside] for name, at in (("first", self.place), ("second", self.above), ("none", [*self.place[:2], self.place[2] + 16]))}
        seen = lambda: {name: numpy.array(self.page.run("""palpateViewer.draw();
                return arguments[0].map((p) => { const { x, y } = palpateViewer.pixelOf("coronal", p); return palpateViewer.colourAt("coronal", x, y); })""", places))
                        for name, places in parts.items()}

        def changed(before, *names):
            """What is seen when as much of it is another as should be, and waits for that: a picture comes after its voxels."""
            deadline = time.monotonic() + 60
            while True:
                now = seen()
                other = [name for name in parts if (now[name] != before[name]).any(-1).all()]
                same = [name for name in parts if (now[name] == before[name]).all()]
                if (other, same) == (list(names), [name for name in parts if name not in names]):
                    return now
                self.assertLess(time.monotonic(), deadline, (other, same))

        whole = seen()
        self.assertEqual(self.offered(), [False, False])
        self.switch(True)
        self.wait_for_strokes(1, 0)
        self.assertEqual(self.offered(), [False, False])
        self.assertEqual(self.page.run("return ['undo-stroke', 'redo-stroke'].map((id) => document.getElementById(id).title)"), 2 * ["First switch the motor off, or release its pedal"])
        once = changed(whole, "first")
        # removed tissue is tinted
        self.assertGreater((once["first"][:, 0] - once["first"][:, 1]).min(), 30)
        self.assertGreater(numpy.ptp(whole["first"], 1).min(), 8)
        self.switch(False)
        self.assertEqual(self.offered(), [True, False])
        self.switch(True)
        self.switch(False)
        twice = changed(whole, "first", "second")

        self.page.click("#undo-stroke")
        self.wait_for_strokes(1, 1)
        self.assertEqual(self.offered(), [True, True])
        changed(whole, "first")
        changed(twice, "second")
        self.assertEqual(self.told("removed"), "170 mm³ of femur removed")
        # by keys, which can be switched off; those of the page's own history are other ones
        key = "document.body.dispatchEvent(new KeyboardEvent('keydown', { bubbles: true, cancelable: true, ...arguments[0] }))"
        self.assertTrue(self.page.run("return document.getElementById('undo').disabled"))
        self.page.run(key, {"key": "z", "ctrlKey": True})
        self.page.run("document.getElementById('letters').click()")
        self.page.run(key, {"key": "u"})
        self.page.run("document.getElementById('letters').click()")
        self.page.run(key, {"key": "U", "shiftKey": True})
        self.wait_for_strokes(2, 0)
        self.assertEqual(self.offered(), [True, False])
        changed(twice)
        # a key that is held asks for one stroke only: what is asked for next is answered after it
        self.page.run(key, {"key": "u", "repeat": True})
        self.page.click("#pause")
        self.page.wait("palpateViewer.state.paused")
        self.wait_for_strokes(2, 0)
        for left in (1, 0):
            self.page.run(key, {"key": "u"})
            self.wait_for_strokes(left, 2 - left)
        self.assertEqual(self.offered(), [False, True])
        changed(whole)
        self.assertEqual(self.told("removed"), "")
        self.page.click("#redo-stroke")
        self.wait_for_strokes(1, 1)
        changed(once)
        # another stroke is where the one that was undone had been
        self.switch(True)
        self.switch(False)
        self.wait_for_strokes(2, 0)
        self.assertEqual(self.offered(), [True, False])
        changed(twice)

    @campaign
    def test_the_buttons_of_strokes_fit_on_every_screen(self):
        self.addCleanup(self.page.resize, *SIZE)
        for language, width, height in [(language, *size) for language in ("de", "en") for size in ((390, 844), (768, 1024), (1024, 768), (1366, 768), (1920, 1080))]:
            with self.subTest(language=language, width=width):
                speak(self.page, language)
                self.page.resize(width, height)
                self.page.wait(f"innerWidth <= {width}")
                self.assertLessEqual(self.page.run("return document.documentElement.scrollWidth"), width)
                panel, *boxes = self.page.run("""return ["panel", "pause", "motor", "rearm", "undo-stroke", "redo-stroke"].map((id) => {
                    const one = document.getElementById(id), r = one.getBoundingClientRect();
                    return [id, r.left, r.top, r.right, r.bottom, one.scrollWidth - one.clientWidth];
                })""")
                self.assertEqual([a[0] for a in (panel, *boxes) if a[5] > 0], [], "clipped")
                self.assertEqual([a for a in boxes if a[1] < panel[1] or a[3] > panel[3] or a[3] - a[1] < 24 or a[4] - a[2] < 24], [])
                self.assertEqual([(a[0], b[0]) for n, a in enumerate(boxes) for b in boxes[n + 1:]
                                  if min(a[3], b[3]) > max(a[1], b[1]) and min(a[4], b[4]) > max(a[2], b[2])], [])


class WithSphere(Viewer):
    """One of 20 mm, of voxels of 0.5 mm: the mock's alone."""

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


class WithDevice(Viewer):
    """A physical device, of which somebody agrees to everything after a while: the mock's."""

    draws_seldom = False

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


class WithManyVoxels(Viewer):
    """As many as a knee has that was scanned: the mock's alone, which says when a stop came."""

    draws_seldom = False

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


class WithRecording(Viewer):
    """A recording that is looked at: palpate replay --view."""

    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory(prefix="palpate-recording-")
        cls.addClassCleanup(folder.cleanup)
        cls.program, cls.recording = simulated(folder.name)
        cls.server = Server("recording")
        cls.server.command = lambda: [cls.program, "replay", cls.recording, "--view", "--port", str(cls.server.port)]
        cls.server.__enter__()
        cls.addClassCleanup(cls.server.__exit__)
        cls.scene = cls.server.scene()
        cls.open_browser()
        import h5py
        with h5py.File(cls.recording) as run:
            cls.time_s = run["ticks/time_s"][:]
            cls.tip_mm = run["device0/tip_patient_mm"][:]
            cls.force_N = run["device0/force_N"][:]
            cls.label = run["device0/label"][:]

    def go(self, at_s):
        self.page.run("const place = document.getElementById('place'); place.value = arguments[0];"
                      "place.dispatchEvent(new Event('input', { bubbles: true }))", at_s)

    def test_every_place_shows_the_tick_of_the_recording(self):
        self.assertEqual(self.page.run("return document.getElementById('playback').hidden"), False)
        for row in (0, 4095, 4096, len(self.time_s) - 1, 1234, len(self.time_s) // 2):
            # in the middle of the tick, for a slider rounds
            self.go(self.time_s[row] + 0.0005)
            self.page.wait(f"palpateViewer.pose.tick === {row}")
            pose = self.page.run("return palpateViewer.pose")
            self.assertLess(abs(pose["time"] - self.time_s[row]), 1e-9)
            device = pose["devices"][0]
            for shown, recorded in ((device["tip"], self.tip_mm[row]), (device["force"], self.force_N[row])):
                self.assertTrue((numpy.float32(recorded) == numpy.array(shown, numpy.float32)).all(), (row, shown, recorded))
            self.assertEqual(device["label"], self.label[row])
            self.page.run("palpateViewer.draw()")
            self.assertIn(f"tick {row}", self.page.run("return document.getElementById('play-time').textContent"))

    def test_it_plays_steps_and_rests_at_a_stop(self):
        self.go(self.time_s[2000] + 0.0005)
        self.page.wait("palpateViewer.pose.tick === 2000")
        self.page.click("#tick-on")
        self.page.wait("palpateViewer.pose.tick === 2001")
        for tick in (2000, 1999):
            self.page.click("#tick-back")
            self.page.wait(f"palpateViewer.pose.tick === {tick}")
        # backwards, to a stop
        self.page.run("const speed = document.getElementById('play-speed'); speed.value = '-0.25'; speed.dispatchEvent(new Event('change'))")
        self.page.wait("palpateViewer.state.playback.speed === -0.25")
        self.page.click("#play")
        self.page.wait("palpateViewer.state.playback.playing && palpateViewer.pose.tick < 1980")
        self.page.press(" ")
        self.page.wait("!palpateViewer.state.playback.playing")
        self.assertEqual(self.page.run("return [palpateViewer.state.stop, palpateViewer.state.emergency_stop]"), [None, False])
        # what was felt cannot be changed
        disabled = self.page.run("return ['method', 'limit', 'pause', 'rearm'].map((id) => document.getElementById(id).disabled)")
        self.assertEqual(disabled, [True] * 4)

    @campaign
    def test_its_contacts_are_places_to_go_to(self):
        contacts = self.scene["recording"]["contacts"]
        names = {s["label"]: s["name"] for s in self.scene["structures"]}
        self.assertEqual([names[label] for _, _, label, *_ in contacts][:2], ["patella", "tibia"])
        listed = self.page.run("return [...document.getElementById('marks').options].map((one) => one.textContent)")
        self.assertEqual(len(listed), 1 + len(contacts) + len(self.scene["recording"]["events"]))
        for begin_s, end_s, label, max_N, device in contacts[:2]:
            self.assertEqual(device, 0)
            rows = (self.time_s >= begin_s) & (self.time_s < end_s)
            self.assertAlmostEqual(numpy.linalg.norm(self.force_N[rows], axis=1).max(), max_N, 9)
            self.page.run("const marks = document.getElementById('marks'); marks.value = arguments[0]; marks.dispatchEvent(new Event('change'))", str(begin_s))
            self.page.wait(f"palpateViewer.pose.devices[0].label === {label}")
        # the line has the structure's colour where it was touched
        colour = self.page.run("""palpateViewer.draw();
            const line = document.getElementById("line");
            const { begin_s, end_s } = palpateViewer.scene.recording;
            const x = Math.floor(((arguments[0] - begin_s) / (end_s - begin_s)) * line.width);
            return [...line.getContext("2d").getImageData(x, line.height - 3, 1, 1).data.slice(0, 3)];""", sum(contacts[0][:2]) / 2)
        wanted = next(s["colour"] for s in self.scene["structures"] if s["label"] == contacts[0][2])
        self.assertTrue(all(abs(a - b) <= 2 for a, b in zip(colour, wanted)), (colour, wanted))

    @campaign
    def test_each_device_has_a_row_of_the_time_line(self):
        # of the two contacts, the later one is another device's
        first, second = self.scene["recording"]["contacts"][:2]
        script = self.page.developer_tools("Page.addScriptToEvaluateOnNewDocument", source="""{
            const honest = Response.prototype.json;
            Response.prototype.json = async function () {
              const read = await honest.call(this);
              if (read.recording) read.recording.contacts[1][4] = 1;
              return read;
            };
        }""")
        self.open_page()
        self.page.developer_tools("Page.removeScriptToEvaluateOnNewDocument", **script)
        listed = self.page.run("return [...document.getElementById('marks').options].map(({ value, textContent }) => [Number(value), textContent])")
        for contact, of in ((first, "device 1"), (second, "device 2")):
            self.assertTrue(any(at_s == contact[0] and text.endswith(of) for at_s, text in listed), listed)
        # the middle of each row, in the middle of each contact: [contact][row] -> RGBA
        rows = self.page.run("""palpateViewer.draw();
            const line = document.getElementById("line");
            const { begin_s, end_s } = palpateViewer.scene.recording;
            const x = (s) => Math.floor(((s - begin_s) / (end_s - begin_s)) * line.width);
            const { data } = line.getContext("2d").getImageData(0, 0, line.width, line.height);
            const at = (s, part) => 4 * (x(s) + line.width * Math.floor(part * line.height));
            return arguments[0].map((s) => [0.715, 0.905].map((part) => [...data.slice(at(s, part), at(s, part) + 4)]));""",
                             [sum(contact[:2]) / 2 for contact in (first, second)])
        for n, contact in enumerate((first, second)):
            wanted = next(s["colour"] for s in self.scene["structures"] if s["label"] == contact[2])
            self.assertLessEqual(max(abs(a - b) for a, b in zip(rows[n][n], wanted)), 2, rows)
            self.assertEqual(rows[n][1 - n][3], 0, rows)


class WithMilling(Viewer):
    """palpate itself with a burr, and bone that is protected, which is cut all the same and said."""

    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory(prefix="palpate-burr-")
        cls.addClassCleanup(folder.cleanup)
        program, knee, scene = command(0, "pointer", None)[0], os.path.join(folder.name, "knee"), os.path.join(folder.name, "scene.toml")
        palpate = lambda *arguments: subprocess.run([program, "-q", *arguments], check=True, stdout=subprocess.DEVNULL)  # noqa: E731
        palpate("data", "fetch", "knee-phantom", "-o", knee, "--voxel", "1.5")
        palpate("scene", "new", os.path.join(knee, "knee-phantom.seg.nrrd"), "-o", scene)
        with open(scene, encoding="utf-8") as file:
            text = file.read().replace('preset = "bone"', 'preset = "bone"\nprotection = "alarm"', 1)
        with open(scene, "w", encoding="utf-8") as file:
            file.write(text + '\n[tool]\nkind = "burr"\ndiameter = 4\nspindle = [1, 0, 0]\n')
        cls.server = Server("pointer")
        cls.server.command = lambda: [program, "explore", scene, "--port", str(cls.server.port), "--seconds", "600", "--device", "pointer"]
        cls.server.__enter__()
        cls.addClassCleanup(cls.server.__exit__)
        cls.scene = cls.server.scene()
        cls.labels, cls.patient_from_voxel = cls.server.labels(cls.scene)
        cls.open_browser()

    def lead(self, place):
        """There, and it stays."""
        self.page.run("clearInterval(window.leading); window.leading = setInterval(lead, 30, arguments[0])", place)
        self.page.wait("Math.hypot(...palpateViewer.pose.devices[0].tip.map((mm, axis) => mm - %s[axis])) < 0.1" % json.dumps(place))

    def switch(self, on):
        self.page.click("#motor")
        self.page.wait(f"[palpateViewer.state.motor, palpateViewer.state.motor_is_on].every((is) => is === {json.dumps(on)})")

    def test_a_stroke_is_seen_undone_and_done_again(self):
        structure = next(structure for structure in self.scene["structures"] if structure["name"] == "patella")
        voxels = numpy.argwhere(self.labels == structure["label"])
        places = voxels @ self.patient_from_voxel[:3, :3].T + self.patient_from_voxel[:3, 3]
        front = places[places[:, 1].argmin()]  # anterior is -y
        place, before = front.tolist(), [front[0], front[1] - 12, front[2]]
        at_place = f"palpateViewer.structureAt({json.dumps(place)})"
        strokes = lambda undo, redo: "JSON.stringify(palpateViewer.state.strokes) === '%s'" % json.dumps(  # noqa: E731
            {"undo": undo, "redo": redo}, separators=(",", ":"))
        removed = f"(palpateViewer.state.removed.find(({{ label }}) => label === {structure['label']})?.mm3 ?? 0)"
        self.let_another_viewer_lead()
        self.lead(before)
        self.page.wait("(palpateViewer.pose.devices[0].flags & 256) === 0")  # its force has come in
        self.page.wait(f"{at_place} !== null")
        self.assertTrue(self.page.run("return document.getElementById('undo-stroke').disabled"))
        self.switch(True)
        self.lead([front[0], front[1] + 1, front[2]])
        self.page.wait(f"{removed} > 5 && {at_place} === null")
        self.assertIn("patella", self.page.run("return document.getElementById('damage').textContent").lower())
        self.assertTrue(self.page.run("return document.getElementById('undo-stroke').disabled"), "the stroke is not over")
        self.lead(before)
        self.switch(False)
        self.page.wait(strokes(1, 0))
        gone_mm3 = self.page.run(f"return {removed}")
        self.page.click("#undo-stroke")
        self.page.wait(f"{strokes(0, 1)} && {removed} === 0 && {at_place} !== null")
        self.page.click("#redo-stroke")
        self.page.wait(f"{strokes(1, 0)} && {removed} === {gone_mm3} && {at_place} === null")
        self.page.run("clearInterval(window.leading)")


class WithKeptAway(Viewer):
    """palpate itself with no-go regions: a ball before the knee, the patella, a plane; and distances of all structures. Then what was recorded of it."""

    BALL_MM, BALL_AWAY_MM, PATELLA_AWAY_MM = 6, 2, 4

    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory(prefix="palpate-kept-away-")
        cls.addClassCleanup(folder.cleanup)
        cls.program, knee = command(0, "pointer", None)[0], os.path.join(folder.name, "knee")
        cls.scene_file, cls.recording = (os.path.join(folder.name, name) for name in ("scene.toml", "run.h5"))
        cls.palpate("data", "fetch", "knee-phantom", "-o", knee, "--voxel", "1.5")
        cls.palpate("scene", "new", os.path.join(knee, "knee-phantom.seg.nrrd"), "-o", cls.scene_file)
        # the ball is where no structure is: 30 mm before the patella
        cls.server = cls.explores()
        with cls.server:
            scene = cls.server.scene()
            labels, patient_from_voxel = cls.server.labels(scene)
        cls.patella = next(structure for structure in scene["structures"] if structure["name"] == "patella")
        places = numpy.argwhere(labels == cls.patella["label"]) @ patient_from_voxel[:3, :3].T + patient_from_voxel[:3, 3]
        cls.front = places[places[:, 1].argmin()].tolist()  # anterior is -y
        cls.ball = [cls.front[0], cls.front[1] - 30, cls.front[2]]
        with open(cls.scene_file, "a", encoding="utf-8") as file:
            file.write(f"""
[distances]
structures = "all"
reach = 25

[[no_go]]
name = "the_ball"
centre = {cls.ball}
radius = {cls.BALL_MM}
keep_away = {cls.BALL_AWAY_MM}

[[no_go]]
name = "patella"
structures = ["patella"]
keep_away = {cls.PATELLA_AWAY_MM}

[[no_go]]
name = "behind"
point = [{cls.ball[0] + 60}, 0, 0]
outward = "right"
""")
        cls.server = cls.explores().__enter__()
        cls.addClassCleanup(cls.server.__exit__)
        cls.scene = cls.server.scene()
        cls.radius_mm = cls.scene["tool"]["radius_mm"]
        cls.open_browser()

    @classmethod
    def palpate(cls, *arguments):
        subprocess.run([cls.program, "-q", *arguments], check=True, stdout=subprocess.DEVNULL)

    @classmethod
    def explores(cls, *more):
        server = Server("pointer")
        server.command = lambda: [cls.program, "explore", cls.scene_file, "--device", "pointer", "--port", str(server.port), "--seconds", "600", *more]
        return server

    def lead(self, place):
        self.page.run("clearInterval(window.leading); window.leading = setInterval(() => window.lead(arguments[0]), 30)", place)
        self.page.wait(f"Math.hypot(...palpateViewer.pose.devices[0].tip.map((x, n) => x - {json.dumps(place)}[n])) < 0.01")

    def before_ball(self, mm):
        """So far from where the ball begins to push."""
        return [self.ball[0], self.ball[1] - self.BALL_MM - self.BALL_AWAY_MM - self.radius_mm - mm, self.ball[2]]

    def text(self, name):
        return self.page.run("palpateViewer.draw(); return document.getElementById(arguments[0]).textContent", name)

    def test_no_go_regions_are_listed_drawn_and_audible_until_a_stop(self):
        self.let_another_viewer_lead()
        self.page.run("""window.voices = { begun: 0, ended: 0 };
            for (const [what, name] of [["begun", "start"], ["ended", "stop"]]) {
              const honest = OscillatorNode.prototype[name];
              OscillatorNode.prototype[name] = function (...when) { window.voices[what] += 1; return honest.apply(this, when); };
            }""")
        self.assertEqual([region["name"] for region in self.scene["no_go"]], ["the_ball", "patella", "behind"])
        self.lead(self.before_ball(5))
        self.page.wait("palpateViewer.approach !== null && Math.abs(palpateViewer.approach.mm - 5) < 0.02")
        self.assertIn("the ball: 5.0", self.text("no-go"))
        self.assertIsNone(self.page.run("return palpateViewer.tone"), "it is off by default")
        self.page.press("n")
        self.page.wait("palpateViewer.tone?.beeps_per_s > 2")
        far = self.page.run("return palpateViewer.tone")
        self.lead(self.before_ball(1))
        self.page.wait(f"palpateViewer.tone?.beeps_per_s > {far['beeps_per_s']} && palpateViewer.tone.frequency_Hz > {far['frequency_Hz']}")

        # within it
        self.page.hear()
        self.lead(self.before_ball(-1.5))
        self.page.wait("palpateViewer.approach.pushes && palpateViewer.tone?.beeps_per_s === 0")
        self.assertAlmostEqual(self.page.run("return palpateViewer.approach.mm"), -1.5, delta=0.02)
        self.assertRegex(self.text("no-go"), r"⚠ the ball: 1\.5\d mm too close · pushed out with [\d.]+ m?N")
        self.page.wait("document.getElementById('flags').textContent.includes('pushed away from the ball')")
        self.page.wait("window.heard.some((text) => text.includes('pushed away from the ball'))")
        self.assertGreater(self.page.run("return Math.hypot(...palpateViewer.pose.devices[0].force)"), 0)
        # the ball's circle in the section, through whose middle it goes, and the rim
        circle = [[self.ball[0], self.ball[1] + self.BALL_MM * math.cos(angle), self.ball[2] + self.BALL_MM * math.sin(angle)] for angle in (0.3, 1.7, 4)]
        self.page.wait("palpateViewer.draw(), palpateViewer.pixelOf('oblique', %s).off_mm < 0.1" % json.dumps(circle[1]))
        self.assertGreater(min(self.page.run("return palpateViewer.drawnOver('oblique', arguments[0])", circle)), 100)
        rim = self.page.run("""palpateViewer.draw();
            const { width, rgba } = palpateViewer.drawnOverVolume(), bytes = atob(rgba);
            return Array.from({ length: width }, (_, n) => bytes.charCodeAt(4 * (2 * width + n) + 3)).filter((alpha) => alpha > 200).length / width;""")
        self.assertTrue(0.5 < rim < 0.9, rim)
        self.assertEqual(self.barriers(), [])
        self.page.resize(390, 844)
        self.addCleanup(self.page.resize, *SIZE)
        self.page.wait("innerWidth <= 390")
        self.page.dark(False)
        self.assertEqual(self.barriers(), [])
        self.page.dark(True)
        self.page.resize(*SIZE)

        # after a stop nothing is heard, nor after the sound is switched off, and it is told and drawn all the same
        voices = lambda: self.page.run("return [window.voices.begun, window.voices.ended]")  # noqa: E731
        begun, ended = voices()
        self.assertEqual(begun, ended + 1)
        self.page.press(" ")
        self.page.wait("palpateViewer.state.stop !== null && palpateViewer.tone === null")
        self.assertEqual(voices(), [begun, begun])
        time.sleep(0.5)
        self.assertEqual([*voices(), self.page.run("return palpateViewer.tone")], [begun, begun, None])
        self.assertIn("too close", self.text("no-go"))
        self.page.click("#sound")
        self.assertEqual(self.page.run("return document.getElementById('sound').ariaPressed"), "false")

        # what is near stands in its order, with what the ticks say
        self.lead([self.front[0], self.front[1] - 10, self.front[2]])
        self.page.wait("palpateViewer.near[0].structures[0].label === %d" % self.patella["label"])
        near = self.page.run("return palpateViewer.near[0].structures")
        self.assertEqual([one["mm"] for one in near], sorted(one["mm"] for one in near))
        self.assertLess(abs(near[0]["mm"] - (10 - self.radius_mm)), 1.5, "half a voxel, and a surface that is not quite flat")
        self.assertLessEqual(max(one["mm"] for one in near), 25)
        rows = self.page.run("""palpateViewer.draw();
            return [...document.querySelectorAll("#near tr")].filter((row) => !row.hidden).map((row) => [row.cells[0].textContent, row.cells[1].textContent, row.querySelector(".swatch").style.background]);""")
        names = {structure["label"]: structure["name"].replace("_", " ") for structure in self.scene["structures"]}
        self.assertEqual([row[0].split(" · ")[0] for row in rows], [names[one["label"]] for one in near])
        self.assertEqual(rows[0][:1], ["patella · keep 4.00 mm away"])
        self.assertTrue(all(row[1].endswith("mm") and row[2].startswith("rgb") for row in rows), rows)
        self.page.wait("palpateViewer.draw(), document.getElementById('near-words').textContent.startsWith('patella: ')")

        # the structure that pushes is lit, also where it was hidden
        inside = [self.front[0], self.front[1] + 3, self.front[2]]
        colour = """palpateViewer.draw(); const { x, y } = palpateViewer.pixelOf("sagittal", arguments[0]); return palpateViewer.colourAt("sagittal", x, y);"""
        self.page.run("document.querySelector('[data-layout=five]').click()")
        self.slide("#fill", 1)
        self.page.run("document.getElementById('hide-all').click()")
        self.page.wait("palpateViewer.areSectionsSharp")
        before = self.page.run(colour, inside)
        self.lead([self.front[0], self.front[1] - self.radius_mm - 1, self.front[2]])
        self.page.wait("palpateViewer.approach.pushes && palpateViewer.approach.region === 1")
        lit = self.page.run(colour, inside)
        self.assertTrue(all(abs(a - b) <= 3 for a, b in zip(lit, (255, 107, 94))), (before, lit))
        self.assertNotEqual(before, lit)
        self.lead(self.before_ball(40))
        self.page.wait("!palpateViewer.approach?.pushes")
        self.assertNotEqual(self.page.run(colour, inside), lit)
        self.page.run("clearInterval(window.leading)")

    @campaign
    def test_a_recording_tells_what_its_ticks_told(self):
        # a browser may keep a page that is left for another server's, and its connection with it
        self.page.wait("palpateViewer.state.pointer")
        self.page.click("[data-tool=window]")
        self.page.wait("!palpateViewer.state.pointer")
        script = self.recording.replace("run.h5", "script.toml")
        with open(script, "w", encoding="utf-8") as file:
            file.write('[[step]]\napproach = "patella"\n[[step]]\npress = 0.8\n')
        # the hand is kept from pressing: a step fails
        done = subprocess.run([self.program, "-q", "simulate", self.scene_file, "-s", script, "-o", self.recording], stdout=subprocess.DEVNULL)
        self.assertIn(done.returncode, (0, 3))
        server = Server("recording")
        server.command = lambda: [self.program, "replay", self.recording, self.scene_file, "--view", "--port", str(server.port)]
        with server:
            self.addCleanup(setattr, self, "server", self.server)
            self.server = server
            self.open_page()
            import h5py
            with h5py.File(self.recording) as run:
                time_s, no_go, depth, label, near = (run[name][:] for name in ("ticks/time_s", "device0/no_go", "device0/no_go_depth_mm", "device0/near_label", "device0/near_mm"))
            pushed = numpy.flatnonzero(no_go)
            self.assertGreater(len(pushed), 10)
            for row in (int(pushed[len(pushed) // 2]), int(pushed[0]) - 1):
                self.page.run("const place = document.getElementById('place'); place.value = arguments[0]; place.dispatchEvent(new Event('input', { bubbles: true }))", time_s[row] + 0.0005)
                self.page.wait(f"palpateViewer.pose.tick === {row}")
                told = self.page.run("return palpateViewer.near[0]")
                self.assertEqual([told["noGo"] + 1, [one["label"] for one in told["structures"]]], [no_go[row], [one for one in label[row] if one]])
                self.assertEqual([one["mm"] for one in told["structures"]], [float(numpy.float32(mm)) for mm in near[row][:len(told["structures"])]])
                self.assertEqual(told["depth"], float(numpy.float32(depth[row])))
                self.assertEqual(self.page.run("return palpateViewer.approach.pushes"), no_go[row] != 0)
                self.assertEqual("too close" in self.text("no-go"), no_go[row] != 0)
            # at rest it is silent
            self.page.press("n")
            time.sleep(0.3)
            self.assertIsNone(self.page.run("return palpateViewer.tone"))


class WithPlan(Viewer):
    """palpate itself with a plan, which is seen while it is rehearsed, changed by mouse, finger and keys, and saved."""

    PLAN = """title = "A hole into the femur"

[[trajectory]]
name = "hole"
entry = [34.0, -14.0, 18.0]
target = [20.0, -9.0, 24.0]
enters = ["femur"]
entry_within = 2.0

[[keep_away]]
structures = ["patella"]
distance = 6
"""

    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory(prefix="palpate-plan-")
        cls.addClassCleanup(folder.cleanup)
        cls.program, knee = command(0, "pointer", None)[0], os.path.join(folder.name, "knee")
        cls.scene_file, cls.plan = (os.path.join(folder.name, name) for name in ("scene.toml", "plan.toml"))
        for arguments in (("data", "fetch", "knee-phantom", "-o", knee, "--voxel", "1.5"),
                          ("scene", "new", os.path.join(knee, "knee-phantom.seg.nrrd"), "-o", cls.scene_file)):
            subprocess.run([cls.program, "-q", *arguments], check=True, stdout=subprocess.DEVNULL)
        with open(cls.scene_file, "a", encoding="utf-8") as file:
            file.write('\n[distances]\nstructures = "all"\n')
        with open(cls.plan, "w", encoding="utf-8") as file:
            file.write(cls.PLAN)
        cls.server = Server("pointer")
        cls.server.command = lambda: [cls.program, "explore", cls.scene_file, "--device", "pointer", "--plan", cls.plan, "--port", str(cls.server.port), "--seconds", "600"]
        cls.server.__enter__()
        cls.addClassCleanup(cls.server.__exit__)
        cls.open_browser()

    def text(self, name):
        return self.page.run("palpateViewer.draw(); return document.getElementById(arguments[0]).textContent", name)

    def saved(self):
        """What palpate reads of the plan's file."""
        done = subprocess.run([self.program, "plan", "show", self.plan, "--scene", self.scene_file], capture_output=True, text=True, check=True)
        return done.stdout

    def lead(self, place):
        self.page.run("clearInterval(window.leading); window.leading = setInterval(() => window.lead(arguments[0]), 30)", place)
        self.page.wait(f"Math.hypot(...palpateViewer.pose.devices[0].tip.map((x, n) => x - {json.dumps(place)}[n])) < 0.01")

    def test_the_tip_beside_a_trajectory_has_its_figures_and_what_comes_too_near_is_warned_of(self):
        entry, target = numpy.array([34.0, -14, 18]), numpy.array([20.0, -9, 24])
        axis = (target - entry) / numpy.linalg.norm(target - entry)
        aside = numpy.cross(axis, [0, 0, 1])
        aside /= numpy.linalg.norm(aside)
        self.assertNotIn("A hole into the femur", self.page.run("return document.body.textContent"), "its title is told to nobody")
        self.let_another_viewer_lead()
        self.lead((entry - 12 * axis + 3 * aside).tolist())
        self.page.wait("palpateViewer.draw(), document.getElementById('plan-nearest').textContent === 'hole'")
        left = numpy.linalg.norm(target - entry) + 12
        self.assertEqual([self.text("plan-lateral"), self.text("plan-left"), self.text("plan-angle")], ["3.00 mm", f"{left:.1f} mm", "–"])
        # its line is drawn in the section where that goes through both of its ends
        self.assertTrue(self.page.run("return document.getElementById('plan-breach').hidden"))
        self.page.run("document.querySelector('#plan-list .figure').click()")
        self.page.run("[...document.querySelectorAll('#plan-list .end button')].find((one) => one.dataset.plan === 'show-entry_mm-0').click(); document.querySelector('[data-layout=five]').click()")
        self.page.wait("palpateViewer.draw(), palpateViewer.pixelOf('axial', [34, -14, 18]).off_mm < 0.01")
        drawn = self.page.run("return palpateViewer.drawnOver('axial', [[31.2, -13, 19.2], [34, -14, 18]])")
        self.assertGreater(min(drawn), 60)
        # the patella's middle is far within what is to be kept away from it
        scene = self.server.scene()
        labels, patient_from_voxel = self.server.labels(scene)
        patella = next(structure["label"] for structure in scene["structures"] if structure["name"] == "patella")
        places = numpy.argwhere(labels == patella) @ patient_from_voxel[:3, :3].T + patient_from_voxel[:3, 3]
        front = places[places[:, 1].argmin()]
        self.page.hear()
        self.lead([front[0], front[1] - 6, front[2]])
        self.page.wait("palpateViewer.draw(), !document.getElementById('plan-breach').hidden")
        self.assertRegex(self.text("plan-breach"), r"⚠ patella: distance [\d.]+ mm, planned at least 6.00 mm")
        self.page.wait("window.heard.some((text) => text.includes('closer to patella than planned'))")
        self.assertEqual(self.barriers(), [])
        self.page.run("clearInterval(window.leading)")

    @campaign
    def test_a_trajectory_is_made_moved_undone_and_saved(self):
        page, places = self.page, "palpateViewer.plan.list.map(({ name }) => name).join()"
        # and drawn, or a press would be where the picture is another size
        page.run("document.querySelector('[data-layout=section]').click()")
        page.wait("palpateViewer.draw(), document.querySelector('#picture-oblique canvas').width > 500 && palpateViewer.areSectionsSharp")
        page.press("e")
        page.wait("palpateViewer.plan.isShared && document.querySelector('[data-tool=plan]').ariaChecked === 'true'")
        # and the section has come to rest, in its place and in what it shows
        page.wait("palpateViewer.draw(), (() => { const before = window.seenBefore; window.seenBefore = JSON.stringify([palpateViewer.pixelOf('oblique', [0, 0, 0]), "
                  "document.querySelector('#picture-oblique .stack').getBoundingClientRect()]); return window.seenBefore === before; })()")
        # two presses in the section
        left, top, width, height = self.box("#picture-oblique .stack")
        points = [(round(left + a * width), round(top + b * height)) for a, b in ((0.3, 0.3), (0.45, 0.6))]
        for x, y in points:
            page.pointer({"type": "pointerMove", "x": x, "y": y}, {"type": "pointerDown", "button": 0}, {"type": "pointerUp", "button": 0})
        page.wait(f"{places} === 'hole,Trajectory 2'")
        made = page.run("return palpateViewer.plan.list[1]")
        for end, (x, y) in zip(("entry_mm", "target_mm"), points):
            seen = page.run("return palpateViewer.pixelOf('oblique', arguments[0])", made[end])
            self.assertLess(abs(seen["x"] - (x - left)) + abs(seen["y"] - (y - top)), 2.5)
        # its target is dragged, by a finger; of the first ones a browser may lose some
        is_moved = f"palpateViewer.plan.list[1].target_mm.some((x, n) => Math.abs(x - {json.dumps(made['target_mm'])}[n]) > 1)"
        for _ in range(10):
            for kind, touched in (("Start", [points[1]]), ("Move", [(points[1][0] + 30, points[1][1])]), ("Move", [(points[1][0] + 60, points[1][1])]), ("End", [])):
                page.developer_tools("Input.dispatchTouchEvent", type="touch" + kind, touchPoints=[{"x": x, "y": y, "id": 0} for x, y in touched])
            time.sleep(0.5)
            if page.run("return " + is_moved):
                break
        page.wait(is_moved)
        moved = page.run("return palpateViewer.plan.list[1]")
        self.assertEqual(moved["entry_mm"], made["entry_mm"])
        # and named and placed by keys alone
        page.run("document.querySelector('[data-plan=name-1]').focus()")
        page.run("document.activeElement.value = ''")
        for key in "second\ue007":
            page.press(key)
        page.run("document.activeElement.blur()")
        page.wait(f"{places} === 'hole,second'")
        page.run("document.querySelector('[data-plan=at-entry_mm-1]').focus(); document.activeElement.value = ''")
        for key in "1,2,3.5\ue007":
            page.press(key)
        page.run("document.activeElement.blur()")
        page.wait("palpateViewer.plan.list[1].entry_mm.join() === '1,2,3.5'")
        # undone one by one, and done again
        for wanted in ("palpateViewer.plan.list[1].entry_mm.join() !== '1,2,3.5'", f"{places} === 'hole,Trajectory 2'"):
            page.click("#undo")
            page.wait(wanted)
        page.click("#redo")
        page.wait(f"{places} === 'hole,second'")
        with open(self.plan, encoding="utf-8") as file:
            self.assertEqual(file.read(), self.PLAN, "nothing is written unasked")
        self.assertEqual(self.barriers(), [])
        page.click("#plan-save")
        page.wait("palpateViewer.plan.plan.saved")
        shown = self.saved()
        self.assertIn("trajectory second", shown)
        self.assertIn("keep away       6 mm from patella", shown)
        # somebody else changes the file: it is left as it is
        with open(self.plan, "a", encoding="utf-8") as file:
            file.write("# by somebody else\n")
        page.run("document.querySelector('[data-plan=remove-1]').click()")
        page.wait(f"{places} === 'hole'")
        page.click("#plan-save")
        page.wait("!document.getElementById('toast').hidden && document.getElementById('toast').textContent.includes('has been changed since')")
        with open(self.plan, encoding="utf-8") as file:
            self.assertIn("# by somebody else", file.read())
        with open(self.plan, "w", encoding="utf-8") as file:
            file.write(self.PLAN)


class WithTokens(Viewer):
    draws_seldom = False

    CONTROL, VIEW = "control-token-0123456789", "view-token-01234567890"

    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory(prefix="palpate-tokens-")
        cls.addClassCleanup(folder.cleanup)
        tokens = os.path.join(folder.name, "tokens")
        with open(os.open(tokens, os.O_WRONLY | os.O_CREAT, 0o600), "w", encoding="utf-8") as file:
            file.write(f"control {cls.CONTROL}\nview {cls.VIEW}\n")
        cls.server = Server("script", tokens).__enter__()
        cls.addClassCleanup(cls.server.__exit__)
        cls.open_browser()

    def setUp(self):
        self.expected = ("401",)
        self.open_page(wait=None)
        self.page.run("sessionStorage.clear()")
        self.open_page(wait="document.querySelector('#token-dialog').open")

    def show(self, token):
        self.page.run("document.getElementById('token').value = arguments[0]", token)
        self.page.click("#token-form button")

    def test_token_opens_the_page_and_is_in_no_address(self):
        # nothing else would ask for it
        for _ in range(2):
            self.page.press("\ue00c")  # Escape
            self.page.wait("document.querySelector('#token-dialog').open")
        self.show("wrong-token-wrong-token")
        self.page.wait("document.querySelector('#token-dialog').open && !document.getElementById('token-problem').hidden")
        self.show(self.CONTROL)
        self.page.wait(LOADED)
        self.assertEqual(self.page.run("return palpateViewer.role"), "control")
        addresses = self.page.run("return [location.href, ...performance.getEntriesByType('resource').map((entry) => entry.name)]")
        self.assertFalse([address for address in addresses if "token" in address])
        # kept for this tab
        self.open_page()

def decode_png(data):
    """Width, height and an array [row, column, channel] of an 8-bit PNG of a browser."""
    at, parts, head = 8, b"", None
    while at < len(data):
        size, kind = struct.unpack(">I4s", data[at:at + 8])
        body = data[at + 8:at + 8 + size]
        if kind == b"IHDR":
            head = struct.unpack(">IIBBBBB", body)
        elif kind == b"IDAT":
            parts += body
        at += 12 + size
    width, height, channels = head[0], head[1], {2: 3, 6: 4}[head[3]]
    rows = numpy.frombuffer(zlib.decompress(parts), numpy.uint8).reshape(height, 1 + width * channels)
    out = numpy.zeros((height, width, channels), numpy.uint8)
    above = numpy.zeros((width, channels), int)
    for y in range(height):
        kind, line = rows[y, 0], rows[y, 1:].reshape(width, channels).astype(int)
        if kind == 2:
            line = (line + above) & 255
        elif kind == 1:
            line = numpy.cumsum(line, 0) & 255
        elif kind in (3, 4):
            left = upper_left = numpy.zeros(channels, int)
            for x in range(width):
                up = above[x]
                if kind == 3:
                    guess = (left + up) // 2
                else:
                    p = left + up - upper_left
                    distances = abs(numpy.stack([p - left, p - up, p - upper_left]))
                    guess = numpy.choose(distances.argmin(0), [left, up, upper_left])
                left, upper_left = (line[x] + guess) & 255, up
                line[x] = left
        out[y] = above = line
    return width, height, out


WITH_MOCK = (WithDevice, WithRamp, WithTrouble, WithoutParts, WithLoading, WithFinger, WithShaft, WithTwoTools, WithBurr, WithSphere, WithManyVoxels)


def main(arguments):
    global command
    if arguments[:1] == ["--campaigns"]:
        Lane.campaigns = True
        del arguments[0]
    if len(arguments) >= 2 and arguments[0] == "palpate":
        command = palpate_command(arguments[1])
        named = arguments[2:] or [case.__name__ for case in Viewer.__subclasses__() if case not in WITH_MOCK]
    elif len(arguments) >= 4 and arguments[0] == "mock":
        command = mock_command(*arguments[1:4])
        named = arguments[4:] or [case.__name__ for case in WITH_MOCK]
    else:
        sys.exit(__doc__)
    lack = browser.missing() or (numpy is None and "python3-numpy is not installed")
    if lack:
        print("skipped: " + lack)
        sys.exit(1 if os.environ.get("CI") == "true" else 77)
    unittest.main(argv=[sys.argv[0], *named], verbosity=2, testLoader=Lane())


if __name__ == "__main__":
    main(sys.argv[1:])
