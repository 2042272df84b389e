"""The session around the viewer page: faults of the server, missing files, loading, recordings, no-go regions, plans and tokens.

usage: session_test.py [--campaigns] palpate PALPATE [TEST ...]
       session_test.py [--campaigns] mock NODE MOCK_SERVER PAGE_FOLDER [TEST ...]

viewer_test.py explains the arguments and runs these tests with those of the other scripts in one browser.
"""

import json
import math
import os
import subprocess
import sys
import tempfile
import time

sys.dont_write_bytecode = True  # nothing is left in the source tree
import viewer_page  # noqa: E402
from viewer_page import LOADED, SIZE, Server, Viewer, campaign, numpy, simulated  # noqa: E402


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


class WithFaultyServer(Viewer):
    """The mock server with faults: errors that do not resolve by themselves are shown, and retried on request."""

    uses_mock = True
    limits_frame_rate = False

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


class WithMissingFiles(Viewer):
    """The mock server without some of the page's files."""

    uses_mock = True
    limits_frame_rate = False
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

    uses_mock = True
    limits_frame_rate = False

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


class WithNoGoRegions(Viewer):
    """palpate itself with no-go regions: a ball before the knee, the patella, a plane; and distances of all structures. Then what was recorded of it."""

    BALL_MM, BALL_AWAY_MM, PATELLA_AWAY_MM = 6, 2, 4

    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory(prefix="palpate-kept-away-")
        cls.addClassCleanup(folder.cleanup)
        cls.program, knee = viewer_page.program, os.path.join(folder.name, "knee")
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
        self.assertEqual(self.accessibility_violations(), [])
        self.page.resize(390, 844)
        self.addCleanup(self.page.resize, *SIZE)
        self.page.wait("innerWidth <= 390")
        self.page.dark(False)
        self.assertEqual(self.accessibility_violations(), [])
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
        cls.program, knee = viewer_page.program, os.path.join(folder.name, "knee")
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
        self.assertEqual(self.accessibility_violations(), [])
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
        self.assertEqual(self.accessibility_violations(), [])
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
    limits_frame_rate = False

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


if __name__ == "__main__":
    viewer_page.main(sys.argv[1:], sys.modules["__main__"])
