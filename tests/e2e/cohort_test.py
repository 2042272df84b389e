"""Many studies: a row for each, the same on this machine's cores and by Slurm, whatever breaks or is killed."""

import json
import os
import pathlib
import re
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
        self.assertIn(f"{CASES - 2} of {CASES} cases are done already", again.stderr)
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
                self.skipTest(f"by Slurm needs {why}")

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
        # nothing of it goes on
        time.sleep(0.3)
        self.assertEqual(self.processes_of(out), [])
        done = len(list(out.rglob("result.json")))
        self.assertLess(done, CASES, "it was killed before the end")
        _, again = self.cohort(out.name, "--jobs", 2)
        self.assertIn("done already", again.stderr)
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
        self.fail_clearly(cli.BAD_INPUT, "cohort", self.folder / "none.tsv", "-o", out, says="none.tsv")
        self.table.write_text("study\tcolour\n")
        self.fail_clearly(cli.BAD_INPUT, "cohort", self.table, "-o", out, says="cases.tsv:1")
        self.assertFalse(out.exists())
        self.table.write_text("study\nknee-phantom\n")
        self.fail_clearly(cli.USAGE, "cohort", self.table, "-o", out, "--sbatch=--mem=1G", says="--engine slurm")
        self.fail_clearly(cli.UNAVAILABLE, "cohort", self.table, "-o", out, "--engine", "slurm", says="Slurm",
                          env=dict(os.environ, PATH="/nowhere"))
        (self.folder / "file").write_text("")
        self.fail_clearly(cli.OUTPUT, "cohort", self.table, "-o", self.folder / "file")

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
        os.kill(int(inside[0]), signal.SIGSEGV)
        said, _ = process.communicate(timeout=300)
        self.assertEqual(process.returncode, cli.LIMIT)
        self.assertIn("case long (line 2) failed: its process was ended by a signal, SIGSEGV", said)
        self.assertEqual(rows(out / "cohort.tsv")["short"]["state"], "done")
        result = json.loads((out / "cases" / "0001" / "result.json").read_text())
        self.assertTrue(re.fullmatch("[0-9a-f]{64}", result["key"]))


if __name__ == "__main__":
    cli.main()
