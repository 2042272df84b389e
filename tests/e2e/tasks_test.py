"""palpate task and palpate records: what trainees and their teachers type."""

import csv
import json
import pathlib
import re

import cli
import second_scores
import trainees

TASK = "hold-steady"


class Tasks(cli.PalpateTest):
    def simulate(self, name, kind="expert", seed=0, task=TASK, data_set=None, status=cli.OK, says=(), max_force_N=6):
        script, recording = self.folder / f"{name}.toml", self.folder / f"{name}.h5"
        script.write_text(trainees.script_text(task, kind, seed), encoding="utf-8")
        data_set = data_set or f"knee-phantom:spacing={cli.KNEE_MM}"
        done = cli.run("-q", "simulate", data_set, "--script", script, "-o", recording, "--max-force", max_force_N, *says)
        self.assertIn(done.returncode, (cli.OK, cli.LIMIT) if status is None else (status,), done.stderr)
        return recording

    def score(self, *recordings, task=TASK, status=cli.OK):
        done = cli.run("task", "score", *recordings, "--task", task, "--json")
        self.assertIn(done.returncode, (cli.OK, cli.LIMIT) if status is None else (status,), done.stderr)
        return json.loads(done.stdout)

    def test_brings_tasks_along(self):
        tasks = json.loads(self.succeed("task", "list", "--json").stdout)
        names = {task["name"] for task in tasks}
        self.assertLessEqual({"meniscus-probing", "diagnostic-round", "hold-steady", "trace-an-edge", "find-the-nodule", "scope-and-probe", "bone-to-plan",
                              "find-the-softened-cartilage", "cortical-mastoidectomy"}, names)
        self.assertIn("Hold a force steady", self.succeed("task", "list").stdout)
        own = self.folder / "own.toml"
        own.write_text(self.succeed("task", "show", TASK).stdout, encoding="utf-8")
        self.assertEqual(self.succeed("task", "draw", own, "--seed", 3).stdout, "knee-phantom:seed=3\n")
        drawn = self.succeed("task", "draw", "find-the-nodule", "--seed", 7).stdout
        self.assertRegex(drawn, r"^palpation-block:seed=7,diameter=[\d.]+,depth=[\d.]+,stiffness=\d+\n$")
        self.assertEqual(drawn, self.succeed("task", "draw", "find-the-nodule", "--seed", 7).stdout)
        soft = self.succeed("task", "draw", "find-the-softened-cartilage", "--seed", 7).stdout
        self.assertRegex(soft, r"^knee-phantom:seed=7,lesion=[\d.]+,lesion-in=\w+_cartilage,lesion-at=[0-3],visible=no\n$")
        # a plan is one patient's
        self.assertEqual(self.succeed("task", "draw", "bone-to-plan", "--seed", 7).stdout, "knee-phantom:burr=4\n")
        # but for one of whole structures, which every patient has
        self.assertEqual(self.succeed("task", "draw", "cortical-mastoidectomy", "--seed", 7).stdout, "temporal-bone:seed=7\n")
        self.assertIn("mm3", self.succeed("plan", "show", "femur-pocket", "--scene", f"knee-phantom:burr=4,spacing={cli.KNEE_MM}").stdout)

    def test_scores_a_run_keeps_it_and_forgets_it(self):
        run = self.simulate("run")
        scored = self.score(run)
        metrics = {metric["name"]: metric for metric in scored["runs"][0]["metrics"]}
        self.assertEqual(metrics["steps_done"]["value"], 1)
        self.assertGreater(metrics["longest_in_band"]["value"], 2.5)
        self.assertLess(metrics["peak_force"]["value"], 1.5)
        self.assertTrue(scored["runs"][0]["in_band"])
        self.assertEqual((scored["in_a_row"], scored["passed"]), (1, False))
        own = self.folder / "own.toml"
        own.write_text(self.succeed("task", "show", TASK).stdout, encoding="utf-8")
        self.assertEqual(second_scores.faults(second_scores.scores(run, own), {name: metric["value"] for name, metric in metrics.items()}), [])
        # the same recording, the same bits
        self.assertEqual(self.score(run), scored)
        self.assertTrue(self.score(run, run, run)["passed"])
        text = self.succeed("task", "score", run, "--task", TASK).stdout
        self.assertIn("not validated", text)
        self.assertIn("done: hold", text)

        # a heavy hand is out of its band, and the tick is told in which it was
        heavy = self.score(self.simulate("heavy", "heavy"), status=cli.LIMIT)["runs"][0]
        over = [event for event in heavy["events"] if event["kind"] == "over_limit"]
        self.assertGreater(over[0]["force_N"], 2.5)
        # what was asked for above a session's limit was not sent, and does not count
        limited = self.simulate("limited", "heavy", max_force_N=2, status=None)
        stated = {metric["name"]: metric["value"] for metric in self.score(limited, status=None)["runs"][0]["metrics"]}
        self.assertEqual(second_scores.faults(second_scores.scores(limited, own), stated), [])
        self.assertLessEqual(stated["peak_force"], 2)
        self.assertGreater(stated["peak_force"], 1.9)
        self.assertLessEqual(second_scores.peak_above_limit(limited), 1e-9)

        # three runs are few
        many = [self.simulate(f"run{seed}", seed=seed) for seed in (1, 2)]
        calibrated = self.succeed("task", "calibrate", run, *many, "--task", TASK).stdout
        self.assertIn('basis = "not validated, too few runs', calibrated)
        at_least = float(re.search(r'name = "longest_in_band"\nat_least = ([\d.]+)', calibrated).group(1))
        self.assertGreater(at_least, 2)

        # records
        file = self.folder / "records.db"
        for learner in ("L1", "L1", "DOE^CANARY"):
            done = self.succeed("task", "score", run, "--task", TASK, "--record", learner, "--records", file)
            self.assertEqual("looks like a person" in done.stderr, learner != "L1")
        self.succeed("task", "score", *many, "--task", TASK, "--record", "L1", "--records", file)
        listed = [json.loads(line) for line in self.succeed("records", "list", "--records", file, "--json").stdout.splitlines()]
        self.assertEqual([row["learner"] for row in listed], ["L1", "DOE^CANARY", "L1", "L1"])
        self.assertIn("3 of 3  PASSED", self.succeed("records", "list", "--records", file, "--learner", "L1").stdout)
        shown = json.loads(self.succeed("records", "show", 1, "--records", file, "--json").stdout)
        self.assertEqual(shown["score_hash"], scored["runs"][0]["score_hash"])
        self.assertEqual([m["value"] for m in shown["metrics"]], [m["value"] for m in scored["runs"][0]["metrics"]])
        table = self.folder / "runs.csv"
        self.succeed("records", "export", "--records", file, "-o", table)
        with open(table, newline="", encoding="utf-8") as rows:
            self.assertEqual(sum(row["metric"] == "peak_force" for row in csv.DictReader(rows)), 4)
        statements = self.folder / "runs.jsonl"
        self.succeed("records", "export", "--records", file, "--format", "xapi", "--learner", "L1", "-o", statements)
        lines = [json.loads(line) for line in statements.read_text(encoding="utf-8").splitlines()]
        self.assertEqual(len(lines), 3)
        self.assertEqual({line["verb"]["display"]["en"] for line in lines}, {"passed"})
        page = self.folder / "learners.html"
        self.succeed("records", "page", "--records", file, "--learner", "L1", "-o", page)
        text = page.read_text(encoding="utf-8")
        self.assertIn('passed</span>, run 3', text)
        self.assertIn("Peak force", text)
        self.assertNotIn("peak_force", text)
        self.assertNotIn("CANARY", text)
        self.expect_error(cli.BAD_INPUT, "records", "page", "--records", self.folder / "none.db", "-o", self.folder / "none.html", message="none.db")
        self.assertFalse((self.folder / "none.html").exists())
        table.unlink()

        self.expect_error(cli.USAGE, "records", "erase", "DOE^CANARY", "--records", file, message="--yes")
        self.succeed("records", "erase", "DOE^CANARY", "--records", file, "--yes")
        for left in self.folder.iterdir():
            self.assertNotIn(b"CANARY", left.read_bytes(), left)
        self.assertEqual(len(self.succeed("records", "list", "--records", file, "--json").stdout.splitlines()), 3)
        self.expect_error(cli.BAD_INPUT, "records", "erase", "DOE^CANARY", "--records", file, "--yes", message="no learner")

    @cli.long
    def test_a_recording_says_of_which_task_it_is(self):
        run = self.simulate("run", says=("--task", TASK))
        plain = self.score(run)
        said = json.loads(self.succeed("task", "score", run, "--json").stdout)
        self.assertEqual(said, plain)
        self.succeed("report", run, "-o", self.folder / "run.html")
        self.assertIn("Task: Hold a force steady", (self.folder / "run.html").read_text(encoding="utf-8"))
        # another text still holds, and it is told; a file of the user's is to be named, and its name stays where it is
        own = self.folder / "DOE^CANARY.toml"
        own.write_text(self.succeed("task", "show", TASK).stdout + "# mine\n", encoding="utf-8")
        self.assertIn("in a version of the text other than", self.succeed("task", "score", run, "--task", own).stderr)
        mine = self.simulate("mine", says=("--task", own))
        self.expect_error(cli.USAGE, "task", "score", mine, message='run of "Hold a force steady"')
        self.assertNotIn(b"CANARY", mine.read_bytes())
        self.assertEqual(self.succeed("task", "score", mine, "--task", own).stderr.count("a version of the text other than"), 0)
        self.expect_error(cli.USAGE, "task", "score", self.simulate("none"), message="does not state which task")
        self.expect_error(cli.USAGE, "task", "score", run, mine, message="mine.h5")

    @cli.long
    def test_a_probe_is_watched_by_the_scope_in_the_other_hand(self):
        watched = self.score(self.simulate("watched", task="scope-and-probe"), task="scope-and-probe")["runs"][0]
        metrics = {metric["name"]: metric["value"] for metric in watched["metrics"]}
        self.assertEqual((metrics["steps_done"], metrics["unseen_time"]), (1, 0))
        alone = self.score(self.simulate("alone", "incomplete", task="scope-and-probe"), task="scope-and-probe", status=cli.LIMIT)["runs"][0]
        metrics = {metric["name"]: metric["value"] for metric in alone["metrics"]}
        self.assertGreater(metrics["unseen_time"], 1)
        self.assertLess(metrics["steps_done"], 1)
        self.assertIn("unseen", [event["kind"] for event in alone["events"]])
        # both devices replay, and one device is not enough
        self.assertIn("identical", self.succeed("replay", self.folder / "watched.h5").stdout)
        self.expect_error(cli.BAD_INPUT, "task", "score", self.simulate("one"), "--task", "scope-and-probe", message="two devices")
        script = self.folder / "watched.toml"
        self.expect_error(cli.USAGE, "explore", f"knee-phantom:spacing={cli.KNEE_MM}", "--script", script, "--no-viewer",
                          message="watched.toml:5: explore cannot move a scope by script")
        self.expect_error(cli.USAGE, "explore", f"knee-phantom:spacing={cli.KNEE_MM}", "--task", "scope-and-probe", "--no-viewer",
                          message="needs a second device for the scope")

    @cli.long
    def test_a_live_session_of_two_devices_is_what_its_recording_is_scored_as(self):
        script, run = self.folder / "touch.toml", self.folder / "run.h5"
        script.write_text(cli.TOUCH + "[[step]]\nhold = 0.5\n[[step]]\nleave = true\n", encoding="utf-8")
        # the pointer rests before the patient and looks at it
        done = cli.run("explore", f"knee-phantom:spacing={cli.KNEE_MM}", "--device", "simulated", "--device", "pointer", "--script", script,
                       "--task", "scope-and-probe", "--port", "0", "-o", run)
        self.assertIn("Scope and probe together", done.stdout, done.stderr)
        live = re.search(r"Contact time out of the scope's view +([\d.]+) s", done.stdout).group(1)
        scored = cli.run("task", "score", run, "--task", "scope-and-probe").stdout
        self.assertEqual(re.search(r"Contact time out of the scope's view +([\d.]+) s", scored).group(1), live)

    @cli.long
    def test_bone_is_taken_off_to_a_plan(self):
        knee = f"knee-phantom:burr=4,spacing={cli.KNEE_MM}"
        # voxels that are soon prepared are too coarse for its bounds
        made = self.score(self.simulate("made", task="bone-to-plan", data_set=knee), task="bone-to-plan", status=None)["runs"][0]
        metrics = {metric["name"]: metric["value"] for metric in made["metrics"]}
        self.assertEqual(metrics["steps_done"], 1)
        self.assertGreater(metrics["removed_in_plan"], 30)
        self.assertEqual(metrics["protected_removed"], 0)
        # of the same run the plan says the same
        self.succeed("plan", "compare", self.folder / "made.h5", "--plan", "femur-pocket", "--json", self.folder / "done.json")
        volumes = {volume["name"]: volume for volume in json.loads((self.folder / "done.json").read_text())["volumes"]}
        self.assertAlmostEqual(volumes["femur"]["removed_mm3"], metrics["removed_in_plan"], delta=1e-9)
        self.assertAlmostEqual(sum(volume["outside_mm3"] for volume in volumes.values()), metrics["removed_outside"], delta=1e-9)
        deep = self.score(self.simulate("deep", "heavy", task="bone-to-plan", data_set=knee, status=None), task="bone-to-plan", status=cli.LIMIT)["runs"][0]
        past = {metric["name"]: metric["value"] for metric in deep["metrics"]}
        self.assertGreater(past["depth_past_plan"], metrics["depth_past_plan"] + 1)
        self.assertGreater(past["protected_removed"], 0.1)
        # a report has the score, and a probe takes nothing off
        self.succeed("report", self.folder / "made.h5", "--task", "bone-to-plan", "-o", self.folder / "made.html")
        self.assertIn("Task: Take off bone to a plan", (self.folder / "made.html").read_text(encoding="utf-8"))
        self.expect_error(cli.BAD_INPUT, "task", "score", self.simulate("probe"), "--task", "bone-to-plan", message="no tool of the scene")
        self.expect_error(cli.BAD_INPUT, "simulate", "knee-phantom:burr=0.5", "--script", self.folder / "made.toml", message="too small")

    @cli.long
    def test_a_step_that_the_limit_does_not_permit_is_said(self):
        scene = f"knee-phantom:spacing={cli.KNEE_MM}"
        for limit, is_said in (("1.5", True), ("2.5", False)):
            done = cli.run("explore", scene, "--task", "meniscus-probing", "--no-viewer", "--seconds", "0.1", "--max-force", limit)
            self.assertIn(done.returncode, (cli.OK, cli.LIMIT), done.stderr)
            said = 'step "push on the medial meniscus" asks for 2.00 N, but the force limit is 1.50 N: raise it with --max-force'
            self.assertEqual(said in done.stderr, is_said, done.stderr)

    def test_says_what_is_wrong(self):
        run = self.simulate("run")
        own = self.folder / "own.toml"

        def wrong(text, says):
            own.write_text(text, encoding="utf-8")
            self.expect_error(cli.BAD_INPUT, "task", "score", run, "--task", own, message=says)
        plain = self.succeed("task", "show", TASK).stdout
        wrong(plain.replace("femoral_cartilage", "femoral_cartilige"), "no structure \"femoral_cartilige\"")
        wrong(plain.replace("band =", "bend ="), "own.toml:19: unknown key \"bend\"")
        wrong("", "no title")
        self.expect_error(cli.BAD_INPUT, "task", "score", run, "--task", "hold-stedy", message="palpate task list")
        own.write_text("no recording", encoding="utf-8")
        self.expect_error(cli.BAD_INPUT, "task", "score", own, "--task", TASK, message="own.toml")
        self.expect_error(cli.BAD_INPUT, "records", "list", "--records", own, message="own.toml")
        self.expect_error(cli.BAD_INPUT, "records", "list", "--records", self.folder / "none.db", message="none.db")
        self.expect_error(cli.BAD_INPUT, "task", "score", run, "--task", TASK, "--record", "a\nb", "--records", self.folder / "r.db",
                          message="pseudonym")
        self.expect_error(cli.USAGE, "task", "score", run, "--task", TASK, "--records", own, message="--record")
        self.expect_error(cli.USAGE, "task", "scor", run, message="score")

    @cli.long
    def test_each_novice_model_fails_its_own_metric(self):
        # few seeds, for every run of the tests; trainees.py does twenty of every task
        aucs, _ = trainees.aucs_of(TASK, 3, pathlib.Path(self.folder), 2, f"knee-phantom:spacing={cli.KNEE_MM}")
        self.assertEqual(trainees.faults_of(TASK, aucs), [])


if __name__ == "__main__":
    cli.share_prepared_models()
    cli.main()
