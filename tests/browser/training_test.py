"""Does tasks in the viewer page in headless Chromium, as a trainee would: by mouse, by keys alone and by finger.

usage: training_test.py PALPATE [TEST ...]

Exit code 77 (a skip) where there is no browser, except in CI, where that is a failure.
"""

import json
import math
import os
import subprocess
import sys
import tempfile
import time

sys.dont_write_bytecode = True  # nothing is left in the source tree
import browser  # noqa: E402
import viewer_page  # noqa: E402

TASK = """title = "Press the kneecap"
briefing = "Press gently."
end = "recording"
in_a_row = 1
[[region]]
name = "kneecap"
structures = ["patella"]
[[step]]
name = "press"
region = "kneecap"
force = [0.15, 20]
seconds = 0.3
[[step]]
name = "stroke"
region = "kneecap"
kind = "cover"
coverage = 0.0005
[[force]]
structures = ["patella"]
band = [0.15, 1.0]
limit = 1.2
[[protected]]
structures = ["tibia"]
[[metric]]
name = "steps_done"
at_least = 1
[[metric]]
name = "peak_force"
at_most = 20
basis = "test"
[[metric]]
name = "path_length"
[[metric]]
name = "coverage"
[[metric]]
name = "smoothness"
"""
TRAINING = "palpateViewer.training"
TAB, ENTER, ARROW_LEFT, ARROW_UP, ARROW_RIGHT, ARROW_DOWN = "\ue004", "\ue007", "\ue012", "\ue013", "\ue014", "\ue015"
TOUCHES, IS_DONE = f"{TRAINING}.run.forces_N[0] > 0.3", f"{TRAINING}.run.done.every((done) => done)"


