"""A lesson of a teacher and three learners in four windows of a browser: as docs/tutorials/lesson.md says, and with mistakes.

usage: lesson_test.py PALPATE [TEST ...]

The commands and the words of the page are read from the tutorial. Exit code 77 (a skip) where there is no browser, except in CI, where that is a
failure.
"""

import json
import os
import pathlib
import re
import shlex
import subprocess
import sys
import tempfile
import time

sys.dont_write_bytecode = True  # nothing is left in the source tree
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "e2e"))
import browser  # noqa: E402
import viewer_page  # noqa: E402

TUTORIAL = pathlib.Path(__file__).resolve().parents[2] / "docs" / "tutorials" / "lesson.md"
LEARNERS = ("L041", "L042", "L043")
TRAINING = "palpateViewer.training"
LEAST_N = 0.05  # force that counts as a touch
# where the page that is driven shows a structure in the volume: the pixel with the most surroundings that show it, too
PIXEL_OF = """const wanted = palpateViewer.scene.structures.findIndex(({ name }) => name === arguments[0]);
    const { left, top, width, height } = document.querySelector('#picture-volume .stack').getBoundingClientRect();
    const first = (x, y) => {
      const { from, into } = palpateViewer.volumeRay(x, y);
      for (let mm = -300; mm < 600; mm += 0.8) {
        const place = palpateViewer.structureAt(from.map((v, n) => v + mm * into[n]));
        if (place !== null) return place;
      }
      return null;
    };
    let [best, most] = [null, 2];
    for (let y = -height / 2 + 30; y < height / 2 - 30; y += 6)
      for (let x = -width / 2 + 30; x < width / 2 - 30; x += 6) {
        let around = 0;
        const rings = [[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]];
        while (around < 24 && rings.every(([dx, dy]) => first(x + dx * around, y + dy * around) === wanted)) around += 3;
        if (around > most) [best, most] = [[Math.round(left + width / 2 + x), Math.round(top + height / 2 + y)], around];
      }
    return best"""


