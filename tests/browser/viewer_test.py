"""Opens the viewer page in headless Chromium against a running server and uses it as a person would.

usage: viewer_test.py palpate PALPATE [TEST ...]          (`palpate explore knee-phantom`, coarse)
       viewer_test.py mock NODE MOCK_SERVER PAGE_FOLDER [TEST ...]

Exit code 77 (a skip) where there is no browser, except in CI, where that is a failure.
"""

import base64
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

# the software renderer, also where there is a graphics card: the same picture everywhere
browser.ARGUMENTS = [argument for argument in browser.ARGUMENTS if argument != "--disable-gpu"] + [
    "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
SIZE = (1024, 640)  # a small one: the pictures are computed by the processor
LOADED = "window.palpateViewer !== undefined && palpateViewer.isLoaded && palpateViewer.isFresh"
# of the pixel under the tip: how many structures are looked for, and at how many places; all of it is 8 structures
STRUCTURES, POSITIONS = int(os.environ.get("PALPATE_TEST_STRUCTURES", "3")), 3
BLENDING = 1 << 15  # of a pose's flags

command = None  # of the server: (port, input, token file) -> arguments


def test_seed():
    """The same in every run unless PALPATE_TEST_SEED says another, or "any" (src/base/test_seed.h)."""
    asked = os.environ.get("PALPATE_TEST_SEED", "20261121")
    return random.randrange(1 << 30) if asked == "any" else int(asked)


def palpate_command(program):
    def arguments(port, source, tokens):
        # as a developer's machine with other work to do would run it: no lateness is asserted here
        return [program, "explore", "knee-phantom:spacing=1.2", "--port", str(port), "--seconds", "600",
                *(["--device", "pointer"] if source == "pointer" else ["--repeat"]),
                *(["--token-file", tokens] if tokens else [])]
    return arguments


def mock_command(node, mock, page):
    with open(os.path.join(page, "index.html"), encoding="utf-8"):
        pass  # says so when it is not there
    folder = tempfile.TemporaryDirectory(prefix="palpate-page-")
    os.mkdir(os.path.join(folder.name, "assets"))
    for name in ("index.html", "viewer.js", "viewer.css", "icon.svg"):
        place = folder.name if name == "index.html" else os.path.join(folder.name, "assets")
        os.symlink(os.path.join(os.path.abspath(page), name), os.path.join(place, name))
    unittest.addModuleCleanup(folder.cleanup)

    def arguments(port, source, tokens):
        return [node, mock, "--port", str(port), "--input", source, "--page", folder.name,
                *(["--token-file", tokens] if tokens else [])]
    return arguments


class Server:
    """A context manager; `restart` on the same port."""

    def __init__(self, source, tokens=None):
        self.port, self.source, self.tokens = browser.free_port(), source, tokens
        self.url = f"http://127.0.0.1:{self.port}/"
        self.log = tempfile.TemporaryFile()

    def __enter__(self):
        self.log.seek(0)
        self.process = subprocess.Popen(command(self.port, self.source, self.tokens), stdin=subprocess.DEVNULL,
                                        stdout=self.log, stderr=self.log)
        deadline = time.monotonic() + 120
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
        with urllib.request.build_opener(urllib.request.ProxyHandler({})).open(request, timeout=120) as answer:
            data = answer.read()
            return zlib.decompress(data, 31) if answer.headers.get("Content-Encoding") == "gzip" else data

    def scene(self):
        return json.loads(self.get("api/scene"))

    def labels(self, scene):
        """Array [i, j, k] and the affine from voxels to the patient."""
        volume = scene["volume"]
        voxels = numpy.frombuffer(self.get("api/volume/labels/" + volume["hash"]), volume["labels"]["type"])
        return voxels.reshape(volume["dims"][::-1]).transpose(2, 1, 0), numpy.array(volume["patient_from_voxel"])


def rotation_matrix(q):
    w, x, y, z = q
    return numpy.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])