class Trainee(viewer_page.Viewer):
    """A session with a task, recorded, whose runs are kept; what the page said of each is what `palpate` says afterwards."""

    scene_name = "knee-phantom:spacing=1.2"

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory(prefix="palpate-training-")
        cls.addClassCleanup(cls.folder.cleanup)
        cls.serve_in(cls.folder.name)
        cls.open_browser(own=True)

    @classmethod
    def serve_in(cls, folder):
        cls.file = os.path.join(folder, "press.toml")
        with open(cls.file, "w", encoding="utf-8") as out:
            out.write(TASK)
        cls.recording, cls.records = os.path.join(folder, "run.h5"), os.path.join(folder, "records.db")
        cls.server = viewer_page.Server("pointer")
        cls.server.command = lambda: [viewer_page.program, "explore", cls.scene_name, "--port", str(cls.server.port), "--device", "pointer",
                                      "--seconds", "600", "--rate", "1000", *cls.options()]
        cls.server.__enter__()
        cls.addClassCleanup(cls.server.__exit__)

    @classmethod
    def options(cls):
        return ["--task", cls.file, "--learner", "L042", "--records", cls.records, "-o", cls.recording]

    def setUp(self):
        super().setUp()
        self.page.wait("palpateViewer.state.pointer && document.getElementById('training').hidden === false")

    def text(self, selector):
        return self.page.run("return document.querySelector(arguments[0]).innerText", selector)

    def view(self):
        return self.page.run(f"return {TRAINING}.view")

    def middle_of(self, name):
        """A place in a structure, patient, mm."""
        scene = self.server.scene()
        labels, patient_from_voxel = self.server.labels(scene)
        label = next(s["label"] for s in scene["structures"] if s["name"] == name)
        voxel = viewer_page.numpy.argwhere(labels == label).mean(0)
        return (patient_from_voxel[:3, :3] @ voxel + patient_from_voxel[:3, 3]).tolist()

    def way_into(self, name):
        """Two viewport positions in the oblique section: free space, and directly below it a point 1.4 mm inside a
        structure. The structure must be in the plane."""
        script = """palpateViewer.draw();
            const canvas = document.querySelector('#picture-oblique canvas');
            const places = palpateViewer.scene.structures.findIndex((s) => s.name === arguments[0]);
            for (let y = 6; y < canvas.height - 6; y += 2) for (let x = 6; x < canvas.width - 30; x += 2) {
              const is = (dx, dy) => palpateViewer.structureAt(palpateViewer.patientAt('oblique', x + dx, y + dy));
              const mm = Math.hypot(...palpateViewer.patientAt('oblique', 1, 0).map((v, i) => v - palpateViewer.patientAt('oblique', 0, 0)[i]));
              const deep = 1.4 / mm;
              if (is(0, 0) === places && is(0, -2 * deep) === null && is(0, -5 * deep) === null) return [x, y, y - 2 * deep, canvas.clientWidth / canvas.width];
            }
            return null"""
        found = self.page.run(script, name)
        self.assertIsNotNone(found, "the section shows nothing of " + name)
        x, y, above, scale = found
        left, top, _, _ = self.box("#picture-oblique .stack")
        return (round(left + x * scale), round(top + above * scale)), (round(left + x * scale), round(top + y * scale))

    def bring_section_to(self, name):
        """The tip is left at the structure's surface, through which the section then goes."""
        self.page.run("document.querySelector('[data-look=anterior]').click(); palpateViewer.draw()")
        middle = self.middle_of(name)
        left, top, width, height = self.box("#picture-volume .stack")
        x, y = self.page.run("return palpateViewer.project(arguments[0])", middle)
        x, y = round(left + width / 2 + x), round(top + height / 2 + y)
        self.page.pointer({"type": "pointerMove", "x": x, "y": y}, {"type": "pointerDown", "button": 0}, {"type": "pause", "duration": 900}, {"type": "pointerUp", "button": 0})
        self.page.wait("(palpateViewer.pose.devices[0].flags & 512) !== 0")
        # the section glides after it
        self.page.run("for (let n = 0; n < 40; n++) palpateViewer.draw()")

    def is_soon(self, expression, seconds):
        """The page is told of it after it happened: a slow machine's later."""
        deadline = time.monotonic() + seconds
        while not (is_so := self.page.run("return " + expression)) and time.monotonic() < deadline:
            time.sleep(0.02)
        return is_so

    def is_swept(self, move, until):
        """Runs along for some pixels to both sides, as a step that covers a surface needs it."""
        for dx in (*range(0, 12, 2), *range(10, -12, -2), *range(-10, 1, 2)):
            move(dx)
            if self.is_soon(until, 0.1):
                return True
        return self.is_soon(until, 3)

    def press_into(self, name, press, move, release, until):
        """Presses into a structure from outside and slides along it until the expression `until` is true; the contact
        is kept.

        The section glides, and shows the structure elsewhere by the time of the press; and on a machine that stands still for a while contact
        begins anew, in which nothing is felt before the tip has been outside.
        """
        for _ in range(8):
            self.page.run("for (let n = 0; n < 40; n++) palpateViewer.draw()")
            above, inside = self.way_into(name)
            press(above)
            time.sleep(0.3)
            move(inside)
            if self.is_soon(TOUCHES, 6) and self.is_swept(lambda dx, at=inside: move((at[0] + dx, at[1])), until):
                return inside
            release()
            time.sleep(0.3)
        self.fail(f"never became true: {until}; {self.page.run('return palpateViewer.pose.devices[0]')}")

    def mouse_down(self, at):
        self.mouse_move(at)
        self.page.pointer({"type": "pointerDown", "button": 0})

    def mouse_move(self, at):
        self.page.pointer({"type": "pointerMove", "x": at[0], "y": at[1]})

    def mouse_up(self):
        self.page.pointer({"type": "pointerUp", "button": 0})

    def press_by_keys(self, until):
        """The tip lies at the surface: down into it a pixel or two at a time, and up again where contact began anew (above)."""
        for _ in range(4):
            for _ in range(60):
                self.key("keyDown", ARROW_DOWN)
                if self.is_soon(f"{TRAINING}.run.forces_N[0] > 0.25", 0.1):
                    break
                self.key("keyUp", ARROW_DOWN)
            for key in (*[ARROW_RIGHT] * 20, *[ARROW_LEFT] * 40):
                if is_so := self.is_soon(until, 0.15):
                    break
                self.key("keyDown", key)
                self.key("keyUp", key)
            is_so = is_so or self.is_soon(until, 3)
            self.key("keyUp", ARROW_DOWN)
            if is_so:
                return
            for _ in range(60):
                self.key("keyDown", ARROW_UP)
                time.sleep(0.03)
                self.key("keyUp", ARROW_UP)
        self.fail("never became true: " + until)

    def key(self, kind, value):
        self.page.post("/actions", {"actions": [{"type": "key", "id": "keys", "actions": [{"type": kind, "value": value}]}]})

    def expect_debriefed(self, number):
        self.page.wait(f"{TRAINING}.view === 'debriefing'")
        told = self.page.run(f"return {TRAINING}.debriefing")
        self.assertEqual(told["kept"], number)
        self.assertTrue(told["in_band"], told)
        self.assertIn("Every counted metric in its band", self.text("#verdict"))
        self.assertEqual(self.text("#improve"), "", "nothing is to be improved")
        rows = self.page.run("return [...document.querySelectorAll('#figures tbody tr')].map((row) => [...row.cells].map((cell) => cell.innerText))")
        self.assertEqual(len(rows), 5)
        self.assertEqual(rows[0][0], "Steps completed")
        self.assertIn("100 %", rows[0][1])
        self.assertIn("not validated", rows[0][2])
        self.assertIn("not counted", rows[2][2])
        self.assertGreater(len(told["samples"]), 20)
        self.assertTrue(any(patch[3] for patch in told["patches"]) and not all(patch[3] for patch in told["patches"]))
        return told

    def score(self, told):
        """As palpate has it of the recording."""
        scored = subprocess.run([viewer_page.program, "-q", "task", "score", self.recording, "--task", self.file, "--json", "--from-tick", str(told["first_tick"]),
                                 "--to-tick", str(told["last_tick"])], stdout=subprocess.PIPE, check=False)
        return json.loads(scored.stdout)["runs"][0]

    def kept(self):
        listed = subprocess.run([viewer_page.program, "-q", "records", "list", "--records", self.records, "--json"], stdout=subprocess.PIPE, check=True)
        return [json.loads(line) for line in listed.stdout.splitlines()]


