"""The scores of all tasks that palpate brings along are the same in the page, the records, the exports and the report, and those of a second
implementation that reads the recording (tests/e2e/second_scores.py).

usage: scores_test.py PALPATE [TEST ...]

Exit code 77 (a skip) where there is no browser, except in CI, where that is a failure.
"""

import csv
import html
import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile

sys.dont_write_bytecode = True  # nothing is left in the source tree
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "e2e"))
import browser  # noqa: E402
import viewer_page  # noqa: E402

TRAINING = "palpateViewer.training"
LIMIT_N = 2.0  # of the session; most trainees push harder


class Scores(viewer_page.Viewer):
    """A clumsy trainee does each task with the simulated hand, and a bystander begins it and touches nothing; the recording is scored everywhere."""

    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory(prefix="palpate-scores-")
        cls.addClassCleanup(folder.cleanup)
        cls.folder = pathlib.Path(folder.name)
        cls.records = cls.folder / "records.db"
        cls.open_browser()

    def setUp(self):
        self.expected = ()

    def palpate(self, *arguments, codes=(0, 3)):
        done = subprocess.run([viewer_page.program, "-q", *map(str, arguments)], stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
        self.assertIn(done.returncode, codes, done.stderr)
        return done.stdout

    def data_set_of(self, task):
        data_set = self.palpate("task", "draw", task, "--seed", 1).strip()
        if task.startswith("find-the-soft"):  # its place is too small for coarse voxels
            return data_set
        return data_set + ("," if ":" in data_set else ":") + "spacing=1.2"

    def recording_of(self, task):
        script, recording = self.folder / f"{task}.toml", self.folder / f"{task}.h5"
        script.write_text(trainees.script_text(task, "heavy", 1), encoding="utf-8")
        self.palpate("simulate", self.data_set_of(task), "--script", script, "-o", recording, "--max-force", LIMIT_N)
        return recording

    def shown_by_page(self, recording, task):
        """{metric's name: value}, and the rows of the table, of the page that plays the recording."""
        self.server = viewer_page.Server("recording")
        self.server.command = lambda: [viewer_page.program, "replay", str(recording), "--view", "--task", task, "--port", str(self.server.port)]
        with self.server:
            self.open_page()
            self.page.wait(f"{TRAINING}.view === 'running'")
            self.page.run("const place = document.getElementById('place'); place.value = place.max; place.dispatchEvent(new Event('input', { bubbles: true }))")
            self.page.wait(f"{TRAINING}.view === 'debriefing'")
            values = self.page.run(f"return {TRAINING}.debriefing.metrics.map(({{ value }}) => value)")
            rows = self.page.run("return [...document.querySelectorAll('#figures tbody tr')].map((row) => [row.cells[0].innerText, row.cells[1].innerText])")
            self.page.post("/url", {"url": "about:blank"})
        return values, rows

    def check(self, task):
        file, recording = self.folder / f"{task}-task.toml", self.recording_of(task)
        file.write_text(self.palpate("task", "show", task), encoding="utf-8")
        scored = json.loads(self.palpate("task", "score", recording, "--task", task, "--json", "--record", task, "--records", self.records))["runs"][0]
        stated = {metric["name"]: metric["value"] for metric in scored["metrics"]}
        recomputed = second_scores.scores(recording, file)
        self.assertGreaterEqual(len(recomputed), 3)
        self.assertEqual(second_scores.faults(recomputed, stated), [])
        self.assertLessEqual(second_scores.peak_above_limit(recording), 1e-9)

        # the record, its exports
        number = json.loads(self.palpate("records", "list", "--records", self.records, "--learner", task, "--json"))["run"]
        shown = json.loads(self.palpate("records", "show", number, "--records", self.records, "--json"))
        self.assertEqual({metric["name"]: metric["value"] for metric in shown["metrics"]}, stated)
        table, statements = self.folder / f"{task}.csv", self.folder / f"{task}.jsonl"
        self.palpate("records", "export", "--records", self.records, "--learner", task, "-o", table)
        with open(table, newline="", encoding="utf-8") as lines:
            self.assertEqual({row["metric"]: float(row["value"]) if row["value"] else None for row in csv.DictReader(lines)}, stated)
        self.palpate("records", "export", "--records", self.records, "--learner", task, "--format", "xapi", "-o", statements)
        metrics = json.loads(statements.read_text(encoding="utf-8"))["result"]["extensions"]["https://palpate.invalid/xapi/metrics"]
        self.assertEqual({name: metric["value"] for name, metric in metrics.items()}, stated)

        # the report, with its digits
        report = self.folder / f"{task}.html"
        self.palpate("report", recording, "--task", task, "-o", report)
        cells = dict(re.findall(r'<tr><th scope="row">([^<]*)</th><td[^>]*>([^<]*)</td>', report.read_text(encoding="utf-8")))
        cells = {html.unescape(name): text for name, text in cells.items()}
        titles = {metric["name"]: metric["title"] for metric in scored["metrics"]}
        for name, value in stated.items():
            self.assertNotIn("_", titles[name])
            self.assertEqual(cells[titles[name]].split()[0], "none" if value is None else f"{value:.4g}", name)

        # the page
        values, rows = self.shown_by_page(recording, task)
        self.assertEqual(values, list(stated.values()))
        for (said, figure), (name, value) in zip(rows, stated.items()):
            self.assertNotIn("_", said.split(":")[0])
            if value is not None:
                shown = float(re.match(r"[-\d.]+", figure.replace(",", "").replace("−", "-")).group())
                self.assertAlmostEqual(shown / 100 if "%" in figure else shown, value, delta=0.006 * abs(value) + 0.001, msg=name)


    def check_bystander(self, task):
        """A run in the page during which nobody holds the tip."""
        file, recording = self.folder / f"{task}-task.toml", self.folder / f"{task}-bystander.h5"
        file.write_text(self.palpate("task", "show", task), encoding="utf-8")
        self.server = viewer_page.Server("live")
        self.server.command = lambda: [viewer_page.program, "explore", self.data_set_of(task), "--device", "pointer", "--task", task, "-o", str(recording),
                                       "--port", str(self.server.port)]
        with self.server:
            self.open_page()
            self.page.wait("!document.getElementById('task-begin').disabled")
            self.page.press("b")
            self.page.wait(f"{TRAINING}.run?.phase === 'running' && {TRAINING}.run.time_s > 1")
            self.page.press("b")
            self.page.wait(f"{TRAINING}.view === 'debriefing'")
            shown = self.page.run(f"return {TRAINING}.debriefing")
            self.page.post("/url", {"url": "about:blank"})
        ticks = shown["first_tick"], shown["last_tick"]
        scored = json.loads(self.palpate("task", "score", recording, "--task", task, "--json", "--from-tick", ticks[0], "--to-tick", ticks[1]))["runs"][0]
        stated = {metric["name"]: metric["value"] for metric in scored["metrics"]}
        self.assertEqual([metric["value"] for metric in shown["metrics"]], list(stated.values()))
        recomputed = second_scores.scores(recording, file, ticks)
        self.assertEqual(second_scores.faults(recomputed, stated), [])
        self.assertEqual({value for name, value in recomputed.items() if "force" in name} - {None, 0.0}, set(), "nothing was touched")


def add_tests():
    for task in trainees.TASKS:
        # next to a pointer, only a physical device can hold a scope
        if task != "scope-and-probe":
            setattr(Scores, "test_bystander_" + task.replace("-", "_"), lambda self, task=task: self.check_bystander(task))
        setattr(Scores, "test_" + task.replace("-", "_"), lambda self, task=task: self.check(task))


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    viewer_page.use_program(sys.argv[1])
    os.environ["PALPATE"] = viewer_page.program
    del sys.argv[1]
    lacks = None
    try:
        import second_scores
        import trainees
    except ImportError as absent:
        lacks = f"python3-{absent.name} is not installed"
    else:
        add_tests()
    browser.run_tests(lacks)