class Viewer(unittest.TestCase):
    """Opens the page of a server; every message in the browser's console is a failure."""

    server = None
    expected = ()  # parts of messages that a test brings about

    @classmethod
    def open_browser(cls):
        cls.page = browser.Browser().__enter__()
        cls.addClassCleanup(cls.page.__exit__)

    def open_page(self, wait=LOADED):
        self.page.dark(True)
        self.page.resize(*SIZE)
        self.page.log()
        self.page.post("/url", {"url": self.server.url})
        if wait:
            self.page.wait(wait, 60)

    def setUp(self):
        self.expected = ()
        self.open_page()

    def tearDown(self):
        messages = [entry["message"] for entry in self.page.log()]
        self.assertEqual([m for m in messages if not any(part in m for part in self.expected)], [])

    def run_async(self, script):
        return self.page.post("/execute/async", {"script": "const done = arguments[arguments.length - 1];" + script, "args": []})

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

    def approaches(self, label, count, generator):
        """Places where a straight way through free space ends `depth` inside a structure: [(start, end)], patient, mm."""
        voxel = numpy.linalg.norm(self.patient_from_voxel[:3, 0])
        deep, free = max(2, round(1.0 / voxel)), round(5 / voxel)
        candidates = numpy.argwhere(self.labels == label)
        order = list(range(len(candidates)))
        generator.shuffle(order)
        directions = [(dx, dy, dz) for dx in (-1, 0, 1) for dy in (-1, 0, 1) for dz in (-1, 0, 1) if (dx, dy, dz) != (0, 0, 0)]
        found = []
        for index in order:
            generator.shuffle(directions)
            for direction in directions:
                end = candidates[index]
                way = end + numpy.outer(numpy.arange(0, deep + free), direction)
                if (way < 1).any() or (way >= numpy.array(self.labels.shape) - 1).any():
                    continue
                passed = self.labels[tuple(way.T)]
                # inside to its own surface, and beside where the tip ends
                beside = [self.labels[tuple(end + side)] for side in numpy.vstack([numpy.eye(3, dtype=int), -numpy.eye(3, dtype=int)])]
                if (passed[:deep] == label).all() and (passed[deep:] == 0).all() and all(b == label for b in beside):
                    place = lambda v: (self.patient_from_voxel[:3, :3] @ v + self.patient_from_voxel[:3, 3]).tolist()  # noqa: E731
                    found.append((place(way[-1]), place(end)))
                    break
            if len(found) == count:
                return found
        return found

    def take_hand(self):
        """A second viewer takes the hand; `lead` then leads it. This page has it when it opens, and lets go with another tool."""
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
              socket.send(JSON.stringify({ type: "hello", protocol: 1, poses_hz: 1 }));
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

    def press_on(self, label, start, end):
        """Comes to a place in free space without minding what is on the way, and presses from there."""
        self.choose_method("trilinear")  # which holds no proxy back behind what lies between
        self.lead([start])
        self.choose_method("proxy")
        self.lead([start, end])
        self.page.wait(f"palpateViewer.pose.devices[0].label === {label}")

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
            if structures == STRUCTURES or structure["tissue"] < 0 or not self.scene["tissues"][structure["tissue"]]["felt"]:
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

    def test_slider_changes_the_stiffness_that_the_loop_reports(self):
        felt = self.touch_something()
        slider = f"input[data-tissue='{felt['tissue']}']"
        before = self.page.run("return palpateViewer.pose.devices[0].stiffness")
        self.assertGreater(before, 0)
        # the slider goes from 0.01 to 10 N/mm by ratios
        for place, stiffness in ((0.4, 0.158), (0.25, 0.0562)):
            self.slide(slider, place)
            self.page.wait(f"Math.abs(palpateViewer.pose.devices[0].stiffness - {stiffness}) < 0.001")
            self.assertEqual(self.page.run(f"return palpateViewer.state.tissues[{felt['tissue']}].stiffness_N_per_mm"), stiffness)

    def test_dragging_reaches_the_loop_as_a_rotation(self):
        self.page.click("[data-look=anterior]")
        self.page.click("#turn")
        self.drag("#picture-volume .stack", 100, 0)
        # 0.8 rad about the picture's vertical, which is World's y; felt as the loop interpolates it
        self.page.wait("Math.abs(palpateViewer.pose.rotation[2] - Math.sin(0.4)) < 0.005 && "
                       "Math.abs(palpateViewer.pose.rotation[0] - Math.cos(0.4)) < 0.005", 10)

    def test_the_mouse_moves_the_tip(self):
        self.page.wait("palpateViewer.state.pointer")
        self.page.wait("document.querySelector('[data-tool=touch]').getAttribute('aria-checked') === 'true'")
        left, top, width, height = self.box("#picture-oblique .stack")
        x, y = round(left + 0.5 * width), round(top + 0.45 * height)
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

    def test_space_only_stops_and_whoever_has_a_free_hand_rearms(self):
        felt = self.touch_something()
        free = self.approaches(felt["label"], 1, random.Random(1))[0][0]
        self.page.press(" ")
        self.page.wait("palpateViewer.state.emergency_stop && (palpateViewer.pose.devices[0].flags & 8192) !== 0")
        first = self.page.run("return palpateViewer.state.stop")
        self.page.press(" ")
        self.page.wait(f"palpateViewer.state.stop > {first}")
        self.assertTrue(self.page.run("return palpateViewer.state.emergency_stop"))
        # the other has the hand, and is refused by name of another stop, and as long as it touches something
        self.page.wait("document.getElementById('flags').textContent.includes('whoever moves the tip rearms')")
        self.assertTrue(self.page.run("return document.getElementById('rearm').disabled"))
        for answer, stop, words in ((2, "%d" % first, "another stop"), (3, "palpateViewer.state.stop", "touches something")):
            self.page.run("window.hand.ask({ type: 'rearm', id: %d, stop: %s })" % (answer, stop))
            self.page.wait(f"window.hand.answers[{answer}]")
            told = self.page.run(f"return window.hand.answers[{answer}]")
            self.assertEqual(told["type"], "refused", told)
            self.assertIn(words, told["what"])
        # this page takes the hand again, from where it is free
        self.lead([free])
        self.page.run("window.hand.letGo()")
        self.page.wait("!document.querySelector('[data-tool=touch]').disabled")
        time.sleep(0.3)
        self.page.click("[data-tool=touch]")
        self.page.wait("palpateViewer.state.pointer && !document.getElementById('rearm').disabled")
        self.page.click("#rearm")
        self.page.wait("!palpateViewer.state.emergency_stop")

    def test_pause_and_switches_reach_the_loop(self):
        for control, on in (("pause", 4), ("friction", 1), ("viscosity", 2), ("passivity", 16)):
            before = self.page.run(f"return palpateViewer.pose.switches & {on}")
            self.page.click("#" + control)
            self.page.wait(f"(palpateViewer.pose.switches & {on}) !== {before}")
            self.page.click("#" + control)
            self.page.wait(f"(palpateViewer.pose.switches & {on}) === {before}")

    def test_planes_hang_as_in_radiology_and_meet_at_the_cross_hair(self):
        self.page.click("[data-layout=five]")
        self.page.wait("document.querySelector('#picture-axial canvas').width > 50")
        left, posterior, inferior = [1, 0, 0], [0, 1, 0], [0, 0, -1]
        for kind, right, down in (("axial", left, posterior), ("sagittal", posterior, inferior), ("coronal", left, inferior)):
            plane = self.page.run("return palpateViewer.plane(arguments[0])", kind)
            self.assertEqual([plane["right"], plane["down"]], [right, down])
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

    def test_recording_is_a_video_and_its_poses(self):
        with tempfile.TemporaryDirectory(prefix="palpate-download-") as folder:
            self.page.developer_tools("Browser.setDownloadBehavior", behavior="allow", downloadPath=folder)
            self.page.click("#record")
            time.sleep(4)
            self.page.click("#record")
            deadline = time.monotonic() + 120
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

    def setUp(self):
        self.server = Server("script").__enter__()
        self.addCleanup(self.server.__exit__)
        # before that, or it misses its server and says so in the next test
        self.addCleanup(self.page.post, "/url", {"url": "about:blank"})
        super().setUp()

    @classmethod
    def setUpClass(cls):
        cls.open_browser()

    def test_tip_moves_with_the_hand_and_the_section_follows(self):
        places = []
        for _ in range(16):
            time.sleep(0.4)
            if places:
                self.page.wait(f"palpateViewer.pose.sequence > {places[-1][0]}")
            sample = self.page.run("palpateViewer.draw(); const tip = palpateViewer.pose.devices[0].tip;"
                                   "return [palpateViewer.pose.sequence, ...tip, palpateViewer.pixelOf('oblique', tip).off_mm]")
            places.append(sample)
            self.assertLess(sample[4], 0.05)
        self.assertTrue(all(a[0] < b[0] for a, b in zip(places, places[1:])))
        self.assertGreater(numpy.ptp(numpy.array(places)[:, 1:4], axis=0).max(), 2)

    def test_old_data_is_grey_and_a_new_server_is_found(self):
        self.server.process.send_signal(signal.SIGSTOP)
        self.page.wait("!palpateViewer.isFresh && document.body.classList.contains('stale')")
        self.assertGreater(self.page.run("return palpateViewer.age_ms"), 250)
        self.assertIn("old", self.page.run("return document.getElementById('link-text').textContent"))
        self.server.process.send_signal(signal.SIGCONT)
        self.page.wait("palpateViewer.isFresh && !document.body.classList.contains('stale')")

        self.server.process.kill()
        self.server.process.wait()
        self.page.wait("palpateViewer.link !== 'connected'")
        self.expected = ("ERR_CONNECTION_REFUSED", "ERR_CONNECTION_RESET", "ERR_EMPTY_RESPONSE", "WebSocket connection to")
        time.sleep(1)
        self.server.__enter__()
        self.page.wait(LOADED, 60)
        self.page.wait("palpateViewer.link === 'connected' && palpateViewer.age_ms < 250")