class WholeTask(Trainee):
    def test_a_whole_task_by_mouse_by_keys_and_by_finger(self):
        self.check_briefing()
        by_mouse = self.run_by_mouse()
        by_keys = self.run_by_keys()
        self.assertEqual(by_keys["metrics"][1]["best"], by_mouse["metrics"][1]["value"])
        by_finger = self.run_by_finger()
        self.check_german_and_narrow_screen()
        self.check_recording_and_records(by_mouse, by_keys, by_finger)

    def check_briefing(self):
        self.assertEqual(self.view(), "briefing")
        self.assertEqual(self.text("#task-title"), "Press the kneecap")
        for words in ("Do not touch: tibia", "0.150 N to 1.00 N", "Pass: 1 runs in a row"):
            self.assertIn(words, self.text("#training"))
        self.assertIn("Runs are saved in the learner's records", self.text("#task-note"))
        for is_dark in (True, False):
            self.page.dark(is_dark)
            self.assertEqual(self.accessibility_violations(), [])
        self.page.dark(True)

    def run_by_mouse(self):
        """The first run; presses too hard in the end. @returns its debriefing"""
        self.page.hear()
        self.bring_section_to("patella")
        self.page.click("#task-begin")
        self.page.wait(f"{TRAINING}.view === 'running'")
        self.assertEqual(self.page.run("return document.activeElement.id"), "task-end")
        self.assertEqual(self.accessibility_violations(), [])
        self.assertEqual(self.text("#task-warning"), "")
        self.slide("#press", 0.6)
        at = self.press_into("patella", self.mouse_down, self.mouse_move, self.mouse_up, IS_DONE)
        self.assertEqual(self.page.run("return [...document.querySelectorAll('#task-steps li')].map((step) => step.dataset.state)"), ["done", "done"])
        said = self.text("#task-forces")
        self.assertIn("patella", said)
        self.assertRegex(said, r"[0-9.]+ N · (in band|too high|above the limit)")
        # harder, until it is too much; what is below the warning stays where it was
        self.slide("#press", 1.6)
        self.page.wait("document.getElementById('task-warning').innerText.includes('patella')", 20)
        moved = self.page.run("""const warning = document.getElementById('task-warning'), end = document.getElementById('task-end');
            const top = end.getBoundingClientRect().top, told = warning.textContent;
            warning.textContent = '';
            const moved = end.getBoundingClientRect().top - top;
            warning.textContent = told;
            return moved""")
        self.assertEqual(moved, 0)
        self.mouse_up()
        self.page.click("#task-end")
        debriefing = self.expect_debriefed(1)
        self.page.wait("window.heard.some((text) => text.includes(document.getElementById('verdict').textContent))")
        self.assertEqual(self.page.run("return document.activeElement.id"), "task-title")
        for is_dark in (True, False):
            self.page.dark(is_dark)
            self.assertEqual(self.accessibility_violations(), [])
        self.page.dark(True)
        return debriefing

    def run_by_keys(self):
        """The second run, by keys alone: to the button, into the section, to the tip and back. @returns its debriefing"""
        self.page.run("document.querySelector('#picture-oblique .stack').focus()")
        self.page.press("b")
        self.page.wait(f"{TRAINING}.view === 'running' && {TRAINING}.run.run === 2")
        self.assertTrue(self.page.run("return document.activeElement === document.querySelector('#picture-oblique .stack')"), "the focus stays where it is")
        self.press_by_keys(TOUCHES)
        self.press_into("patella", self.mouse_down, self.mouse_move, self.mouse_up, IS_DONE)
        self.mouse_up()
        # the button is found by the tab key
        self.page.run("document.getElementById('language').focus()")
        for _ in range(60):
            if self.page.run("return document.activeElement.id") == "task-end":
                break
            self.page.press(TAB)
        self.page.press(ENTER)
        return self.expect_debriefed(2)

    def run_by_finger(self):
        """The third run. @returns its debriefing"""
        self.touch("Start", self.middle_of_element("#task-again"))
        self.touch("End")
        self.page.wait(f"{TRAINING}.view === 'running' && {TRAINING}.run.run === 3")
        self.slide("#press", 0.6)
        self.press_into("patella", lambda at: self.touch("Start", at), lambda at: self.touch("Move", at), lambda: self.touch("End"), IS_DONE)
        self.touch("End")
        self.touch("Start", self.middle_of_element("#task-end"))
        self.touch("End")
        by_finger = self.expect_debriefed(3)
        self.assertEqual([by_finger["runs"], by_finger["in_a_row"]], [3, 3])
        return by_finger

    def check_german_and_narrow_screen(self):
        viewer_page.speak(self.page, "de")
        for words in ("Wiederholen", "Alle gezählten Werte im Sollbereich", "Maximalkraft", "nicht validiert", "Erledigt: press"):
            self.assertIn(words, self.text("#training"))
        self.page.resize(390, 844)
        self.page.wait("innerWidth <= 390")
        self.assertEqual(self.accessibility_violations(), [])
        self.page.resize(*viewer_page.SIZE)
        self.page.click("#task-other")
        self.page.wait(f"{TRAINING}.view === 'briefing'")
        self.assertIn("Nicht berühren: tibia", self.text("#training"))

    def check_recording_and_records(self, by_mouse, by_keys, by_finger):
        """Compares the debriefings with palpate's scores of the recording, bit for bit, and with the records."""
        self.page.post("/url", {"url": "about:blank"})
        self.server.__exit__()
        for told in (by_mouse, by_keys, by_finger):
            scored = self.score(told)
            self.assertEqual([metric["value"] for metric in scored["metrics"]], [metric["value"] for metric in told["metrics"]])
            self.assertEqual(scored["ticks"], told["ticks"])
            self.assertEqual([(event["kind"], event["force_N"]) for event in scored["events"]][:500], [(event["kind"], event["force_N"]) for event in told["events"]])
        self.assertEqual([run["learner"] for run in self.kept()], ["L042"] * 3)
        # scored once more it is the same run
        again = [viewer_page.program, "-q", "task", "score", self.recording, "--task", self.file, "--record", "L042", "--records", self.records,
                 "--from-tick", str(by_keys["first_tick"]), "--to-tick", str(by_keys["last_tick"])]
        subprocess.run(again, stdout=subprocess.DEVNULL, check=True)
        self.assertEqual(len(self.kept()), 3)

    def middle_of_element(self, selector):
        self.page.run("document.querySelector(arguments[0]).scrollIntoView({ block: 'center' })", selector)
        left, top, width, height = self.box(selector)
        return round(left + width / 2), round(top + height / 2)

    def touch(self, kind, *points):
        self.page.developer_tools("Input.dispatchTouchEvent", type="touch" + kind, touchPoints=[{"x": x, "y": y, "id": n} for n, (x, y) in enumerate(points)])


