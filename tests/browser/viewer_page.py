"""Base of the tests that open the viewer page in headless Chromium against a running server: servers, the browser and its pages.

The tests are in scripts by subject. Those that call `main` run with palpate or with the mock server as viewer_test.py explains; the others
choose a program by `use_program` or the mock by `use_mock` and call `browser.run_tests`.
"""

import atexit
import base64
import json
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

import browser

try:
    import numpy
except ImportError:
    numpy = None
NUMPY_NEEDED = None if numpy else "python3-numpy is not installed"

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

program = None  # path of the palpate that is tested; none with the mock server
command = None  # command line of a server, given (port, input, token file or None)


def use_program(path, command_of=None):
    """Tests this palpate. `command_of(program)` returns the function that `command` becomes, by default `palpate_command`."""
    global program, command
    program = os.path.abspath(path)
    command = (command_of or palpate_command)(program)


def use_mock(node, mock, page):
    """Tests the page in a folder with the mock server."""
    global command
    command = mock_command(node, mock, page)


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
    atexit.register(folder.cleanup)

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
    uses_mock = False  # tested with the mock server, not with palpate
    expected = ()  # parts of messages that a test brings about
    limits_frame_rate = True  # not where it matters what goes on while it draws

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
            atexit.register(Viewer.page.__exit__)
        # left before its server ends, or it says so in the next test
        cls.addClassCleanup(Viewer.page.post, "/url", {"url": "about:blank"})

    def open_page(self, wait=LOADED, keep_storage=False):
        """@param keep_storage  what the browser has kept of the page until now"""
        if not keep_storage:
            # stops the page that is still open from storing more. It is replaced directly: via about:blank Chromium
            # drops the first two touch points after a slider was touched.
            self.page.run("try { localStorage.clear(); } catch { /* the browser's first page has none */ } Storage.prototype.setItem = () => {};")
        self.page.dark(True)
        self.page.resize(*SIZE)
        self.page.log()
        self.page.post("/url", {"url": self.server.url})
        if wait:
            self.page.wait(wait)
            if self.limits_frame_rate:
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

    def accessibility_violations(self):
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


def main(arguments, *modules):
    """Runs the tests of scripts, which share one browser. The classes' `uses_mock` selects those that run with the
    chosen server.

    @param arguments  those of the command line, as viewer_test.py explains them
    @param modules  the scripts' modules
    """
    if arguments[:1] == ["--campaigns"]:
        Lane.campaigns = True
        del arguments[0]
    is_mock = arguments[:1] == ["mock"]
    if is_mock and len(arguments) >= 4:
        use_mock(*arguments[1:4])
        named = arguments[4:]
    elif arguments[:1] == ["palpate"] and len(arguments) >= 2:
        use_program(arguments[1])
        named = arguments[2:]
    else:
        sys.exit(sys.modules["__main__"].__doc__)
    cases = {name: case for module in modules for name, case in vars(module).items()
             if isinstance(case, type) and issubclass(case, Viewer) and case.__module__ == module.__name__}
    named = named or [name for name, case in cases.items() if case.uses_mock == is_mock]
    if unknown := [name for name in named if name.split(".")[0] not in cases]:
        sys.exit("no such tests: " + ", ".join(unknown))
    if not named:
        sys.exit("none of these tests run with " + ("the mock server" if is_mock else "palpate"))
    names = [f"{cases[name.split('.')[0]].__module__}.{name}" for name in named]
    browser.run_tests(NUMPY_NEEDED, module=None, argv=[sys.argv[0], *names], testLoader=Lane())