class WithDevice(Viewer):
    """A physical device, of which somebody agrees to everything after a while: the mock's alone, for palpate drives none yet."""

    def setUp(self):
        self.server = Server("device").__enter__()
        self.addCleanup(self.server.__exit__)
        self.expected = ()
        self.open_page()

    @classmethod
    def setUpClass(cls):
        cls.open_browser()

    def text(self, name):
        return self.page.run("return document.getElementById(arguments[0]).textContent", name)

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
        self.page.wait("document.getElementById('toast').textContent.startsWith('Asked at the device')")
        self.assertEqual(self.page.run("return palpateViewer.state.rotation_wxyz"), [1, 0, 0, 0], "nobody has agreed yet")
        self.page.wait("palpateViewer.state.rotation_wxyz[0] < 0.99")
        self.assertEqual(self.page.run("return window.asked.length"), 1)

    def test_it_is_stopped_from_here_and_armed_there(self):
        self.page.wait("palpateViewer.state.armed")
        self.page.press(" ")
        self.page.wait("palpateViewer.state.emergency_stop && !palpateViewer.state.armed")
        self.page.wait("document.getElementById('flags').textContent.includes('armed again where palpate runs')")
        self.assertTrue(self.page.run("return document.getElementById('rearm').disabled"))
        self.assertEqual(self.text("stop"), "Stopped")