class Quiz(Trainee):
    """A quiz whose nodule must not be visible in the page."""

    scene_name = "palpation-block:seed=3,diameter=9,depth=4,stiffness=15"

    @classmethod
    def options(cls):
        return ["--task", "find-the-nodule"]

    def everything_said(self):
        return self.page.run("""const said = (of) => [...of.querySelectorAll('*')].filter((one) => one.checkVisibility()).flatMap((one) => [one.title, one.ariaLabel, one.placeholder, one.value])
              .concat(of.innerText).join(' | ');
            palpateViewer.draw();
            return said(document.body)""")

    def test_nothing_tells_where_it_is_before_the_run_is_over(self):
        scene = self.server.scene()
        nodule = next(n for n, s in enumerate(scene["structures"]) if s["name"] == "nodule")
        soft = next(n for n, s in enumerate(scene["structures"]) if s["name"] == "soft_tissue")
        middle = self.middle_of("nodule")
        at = "palpateViewer.structureAt(arguments[0])"
        self.page.wait("document.body.classList.contains('quiz')")
        self.page.wait(f"(() => palpateViewer.structureAt({json.dumps(middle)}) === {soft})()")
        self.assertNotIn("nodule", self.everything_said().lower().replace("find the nodule", "").replace("a nodule lies somewhere", ""))
        self.assertNotIn("soft tissue", self.everything_said())
        self.assertEqual(self.accessibility_violations(), [])
        self.page.click("#task-begin")
        self.page.wait(f"{TRAINING}.view === 'running'")
        self.assertNotIn("soft tissue", self.everything_said())
        self.page.click("#task-end")
        self.page.wait(f"{TRAINING}.view === 'debriefing'", 60)
        told = self.page.run(f"return {TRAINING}.debriefing")
        self.assertIsNone(told["answer_mm"])
        self.assertIsNone(told["metrics"][0]["value"])
        self.assertLess(math.dist(told["to_find_mm"], middle), 1)
        # it is seen again, by its name
        self.page.wait(f"(() => palpateViewer.structureAt({json.dumps(middle)}) === {nodule})()")
        self.assertEqual(self.page.run("return " + at, middle), nodule)
        self.assertIn("nodule", self.page.run("document.querySelectorAll('details').forEach((card) => (card.open = true)); return document.getElementById('structures').innerText"))
        self.assertEqual(self.accessibility_violations(), [])
        # once more: it is hidden again
        self.page.click("#task-again")
        self.page.wait(f"{TRAINING}.view === 'running'")
        self.page.wait(f"(() => palpateViewer.structureAt({json.dumps(middle)}) === {soft})()")
        self.page.click("#task-end")
        self.page.wait(f"{TRAINING}.view === 'debriefing'")


