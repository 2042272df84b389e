"""Many studies: a row for each, the same on this machine's cores and by Slurm, whatever breaks or is killed."""

import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import tempfile
import time

import cli
import one_node_slurm

# PALPATE_COHORT=12 works on all of them; without it on as many as show everything
CASES = int(os.environ.get("PALPATE_COHORT", "4"))
# generated knees: sides, spacings, seeds
KNEES = ["side=left,spacing=3,seed=1", "side=right,spacing=2.5,seed=2", "side=left,spacing=2.5,seed=3", "side=right,spacing=3,seed=4",
         "side=left,spacing=2,seed=5", "side=right,spacing=3,seed=6", "side=left,spacing=3,seed=7", "side=right,spacing=2,seed=8",
         "side=left,spacing=2.5,seed=9", "side=right,spacing=2.5,seed=10"]
# whoever has no femoral cartilage is touched on the bone alone
SCRIPT = ('[[step]]\napproach = "femur"\nspeed = 200.0\n[[step]]\npress = 0.8\n[[step]]\nhold = 0.3\n[[step]]\nleave = true\n'
          '[[step]]\napproach = "femoral_cartilage"\nspeed = 200.0\n[[step]]\npress = 0.5\n[[step]]\nhold = 0.3\n[[step]]\nleave = true\n')


def rows(path):
    head, *lines = path.read_text().splitlines()
    return {line.split("\t")[0]: dict(zip(head.split("\t"), line.split("\t"))) for line in lines}