class WithTokens(Viewer):
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
        self.show("wrong-token-wrong-token")
        self.page.wait("document.querySelector('#token-dialog').open && !document.getElementById('token-problem').hidden")
        self.show(self.CONTROL)
        self.page.wait(LOADED, 60)
        self.assertEqual(self.page.run("return palpateViewer.role"), "control")
        addresses = self.page.run("return [location.href, ...performance.getEntriesByType('resource').map((entry) => entry.name)]")
        self.assertFalse([address for address in addresses if "token" in address])
        # kept for this tab
        self.open_page()

    def test_a_viewer_without_control_looks_and_can_stop(self):
        self.show(self.VIEW)
        self.page.wait(LOADED, 60)
        self.assertEqual(self.page.run("return palpateViewer.role"), "view")
        self.assertTrue(self.page.run("return ['method', 'limit', 'pause', 'friction'].every((id) => document.getElementById(id).disabled)"))
        self.assertTrue(self.page.run("return [...document.querySelectorAll('[data-tissue]')].every((slider) => slider.disabled)"))
        self.page.click("#stop")
        self.page.wait("palpateViewer.state.emergency_stop")


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


if __name__ == "__main__":
    if len(sys.argv) >= 3 and sys.argv[1] == "palpate":
        command = palpate_command(sys.argv[2])
        del sys.argv[1:3], WithDevice
    elif len(sys.argv) >= 5 and sys.argv[1] == "mock":
        command = mock_command(*sys.argv[2:5])
        del sys.argv[1:5]
    else:
        sys.exit(__doc__)
    lack = browser.missing()
    try:
        import numpy
    except ImportError:
        lack = "python3-numpy is not installed"
    if lack:
        print("skipped: " + lack)
        sys.exit(1 if os.environ.get("CI") == "true" else 77)
    unittest.main(verbosity=2)