class Lesson(Trainee):
    """The same block, before a learner and a teacher with tokens: what is theirs, and nothing else."""

    scene_name = Quiz.scene_name
    LEARNER, OTHER, TEACHER = "learner-token-0123456789", "another-token-0123456789", "teacher-token-0123456789"

    @classmethod
    def options(cls):
        tokens = os.path.join(cls.folder.name, "tokens")
        with open(os.open(tokens, os.O_WRONLY | os.O_CREAT, 0o600), "w", encoding="utf-8") as file:
            file.write(f"learner {cls.LEARNER} L042\nlearner {cls.OTHER} L007\nteacher {cls.TEACHER}\n")
        return ["--task", "find-the-nodule", "--records", cls.records, "--token-file", tokens]

    def setUp(self):
        self.expected = ("401",)

    def come(self, token):
        # the page keeps a token as long as its tab is open
        self.page.run("try { sessionStorage.clear(); } catch { /* the browser's first page has none */ }")
        self.open_page(wait="document.querySelector('#token-dialog').open")
        self.page.run("document.getElementById('token').value = arguments[0]", token)
        self.page.click("#token-form button")
        self.page.wait(viewer_page.LOADED)

    def is_shown(self, *ids):
        return [self.page.run("return document.getElementById(arguments[0]).checkVisibility()", one) for one in ids]

    def test_each_sees_and_does_what_is_theirs(self):
        self.come(self.LEARNER)
        self.page.wait("palpateViewer.state.lesson.redacted && document.getElementById('training').hidden === false")
        self.assertEqual(self.text("#who"), "Learner L042")
        self.assertEqual(self.is_shown("lesson", "curves-show", "lesson-led", "lesson-learner", "method", "limit", "pause"), [True, True, False, False, False, False, True])
        # no name and no place of it has come to this page
        names = [structure["name"] for structure in self.page.run("return palpateViewer.scene.structures")]
        self.assertNotIn("nodule", names)
        self.assertNotIn("soft_tissue", names)
        whole = json.loads(self.server.get("api/scene", self.TEACHER))
        labels = viewer_page.numpy.frombuffer(self.server.get("api/volume/labels/" + whole["volume"]["hash"], self.TEACHER), whole["volume"]["labels"]["type"])
        nodule = next(s["label"] for s in whole["structures"] if s["name"] == "nodule")
        affine = viewer_page.numpy.array(whole["volume"]["patient_from_voxel"])
        voxel = viewer_page.numpy.argwhere(labels.reshape(whole["volume"]["dims"][::-1]).transpose(2, 1, 0) == nodule).mean(0)
        middle = (affine[:3, :3] @ voxel + affine[:3, 3]).tolist()
        at = f"palpateViewer.structureAt({json.dumps(middle)})"
        place = next(n for n, s in enumerate(whole["structures"]) if s["name"] == "nodule")
        self.assertNotEqual(self.page.run("return " + at), place)
        self.assertEqual(self.accessibility_violations(), [])
        # a run is kept as his or hers, and so are the curves
        self.page.click("#task-begin")
        self.page.wait(f"{TRAINING}.view === 'running'")
        self.assertIn("saved in the learner's records", self.text("#task-note"))
        time.sleep(0.3)
        self.page.click("#task-end")
        self.page.wait(f"{TRAINING}.view === 'debriefing' && {TRAINING}.debriefing.kept === 1", 60)
        self.page.click("#curves-show")
        self.page.wait("!document.getElementById('curves').hidden")
        curves = "document.getElementById('curves-page').shadowRoot"
        self.assertIn("L042", self.page.run(f"return {curves}.querySelector('.task').innerText"))
        self.assertEqual(self.page.run(f"return getComputedStyle({curves}.querySelector('.curves')).display"), "grid", "in its own style")
        stop = self.page.run("""const { left, top, width, height } = document.getElementById("stop").getBoundingClientRect();
            return document.elementFromPoint(left + width / 2, top + height / 2).id""")
        self.assertEqual(stop, "stop", "nothing lies over the emergency stop")
        self.assertEqual(self.accessibility_violations(), [])
        self.page.press("\ue00c")
        self.assertEqual(self.is_shown("curves"), [False])

        # who teaches sees what is to be found, chooses whose the runs are and begins them without the hand
        self.come(self.TEACHER)
        self.page.wait("document.getElementById('training').hidden === false && palpateViewer.state.lesson.redacted === false")
        self.assertEqual(self.text("#who"), "Teacher")
        self.assertEqual(self.is_shown("lesson", "curves-show", "lesson-led", "method"), [True, True, True, True])
        self.page.wait(f"{at} === {place}")
        self.assertEqual(self.accessibility_violations(), [])
        self.assertEqual(self.is_shown("lesson-learners", "lesson-learner"), [True, False], "learners with a token are listed")
        self.page.click("#lesson-learners [data-learner='L007']")
        self.page.wait("palpateViewer.state.lesson.learner === 'L007'")
        self.assertIn("L007", self.text("#lesson-note"))
        self.page.click("#lesson-names")
        self.page.wait("palpateViewer.state.lesson.names")
        # the learner sees it now, and that it is another's turn
        self.come(self.LEARNER)
        self.page.wait("palpateViewer.state.lesson.of_another")
        self.assertIn("nodule", [structure["name"] for structure in self.page.run("return palpateViewer.scene.structures")])
        self.page.wait(f"{at} === {place}")
        self.assertTrue(self.page.run("return document.getElementById('task-begin').disabled || document.getElementById('task-begin').hidden"))
        self.assertIn("Another learner's turn", self.text("#lesson-note"))