class FourWindows(viewer_page.Viewer):
    """The session of the tutorial's commands, and its windows by name."""

    limits_frame_rate = True
    pages = ("Teacher", *LEARNERS)

    @classmethod
    def setUpClass(cls):
        cls.tutorial = TUTORIAL.read_text(encoding="utf-8")

    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="palpate-lesson-")
        self.addCleanup(folder.cleanup)
        self.folder = folder.name
        self.environment = {**os.environ, "PALPATE_RECORDS": os.path.join(self.folder, "records.db")}
        self.expected = ("401",)  # each page finds out that it needs a token
        self.page = browser.Browser().__enter__()
        self.addCleanup(self.page.__exit__)
        self.windows, self.debriefings = {}, []
        self.shell(self.block("palpate token --role teacher"))
        with open(os.path.join(self.folder, "class"), encoding="utf-8") as lines:
            roles = [line.split() for line in lines]
        self.tokens = {learner[0] if learner else "Teacher": token for _, token, *learner in roles}
        self.start(self.block("palpate explore knee-phantom"))

    def tearDown(self):
        pass  # the console of each window is read by close_windows

    # ---- commands

    def block(self, begin):
        """The tutorial's block of commands that begins with these words."""
        return re.search(r"```sh\n(" + re.escape(begin) + r".*?)```", self.tutorial, re.S).group(1)

    def shell(self, commands):
        program = shlex.quote(viewer_page.program)
        text = f"set -e\npalpate() {{ {program} -q \"$@\"; }}\n{commands}"
        done = subprocess.run(["bash", "-c", text], cwd=self.folder, env=self.environment, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done.stdout

    def start(self, command):
        """The tutorial's session, with coarser voxels and on a free port."""
        words = shlex.split(command)
        self.assertEqual(words[:3], ["palpate", "explore", "knee-phantom"])
        self.port = browser.free_port()
        words[0], words[2] = viewer_page.program, "knee-phantom:spacing=1.5"
        self.terminal = open(os.path.join(self.folder, "terminal"), "w+", encoding="utf-8")
        self.addCleanup(self.terminal.close)
        self.session = subprocess.Popen([*words, "--port", str(self.port)], cwd=self.folder, env=self.environment, stdin=subprocess.DEVNULL,
                                        stdout=self.terminal, stderr=self.terminal)
        self.addCleanup(self.end_session)
        self.until(lambda: f"to see it, open http://127.0.0.1:{self.port}/" in self.printed(), "the terminal's address")

    def printed(self):
        with open(self.terminal.name, encoding="utf-8") as text:
            return text.read()

    def end_session(self):
        if self.session.poll() is None:
            self.session.terminate()
            self.session.wait(60)

    def until(self, is_so, what, seconds=120):
        deadline = time.monotonic() + seconds
        while not is_so():
            if time.monotonic() > deadline:
                self.fail("never: " + what)
            time.sleep(0.05)

    def recorded(self):
        return [json.loads(line) for line in self.shell("palpate records list --json || true").splitlines()]

    # ---- windows

    def open(self, name):
        """Opens the address in a window of its own, the first one in that of the browser."""
        self.windows[name] = self.page.open_window() if self.windows else self.page.window()
        self.page.dark(True)
        self.page.resize(*viewer_page.SIZE)
        self.page.post("/url", {"url": f"http://127.0.0.1:{self.port}/"})
        self.page.wait("document.querySelector('#token-dialog')?.open")

    def type_token(self, token):
        self.page.run("document.getElementById('token').value = ''")
        self.page.type("#token", token)
        self.page.click("#token-form button")

    def come(self, name):
        """Opens a window, and types the token."""
        self.open(name)
        self.sign_in(name)

    def sign_in(self, name):
        self.type_token(self.tokens[name])
        self.page.wait(viewer_page.LOADED)
        self.page.run(f"palpateViewer.leastFrame_ms = {2 * viewer_page.LEAST_FRAME_MS}")

    def at(self, name):
        """Drives the window of a person from here on."""
        self.page.switch_to(self.windows[name])
        return self.page

    def leave(self, name):
        self.at(name).close_window()
        del self.windows[name]
        self.page.switch_to(next(iter(self.windows.values())))

    def close_windows(self):
        for name in list(self.windows):
            faults = [entry["message"] for entry in self.at(name).log()]
            self.assertEqual([m for m in faults if not any(part in m for part in (*self.expected, viewer_page.WAITS_FOR_PICTURES))], [], name)

    def text(self, selector):
        return self.page.run("return document.querySelector(arguments[0]).innerText", selector)

    def is_enabled(self, selector):
        return self.page.run("const one = document.querySelector(arguments[0]); return one.checkVisibility() && !one.disabled", selector)

    def says(self, selector, words):
        """Waits until an element shows words of the tutorial."""
        self.assertIn(words, re.sub(r"\s+", " ", self.tutorial))
        self.page.wait("document.querySelector(" + json.dumps(selector) + ").innerText.includes(" + json.dumps(words) + ")", 60)

    def name_learner(self, learner):
        self.at("Teacher").click(f"#lesson-learners [data-learner='{learner}']")

    def row(self, learner):
        return self.page.run("return document.querySelector(arguments[0]).parentElement.innerText", f"#lesson-learners [data-learner='{learner}']")

    def row_says(self, learner, words):
        self.until(lambda: words in self.row(learner), f"{words!r} in the line of {learner}")

    def click_in_row(self, learner):
        """*Pass the tip* in the learner's line."""
        self.page.run("document.querySelector(arguments[0]).parentElement.querySelectorAll('button')[1].click()", f"#lesson-learners [data-learner='{learner}']")

    def press(self, structure, within_s=20):
        """Presses on what the volume shows of a structure, runs along it for a few pixels, and lets go; returns the greatest force of the card until
        it showed any. Presses again if the page was too busy to hold the tip."""
        self.page.run("palpateViewer.draw()")
        at = self.page.run(PIXEL_OF, structure)
        self.assertIsNotNone(at, "the volume shows nothing of " + structure)
        self.page.pointer({"type": "pointerMove", "x": at[0], "y": at[1]}, {"type": "pointerDown", "button": 0})
        most_N, deadline = 0.0, time.monotonic() + within_s
        while time.monotonic() < deadline and most_N < LEAST_N:
            most_N = max([most_N, *(self.page.run(f"return {TRAINING}.run?.forces_N ?? []") or [])])
            if not self.page.run("return palpateViewer.isPressing"):
                self.page.pointer({"type": "pointerUp", "button": 0}, {"type": "pointerDown", "button": 0})
        if within_s > 0 and most_N < LEAST_N:
            self.page.screenshot(os.path.join(os.environ.get("PALPATE_TEST_PICTURES", self.folder), "press.png"))
            print("  no force: pressed at", at, self.page.run(f"return [palpateViewer.pose.devices[0], {TRAINING}.run]"), flush=True)
        self.page.pointer({"type": "pause", "duration": 600}, {"type": "pointerMove", "x": at[0] + 3, "y": at[1] + 1, "duration": 200},
                          {"type": "pointerUp", "button": 0})
        return most_N

    def begin(self):
        self.until(lambda: self.is_enabled("#task-begin") or self.is_enabled("#task-again"), "Begin is enabled")
        self.page.click("#task-begin" if self.is_enabled("#task-begin") else "#task-again")
        self.page.wait(f"{TRAINING}.view === 'running'")

    def debriefed(self):
        self.page.wait(f"{TRAINING}.view === 'debriefing'", 60)
        self.debriefings.append(self.page.run(f"return {TRAINING}.debriefing"))
        return self.debriefings[-1]

    def check_scores(self):
        """What the pages showed of each run is what palpate and the second implementation have of the recording, and so are the records."""
        recording, task = (os.path.join(self.folder, name) for name in ("lesson.h5", "task.toml"))
        self.shell("palpate task show meniscus-probing > task.toml")
        for shown in self.debriefings:
            ticks = shown["first_tick"], shown["last_tick"]
            scored = json.loads(self.shell(f"palpate task score lesson.h5 --task meniscus-probing --json --from-tick {ticks[0]} --to-tick {ticks[1]} || true"))["runs"][0]
            stated = {metric["name"]: metric["value"] for metric in scored["metrics"]}
            self.assertEqual([metric["value"] for metric in shown["metrics"]], list(stated.values()))
            self.assertEqual(second_scores.faults(second_scores.scores(recording, task, ticks), stated), [])
            self.assertLessEqual(second_scores.peak_above_limit(recording, ticks), 1e-9)
            if shown["kept"] is not None:
                recorded = json.loads(self.shell(f"palpate records show {shown['kept']} --json"))
                self.assertEqual({metric["name"]: metric["value"] for metric in recorded["metrics"]}, stated)
                self.assertEqual(recorded["started_utc"], scored["started_utc"])


class AsTheTutorialSays(FourWindows):
    def test_the_lesson_word_by_word(self):
        self.sign_in_everybody()
        self.first_learner_runs()
        self.result_and_takeover()
        self.other_learners_run()
        self.compare_curves()
        self.lesson_ends()

    def sign_in_everybody(self):
        """Section 3 of the tutorial: everybody signs in, the teacher first; a wrong token may be typed again."""
        self.open("Teacher")
        self.type_token(self.tokens["Teacher"].swapcase())
        self.says("#token-dialog", "The token was not accepted")
        self.sign_in("Teacher")
        for name in LEARNERS:
            self.come(name)
        self.at("Teacher")
        self.says("#who", "Teacher")
        self.at("L041")
        self.says("#who", "Learner L041")

    def first_learner_runs(self):
        """Sections 4.1 and 4.2: the teacher names the first learner, who begins a run."""
        # the list of the learners of `class`, each connected
        self.at("Teacher")
        self.assertTrue(self.is_enabled("#lesson"))
        for learner in LEARNERS:
            self.until(lambda one=learner: self.page.run("return document.querySelector(`#lesson-learners [data-learner='${arguments[0]}']`) !== null", one), learner)
            self.assertNotIn("not connected", self.row(learner))
        self.name_learner("L041")
        self.says("#lesson-note", "The next runs are saved for L041.")
        self.row_says("L041", "moves the tip")
        for other in ("L042", "L043"):
            self.at(other)
            self.says("#lesson-note", "Another learner's turn: view only.")
            self.assertFalse(self.is_enabled("#task-begin"))

        # Begin, the tip with the mouse button held, the force bar
        self.at("L041")
        self.begin()
        self.assertGreaterEqual(self.press("medial_meniscus"), LEAST_N, "the force bar")
        self.at("Teacher").wait(f"{TRAINING}.view === 'running'")
        self.name_learner("L042")
        self.page.wait("document.getElementById('toast').innerText.toLowerCase().includes('a run is in progress')")
        self.assertEqual(self.page.run("return palpateViewer.state.lesson.learner"), "L041", "during a run the turn cannot be changed")
        self.page.click("#task-end")

    def result_and_takeover(self):
        """Section 4.3: figures with their bands, in the records at once; then a run in which the teacher takes the tip."""
        first = self.at("L041") and self.debriefed()
        self.assertEqual(first["kept"], 1)
        self.assertEqual(self.page.run("return document.querySelectorAll('#figures tbody tr').length"), 8)
        self.assertRegex(self.text("#figures"), r"(?s)Peak force.*?at most 8\.50? N")
        self.assertIn("Improve this first: complete the step", self.text("#improve"))
        self.assertGreater(self.page.run("return document.querySelectorAll('#run-plots canvas').length"), 0)
        self.assertEqual([run["learner"] for run in self.recorded()], ["L041"])
        self.assertEqual(self.text("#task-again"), "Repeat")
        self.page.click("#task-again")
        self.page.wait(f"{TRAINING}.view === 'running'")
        # to show something yourself: Take the tip; Pass the tip gives it back; such a run is not the learner's own
        self.at("Teacher").click("#lesson-take")
        self.page.wait("palpateViewer.state.pointer")
        self.assertGreaterEqual(self.press("medial_meniscus"), LEAST_N)
        self.click_in_row("L041")
        self.row_says("L041", "moves the tip")
        second = self.at("L041") and (self.page.click("#task-end") or self.debriefed())
        self.assertIsNone(second["kept"])
        self.page.wait("document.getElementById('verdict-more').innerText.includes('Another viewer moved the tip during part of the run')")
        self.assertEqual(len(self.recorded()), 1)

    def other_learners_run(self):
        """Section 4.4: the next learner, and then whoever takes the tip."""
        self.name_learner("L042")
        self.row_says("L042", "moves the tip")
        self.at("L041")
        self.says("#lesson-note", "Another learner's turn: view only.")
        self.at("L042")
        self.begin()
        self.press("medial_meniscus")
        # the space bar stops all force, for everybody
        self.at("L043").run("document.activeElement.blur()")
        self.page.press(" ")
        self.at("L042").wait("(palpateViewer.pose.devices[0].flags & 8192) !== 0")
        self.page.click("#task-end")
        self.assertEqual(self.debriefed()["kept"], 2)
        self.at("Teacher").click("#lesson-learners [data-learner='']")
        self.page.wait("palpateViewer.state.lesson.learner === null")
        self.leave("L042")  # the tip is free
        self.at("L043").wait("palpateViewer.state.pointer_by === null")
        self.press("medial_meniscus", within_s=0)
        self.page.wait("palpateViewer.state.pointer")
        self.begin()
        self.page.click("#task-end")
        self.assertEqual(self.debriefed()["kept"], 3)
        self.assertEqual([run["learner"] for run in self.recorded()], list(LEARNERS))

    def compare_curves(self):
        """A learner sees the own curves only, the teacher those of all."""
        self.page.click("#curves-show")
        self.page.wait("!document.getElementById('curves').hidden")
        curves = "document.getElementById('curves-page').shadowRoot.innerText ?? document.getElementById('curves-page').shadowRoot.textContent"
        self.assertIn("L043", self.page.run(f"return {curves}"))
        self.assertNotIn("L041", self.page.run(f"return {curves}"))
        self.page.click("#curves-close")
        self.assertEqual(self.at("Teacher").run("return document.getElementById('curves-show').innerText"), "All learners' curves")
        self.page.click("#curves-show")
        self.page.wait("!document.getElementById('curves').hidden")
        self.assertTrue(all(learner in self.page.run(f"return {curves}") for learner in LEARNERS))
        self.page.click("#curves-close")

    def lesson_ends(self):
        """Section 5: the teacher ends the lesson during a run, which is scored; every page says so, and the results can
        still be read."""
        self.at("L043")
        self.begin()
        self.press("medial_meniscus", within_s=0)
        self.at("Teacher").click("#lesson-end")
        self.assertEqual(self.text("#lesson-end"), "Ends the session for all viewers: press again to confirm")
        self.page.click("#lesson-end")
        self.until(lambda: self.session.poll() is not None, "the session ends")
        self.assertEqual(self.session.returncode, 0, self.printed())
        for name in ("Teacher", "L041", "L043"):
            self.at(name).wait("palpateViewer.link === 'over'")
            self.says("#link-text", "The teacher has ended the lesson")
        self.assertEqual(self.at("L041").run("return document.querySelectorAll('#figures tbody tr').length"), 8)
        last = self.at("L043") and self.debriefed()
        self.assertEqual((last["end"], last["kept"]), ("session", 4))
        self.assertIn("Improve this first: complete the step", self.text("#improve"))
        for shown in ("#verdict", "#improve", "#run-plots canvas", "#figures", "#task-again"):
            self.assertTrue(self.page.run("return document.querySelector(arguments[0]).checkVisibility()", shown), shown)
        self.says("#task-note", "The teacher has ended the lesson")
        for number in (1, 2, 3, 4, 5):
            self.assertIn(f"run {number}", self.printed())
        self.assertRegex(self.printed(), r"ticks \d+")
        listed = self.shell(self.block("palpate records list "))
        for learner in LEARNERS:
            self.assertIn(learner, listed)
        self.assertEqual(sorted(set(os.listdir(self.folder)) & {"class", "lesson.h5", "learners.html"}), ["learners.html", "lesson.h5"])
        begun = [run["started_utc"] for run in self.recorded()]
        self.assertEqual(len(set(begun)), 4, "each run has its own start")
        self.assertEqual(begun, sorted(begun))
        self.check_scores()
        self.close_windows()


class ATeacherWhoMakesMistakes(FourWindows):
    def test_mistakes_are_reported_and_correctable(self):
        for name in ("Teacher", "L041", "L042"):
            self.come(name)
        # a learner who is not there is named: nobody can begin as somebody else, and whoever comes gets the tip
        self.name_learner("L043")
        self.at("Teacher").wait("palpateViewer.state.lesson.learner === 'L043'")
        self.row_says("L043", "not connected")
        for name in ("L041", "L042"):
            self.at(name).wait("palpateViewer.state.lesson.of_another")
            self.assertFalse(self.is_enabled("#task-begin"))
        # the teacher begins for L043, who is not there, and then sees that: no run of L043 is saved
        self.at("Teacher")
        self.begin()
        time.sleep(0.4)
        self.page.click("#task-end")
        bystander = self.debriefed()
        self.assertIsNone(bystander["kept"])
        self.assertIn(None, [metric["value"] for metric in bystander["metrics"]], "no force of a run in which nobody held the tip")
        self.page.wait("document.getElementById('verdict-more').innerText.includes('No viewer moved the tip during the run')")
        self.assertEqual(self.recorded(), [])
        # the wrong learner is named, and then the right one
        self.name_learner("L042")
        self.row_says("L042", "moves the tip")
        self.name_learner("L041")
        self.row_says("L041", "moves the tip")
        self.assertNotIn("moves the tip", self.row("L042"))

        # two press Begin at once: one run begins, and the other page shows it without a fault
        begin = "(document.getElementById('task-begin').checkVisibility() ? document.getElementById('task-begin') : document.getElementById('task-again')).click()"
        self.at("L041").wait("palpateViewer.state.pointer")
        self.until(lambda: self.is_enabled("#task-begin") or self.is_enabled("#task-again"), "Begin is enabled")
        self.page.run(f"setTimeout(() => {begin}, 700)")
        self.at("Teacher").run(f"setTimeout(() => {begin}, 500)")
        for name in ("Teacher", "L041"):
            self.at(name).wait(f"{TRAINING}.view === 'running'")
        self.assertEqual(self.page.run(f"return {TRAINING}.run.run"), 2)
        self.assertFalse(self.at("L042") and self.is_enabled("#task-begin"))

        # the teacher closes the page during the run: it goes on
        self.leave("Teacher")
        self.at("L041")
        self.assertGreaterEqual(self.press("medial_meniscus"), LEAST_N)
        self.close_windows()


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    viewer_page.use_program(sys.argv[1])
    del sys.argv[1]
    lacks = None
    try:
        import second_scores
    except ImportError as absent:
        lacks = f"python3-{absent.name} is not installed"
    del FourWindows
    browser.run_tests(lacks)