class Cohort(cli.PalpateTest):
    def setUp(self):
        super().setUp()
        self.data = self.folder / "DOE^CANARY"
        self.data.mkdir()
        (self.data / "script.toml").write_text(SCRIPT)
        # a label map of the user's own, damaged
        (self.data / "doe_canary_labels.nrrd").write_text("NRRD0005\ntype: uchar\ndimension: 3\nsizes: 4 4 4\nencoding: raw\n\nxy")
        lines = ["case\tstudy\tscript"]
        for n, knee in enumerate(KNEES[:CASES - 2]):
            lines.append(f"knee {n + 1}\tknee-phantom:{knee}\tscript.toml")
        lines.append("broken\tdoe_canary_labels.nrrd\tscript.toml")
        lines.append("bare\tknee-phantom:spacing=3,missing=femoral_cartilage\tscript.toml")
        self.table = self.data / "cases.tsv"
        self.table.write_text("\n".join(lines) + "\n")

    def cohort(self, name, *options, code=cli.LIMIT, **more):
        out = self.folder / name
        done = cli.run("cohort", self.table, "-o", out, *options, **more)
        self.assertEqual(done.returncode, code, done.stdout + done.stderr)
        return out, done

    @cli.long
    def test_one_after_the_other_killed_and_by_slurm_it_is_the_same_table(self):
        out, done = self.cohort("local", "--jobs", 2)
        table = rows(out / "cohort.tsv")
        self.assertEqual(len(table), CASES)
        # the broken one is named, and stops nobody
        self.assertIn(f"{CASES - 2} of {CASES} cases done", done.stdout)
        self.assertRegex(done.stdout, r"case broken \(line \d+\) failed: the voxel data end")
        self.assertEqual(table["broken"]["state"], "failed")
        self.assertEqual(table["bare"]["state"], "failed")
        self.assertIn("femoral_cartilage", table["bare"]["fault"])
        self.assertEqual(table["bare"]["femoral_cartilage:volume_mm3"], "")
        self.assertGreater(float(table["bare"]["femur:volume_mm3"]), 50000)
        for name, row in table.items():
            if not name.startswith("knee"):
                continue
            self.assertEqual((row["state"], row["palpated"], row["held"], row["failed_steps"]), ("done", "2", "2", "0"), name)
            self.assertAlmostEqual(float(row["femur:mean_force_N"]), 0.8, delta=0.2)
            self.assertGreater(float(row["femoral_cartilage:thinnest_mm"]), 0)
            self.assertRegex(row["run_hash"], "^[0-9a-f]{16}$")
        # the run is the one that simulate makes
        alone = self.succeed("simulate", f"knee-phantom:{KNEES[0]}", "--script", self.data / "script.toml")
        self.assertEqual(cli.run_hash(alone.stdout), table["knee 1"]["run_hash"])
        page = (out / "index.html").read_text()
        self.assertEqual(page.count("data:image/png"), CASES - 1)
        times = rows(out / "times.tsv")
        self.assertGreater(float(times["knee 1"]["palpate_s"]), 0)
        # nothing of a patient
        for path in [p for p in out.rglob("*") if p.is_file()]:
            self.assertNotIn(b"canary", path.read_bytes().lower(), path.name)
        self.assertEqual([p for p in out.rglob(".*")], [], "nothing half-written")

        # the same again does what failed, and nothing else
        before = {p: p.stat().st_mtime_ns for p in out.rglob("result.json")}
        text = (out / "cohort.tsv").read_bytes()
        _, again = self.cohort("local", "--jobs", 2)
        self.assertIn(f"{CASES - 2} of {CASES} cases are already done", again.stderr)
        self.assertEqual(sum(p.stat().st_mtime_ns != t for p, t in before.items()), 2)
        self.assertEqual((out / "cohort.tsv").read_bytes(), text)

        killed = self.killed_halfway(signal.SIGKILL)
        self.assertEqual((killed / "cohort.tsv").read_bytes(), text, "killed and gone on with")
        stopped = self.killed_halfway(signal.SIGINT)
        self.assertEqual((stopped / "cohort.tsv").read_bytes(), text, "interrupted and gone on with")

        # by Slurm
        with tempfile.TemporaryDirectory(prefix="palpate-slurm-") as place:
            try:
                with one_node_slurm.slurm(place) as environment:
                    slurm, done = self.cohort("slurm", "--engine", "slurm", env=environment)
                    self.assertEqual((slurm / "cohort.tsv").read_bytes(), text, "by Slurm")
                    self.assertIn("case broken", done.stdout)
                    self.assertFalse((slurm / "slurm-job").exists())
                    # what Slurm refuses is said in its words
                    refused = cli.run("cohort", self.table, "-o", self.folder / "refused", "--engine", "slurm",
                                      "--sbatch=--partition=none-such", env=environment)
                    self.assertEqual(refused.returncode, cli.UNAVAILABLE, refused.stderr)
                    self.assertIn("Slurm refuses the job", refused.stderr)
            except one_node_slurm.CannotStart as why:
                cli.missing(f"by Slurm: {why}")

    def killed_halfway(self, how):
        """The folder of a cohort that was ended by a signal when its first case was done, and gone on with."""
        out = self.folder / f"signal-{how}"
        process = subprocess.Popen([cli.PALPATE, "cohort", str(self.table), "-o", str(out), "--jobs", "1"],
                                   stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        first = out / "cases" / "0001" / "result.json"
        end = time.monotonic() + 300
        while not first.exists() and process.poll() is None and time.monotonic() < end:
            time.sleep(0.005)
        process.send_signal(how)
        said = process.communicate(timeout=60)[1]
        self.assertEqual(process.returncode, cli.INTERRUPTED if how == signal.SIGINT else -how, said)
        # nothing of it goes on: they end with it, as soon as the system comes to it
        end = time.monotonic() + 30
        while self.processes_of(out) and time.monotonic() < end:
            time.sleep(0.01)
        self.assertEqual(self.processes_of(out), [])
        done = len(list(out.rglob("result.json")))
        self.assertLess(done, CASES, "it was killed before the end")
        _, again = self.cohort(out.name, "--jobs", 2)
        self.assertIn("already done", again.stderr)
        return out

    def processes_of(self, out):
        found = []
        for entry in pathlib.Path("/proc").iterdir():
            try:
                if entry.name.isdigit() and str(out).encode() in (entry / "cmdline").read_bytes():
                    found.append((entry.name, (entry / "cmdline").read_bytes()))
            except OSError:
                pass
        return found

    def test_what_cannot_be_done_is_one_error(self):
        out = self.folder / "out"
        self.expect_error(cli.BAD_INPUT, "cohort", self.folder / "none.tsv", "-o", out, message="none.tsv")
        self.table.write_text("study\tcolour\n")
        self.expect_error(cli.BAD_INPUT, "cohort", self.table, "-o", out, message="cases.tsv:1")
        self.assertFalse(out.exists())
        self.table.write_text("study\nknee-phantom\n")
        self.expect_error(cli.USAGE, "cohort", self.table, "-o", out, "--sbatch=--mem=1G", message="--engine slurm")
        self.expect_error(cli.UNAVAILABLE, "cohort", self.table, "-o", out, "--engine", "slurm", message="Slurm",
                          env=dict(os.environ, PATH="/nowhere"))
        # nothing of the user's is replaced, and no result is put among the data
        named = self.folder / "cohort.tsv"
        named.write_text("study\nknee-phantom\n")
        self.expect_error(cli.USAGE, "cohort", named, "-o", self.folder, message="cohort.tsv")
        self.assertEqual(named.read_text(), "study\nknee-phantom\n")
        study = self.folder / "study"
        study.mkdir()
        (study / "a").write_text("x")
        self.table.write_text(f"study\n{study}\n")
        self.expect_error(cli.USAGE, "cohort", self.table, "-o", study / "results", message="inside a folder that is read as a study")
        self.assertFalse((study / "results").exists())
        self.table.write_text(f"study\n{study / 'a'}\n")
        self.expect_error(cli.USAGE, "cohort", self.table, "-o", study, message="holds data; tables next to labels")
        self.table.write_text("study\nknee-phantom\n")
        (self.folder / "file").write_text("")
        self.expect_error(cli.OUTPUT, "cohort", self.table, "-o", self.folder / "file")

    def test_names_of_files_that_a_case_only_leads_to_are_told_to_nobody(self):
        # labels that a scene names, data that a header names, a table beside them, a name that cannot be printed
        (self.data / "scene.toml").write_text('title = "a scene"\nlabels = "doe canary.nrrd"\n')
        (self.data / "doe canary.nrrd").write_text("NRRD0005\ntype: uchar\n")
        (self.data / "lost.nhdr").write_text("NRRD0005\ntype: uchar\ndimension: 3\nsizes: 4 4 4\nencoding: raw\n"
                                             "data file: canary of doe.bin\n\n")
        (self.data / "canary\n7.ctbl").write_text("nothing\n")
        whole = self.data / "canary8.nrrd"
        whole.write_bytes(b"NRRD0005\ntype: uchar\ndimension: 3\nsizes: 20 20 20\nencoding: raw\nspace: left-posterior-superior\n"
                          b"space directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (0,0,0)\n\n"
                          + bytes(6 < i < 13 and 6 < j < 13 and 6 < k < 13 for k in range(20) for j in range(20) for i in range(20)))
        for table in self.data.glob("*.tsv"):
            table.unlink()
        self.table = self.folder / "canary cases.tsv"
        self.table.write_text("study\nDOE^CANARY/scene.toml\nDOE^CANARY/lost.nhdr\nDOE^CANARY/canary8.nrrd\n")
        out, done = self.cohort("canary out")
        table = rows(out / "cohort.tsv")
        self.assertIn("data file", table["2"]["fault"])
        self.assertTrue(all(row["fault"] for name, row in table.items() if name != "3"), table)
        for path in [p for p in out.rglob("*") if p.is_file()]:
            self.assertNotIn(b"canary", path.read_bytes().lower(), path.name)
            self.assertNotIn(b"doe", re.sub(rb"\bdoes\b|base64,[^\"]*", b"", path.read_bytes().lower()), path.name)

        # what can leave no result says why all the same
        shutil.rmtree(out / "cases" / "0001")
        (out / "cases" / "0001").write_text("in the way")
        _, done = self.cohort("canary out")
        self.assertRegex(done.stdout, r"case 1 \(line 2\) failed: its process ended with exit code 4: .+")
        self.assertNotIn("canary", (out / "cohort.tsv").read_text())
        self.assertEqual(rows(out / "cohort.tsv")["1"]["state"], "failed")

    def test_a_recording_that_is_missing_and_other_options_are_not_done(self):
        self.table.write_text("case\tstudy\tscript\nshort\tknee-phantom:spacing=3\tscript.toml\n")
        (self.data / "script.toml").write_text(cli.TOUCH)
        out, _ = self.cohort("out", code=cli.OK)
        again = self.cohort("out", code=cli.OK)[1]
        self.assertIn("1 of 1 cases are already done", again.stderr)
        self.assertNotIn("already done", self.cohort("out", "--recordings", code=cli.OK)[1].stderr)
        self.assertTrue((out / "cases" / "0001" / "run.h5").is_file())
        self.assertIn("already done", self.cohort("out", "--recordings", code=cli.OK)[1].stderr)
        before = (out / "cases" / "0001" / "result.json").stat().st_mtime_ns
        # the process of a case that is done does nothing
        self.succeed("cohort", self.table, "-o", out, "--case", 1)
        self.assertEqual((out / "cases" / "0001" / "result.json").stat().st_mtime_ns, before)
        done = cli.run("--mesh-space", "ras", "cohort", self.table, "-o", out)
        self.assertEqual(done.returncode, cli.OK, done.stderr)
        self.assertNotIn("already done", done.stderr)

    @cli.long
    def test_a_case_that_crashes_is_named(self):
        # its process is killed from outside while it works
        self.table.write_text("case\tstudy\nlong\tknee-phantom:spacing=1\nshort\tknee-phantom:spacing=3\n")
        out = self.folder / "out"
        process = subprocess.Popen([cli.PALPATE, "cohort", str(self.table), "-o", str(out), "--jobs", "1"],
                                   stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        end = time.monotonic() + 60
        inside = []
        while not inside and process.poll() is None and time.monotonic() < end:
            inside = [number for number, line in self.processes_of(out)
                      if b"--inside" in line and line.endswith(b"--case\x001\x00")]
            time.sleep(0.01)
        # a sanitizer would make its own report of SIGSEGV
        how = signal.SIGKILL if cli.SANITIZED else signal.SIGSEGV
        os.kill(int(inside[0]), how)
        said, _ = process.communicate(timeout=300)
        self.assertEqual(process.returncode, cli.LIMIT)
        self.assertIn(f"case long (line 2) failed: its process was ended by a signal, {how.name}", said)
        self.assertEqual(rows(out / "cohort.tsv")["short"]["state"], "done")
        result = json.loads((out / "cases" / "0001" / "result.json").read_text())
        self.assertTrue(re.fullmatch("[0-9a-f]{64}", result["key"]))


if __name__ == "__main__":
    cli.share_prepared_models()
    cli.main()