class Played(viewer_page.Viewer):
    """A recording that is looked at as a run of a task: the card shows what was done by the place that is shown."""

    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory(prefix="palpate-played-")
        cls.addClassCleanup(folder.cleanup)
        cls.program, cls.recording = viewer_page.simulated(folder.name)
        cls.file = os.path.join(folder.name, "press.toml")
        with open(cls.file, "w", encoding="utf-8") as out:
            out.write(TASK)
        cls.server = viewer_page.Server("recording")
        cls.server.command = lambda: [cls.program, "replay", cls.recording, "--view", "--task", cls.file, "--port", str(cls.server.port)]
        cls.server.__enter__()
        cls.addClassCleanup(cls.server.__exit__)
        cls.scene = cls.server.scene()
        cls.open_browser()

    def go(self, part):
        """To a part of the recording's time."""
        recording = self.scene["recording"]
        at_s = recording["begin_s"] + part * (recording["end_s"] - recording["begin_s"])
        self.page.run("const place = document.getElementById('place'); place.value = arguments[0];"
                      "place.dispatchEvent(new Event('input', { bubbles: true }))", at_s)

    def test_its_card_follows_the_time_line(self):
        self.page.wait(f"{TRAINING}.view === 'running'")
        buttons = "['task-begin', 'task-end', 'task-again', 'task-other'].map((id) => document.getElementById(id).hidden)"
        self.assertEqual(self.page.run(f"return {buttons}"), [True] * 4)
        text = lambda selector: self.page.run("return document.querySelector(arguments[0]).innerText", selector)  # noqa: E731
        self.assertIn("Recording", text("#task-note"))
        self.assertEqual(self.page.run(f"return {TRAINING}.run.done"), [False, False])
        # after its end, what came of it, as it is scored
        self.go(1)
        self.page.wait(f"{TRAINING}.view === 'debriefing'")
        self.assertEqual(self.page.run(f"return {buttons}"), [True] * 4)
        scored = json.loads(subprocess.run([self.program, "-q", "task", "score", self.recording, "--task", self.file, "--json"],
                                           capture_output=True, text=True, check=False).stdout)["runs"][0]
        told = self.page.run(f"return {TRAINING}.debriefing")
        self.assertEqual([metric["value"] for metric in told["metrics"]], [metric["value"] for metric in scored["metrics"]])
        self.assertEqual(told["done"], [step["done"] for step in scored["steps"]])
        self.assertIn("✓" if scored["in_band"] else "✗", text("#verdict"))
        # and back, before anything was done; what was felt cannot be begun
        self.go(0.02)
        self.page.wait(f"{TRAINING}.view === 'running' && {TRAINING}.run.done.every((done) => !done)")
        self.page.press("b")
        self.assertEqual(self.view_after_a_moment(), "running")

    def view_after_a_moment(self):
        time.sleep(0.3)
        return self.page.run(f"return {TRAINING}.view")


class PlayedWithScope(viewer_page.Viewer):
    """A run of two devices: the page's scope stands as the task's does, on the second one."""

    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory(prefix="palpate-scope-")
        cls.addClassCleanup(folder.cleanup)
        program = viewer_page.program
        script, recording, task = (os.path.join(folder.name, name) for name in ("script.toml", "run.h5", "task.toml"))
        with open(script, "w", encoding="utf-8") as out:
            out.write('[[step]]\nscope = "probe"\nspeed = 200.0\noptics = 70.0\nback = 4.0\n[[step]]\napproach = "patella"\n[[step]]\npress = 0.8\n[[step]]\nhold = 0.5\n')
        with open(task, "w", encoding="utf-8") as out:
            out.write(TASK + '[[metric]]\nname = "unseen_time"\nat_most = 0\n[scope]\noptics = 70\nback = 4\n')
        subprocess.run([program, "-q", "simulate", "knee-phantom:spacing=1.2", "-s", script, "-o", recording], check=True, stdout=subprocess.DEVNULL)
        cls.server = viewer_page.Server("recording")
        cls.server.command = lambda: [program, "replay", recording, "--view", "--task", task, "--port", str(cls.server.port)]
        cls.server.__enter__()
        cls.addClassCleanup(cls.server.__exit__)
        cls.open_browser()

    def test_the_scope_stands_as_the_task_says(self):
        self.page.wait(f"{TRAINING}.view === 'running' && palpateViewer.pose.devices.length === 2 && palpateViewer.scopeFrame !== null")
        # at the end of it, so that it has got there and looks at the probe
        self.page.run("const place = document.getElementById('place'); place.value = place.max; place.dispatchEvent(new Event('input', { bubbles: true }))")
        self.page.wait(f"{TRAINING}.view === 'debriefing'")
        frame, devices = self.page.run("return [palpateViewer.scopeFrame, palpateViewer.pose.devices]")
        self.assertAlmostEqual(math.dist(frame["eye"], devices[1]["tip"]), 4, delta=0.001)
        way = [a - b for a, b in zip(devices[0]["tip"], frame["eye"])]
        far_mm = math.hypot(*way)
        self.assertAlmostEqual(far_mm, 20, delta=0.6)
        self.assertGreater(sum(a * b for a, b in zip(way, frame["forward"])) / far_mm, math.cos(math.radians(2.5)), "the probe is in its middle")
        self.assertEqual(self.page.run(f"return {TRAINING}.debriefing.metrics.at(-1).value"), 0)


class Picker(Trainee):
    """Without a task of its own the page offers those that are made for the scene."""

    @classmethod
    def options(cls):
        return []

    def test_a_task_is_chosen(self):
        names = self.page.run("return [...document.getElementById('task').options].map((option) => option.value)")
        self.assertLessEqual({"meniscus-probing", "diagnostic-round", "hold-steady", "trace-an-edge"}, set(names))
        self.assertNotIn("find-the-nodule", names)
        # nobody is asked to do one, and what is felt stands on top
        self.assertEqual(self.page.run("return document.getElementById('task').selectedOptions[0].text"), "none")
        self.assertLess(self.box("#training")[3], 80)
        self.assertEqual(self.view(), "none")
        before = self.page.run("return palpateViewer.project([0, 0, 0])")
        self.page.run("const task = document.getElementById('task'); task.focus(); task.value = 'trace-an-edge'; task.dispatchEvent(new Event('change'))")
        self.page.wait("document.getElementById('task-title').innerText.includes('edge')")
        self.assertEqual(self.page.run("return document.activeElement.id"), "task", "who goes through the list by keys goes on")
        self.assertNotEqual(self.page.run("return palpateViewer.project([0, 0, 0])"), before, "the picture looks at where it is done")
        self.assertEqual(self.accessibility_violations(), [])
        self.page.click("#task-begin")
        self.page.wait(f"{TRAINING}.view === 'running' && {TRAINING}.run.task === 'trace-an-edge'")
        self.assertTrue(self.page.run("return document.getElementById('task').disabled"))
        # another page of the same session sees the same run
        self.open_page(keep_storage=True)
        self.page.wait(f"{TRAINING}.view === 'running' && {TRAINING}.task === 'trace-an-edge'")
        self.page.click("#task-end")
        self.page.wait(f"{TRAINING}.view === 'debriefing'")
        self.assertIn("Not every counted metric in its band", self.text("#verdict"))
        self.open_page(keep_storage=True)
        self.page.wait(f"{TRAINING}.view === 'debriefing'")


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    viewer_page.use_program(sys.argv[1])
    del sys.argv[1]
    del Trainee
    browser.run_tests(viewer_page.NUMPY_NEEDED)
