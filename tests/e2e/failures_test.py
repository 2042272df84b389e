"""Interrupt, full disk, unwritable folder, missing file at every verb: a clear message, the exit code, and
nothing half-written but a recording that reopens."""

import os
import pathlib
import pty
import resource
import signal
import subprocess
import tempfile
import time
import unittest

import cli


def press_script(holds):
    """A script that presses the femur and then holds for so many times 30 s (0: for a moment)."""
    hold = "[[step]]\nhold = 30.0\n" * holds or "[[step]]\nhold = 0.6\n"
    return f'[[step]]\napproach = "femur"\n[[step]]\npress = 0.8\n{hold}[[step]]\nleave = true\n'


class Failures(cli.PalpateTest):
    @classmethod
    def setUpClass(cls):
        # one small knee, its scene and a recording serve every verb
        cls._made = tempfile.TemporaryDirectory(prefix="palpate-e2e-")
        made = cls.made = pathlib.Path(cls._made.name)
        for arguments in (["data", "fetch", "knee-phantom", "-o", made / "knee", "--voxel", "1.5"],):
            assert cli.run(*arguments).returncode == 0, arguments
        cls.labels = next((made / "knee").glob("*.seg.nrrd"))
        cls.scan = next(p for p in (made / "knee").glob("*.nrrd") if p != cls.labels)
        cls.scene, cls.script = made / "scene.toml", made / "press.toml"
        assert cli.run("scene", "new", cls.scan, cls.labels, "-o", cls.scene).returncode == 0
        cls.script.write_text(press_script(0))
        cls.long_script = made / "long.toml"
        cls.long_script.write_text(press_script(100))
        cls.recording = made / "run.h5"
        done = cli.run("simulate", cls.scene, "--script", cls.script, "-o", cls.recording)
        assert done.returncode == 0, done.stderr

    @classmethod
    def tearDownClass(cls):
        cls._made.cleanup()

    def writing_verbs(self, output):
        """Every verb that writes, writing to `output`."""
        return {
            "data": ["data", "fetch", "knee-phantom", "--voxel", "2", "-o", output],
            "scene": ["scene", "new", self.scan, self.labels, "-o", output],
            "prepare": ["prepare", self.labels, "-o", pathlib.Path(f"{output}.nrrd")],
            "simulate": ["simulate", self.scene, "--script", self.script, "-o", pathlib.Path(f"{output}.h5")],
            "report": ["report", self.recording, self.scene, "-o", pathlib.Path(f"{output}.html")],
            "verify": ["verify", "accuracy", "--json", pathlib.Path(f"{output}.json")],
        }

    def test_missing_files(self):
        missing = self.folder / "missing.nrrd"
        for arguments in (["info", missing], ["scene", "new", missing, self.labels, "-o", self.folder / "s.toml"],
                          ["scene", "check", missing], ["prepare", missing, "-o", self.folder / "f.nrrd"],
                          ["simulate", self.folder / "missing.toml"], ["replay", missing], ["report", missing]):
            with self.subTest(arguments[0]):
                self.fail_clearly(cli.BAD_INPUT, *arguments, says="missing")
        self.assertEqual(list(self.folder.iterdir()), [])

    def test_unknown_names(self):
        self.fail_clearly(cli.BAD_INPUT, "simulate", "knee-atlass", says="palpate data list")
        self.fail_clearly(cli.BAD_INPUT, "data", "fetch", "elbow", says="knee-atlas")
        self.fail_clearly(cli.USAGE, "verify", "beauty", says="accuracy")
        for arguments in ([], ["feel"], ["simulate"], ["simulate", "knee-phantom", "--max-force", "1000"]):
            with self.subTest(arguments):
                self.fail_clearly(cli.USAGE, *arguments)

    def test_a_folder_that_does_not_exist(self):
        for verb, arguments in self.writing_verbs(self.folder / "missing" / "out").items():
            if verb == "data":
                continue  # it makes the folder it is given
            with self.subTest(verb):
                self.fail_clearly(cli.OUTPUT, *arguments, says="missing")
        self.assertEqual(list(self.folder.iterdir()), [])

    def test_a_file_in_place_of_a_folder(self):
        (self.folder / "file").write_text("")
        for verb, arguments in self.writing_verbs(self.folder / "file" / "out").items():
            with self.subTest(verb):
                self.fail_clearly(cli.OUTPUT, *arguments)
        self.assertEqual([p.name for p in self.folder.iterdir()], ["file"])

    @unittest.skipIf(os.geteuid() == 0 and not pathlib.Path("/usr/bin/setpriv").exists(), "root may write anywhere")
    def test_an_unwritable_folder(self):
        locked = self.folder / "locked"
        locked.mkdir()
        locked.chmod(0o555)
        self.folder.chmod(0o755)
        self.made.chmod(0o755)
        # root may write anywhere: run as nobody
        as_nobody = ["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"] if os.geteuid() == 0 else []
        for verb, arguments in self.writing_verbs(locked / "out").items():
            with self.subTest(verb):
                done = subprocess.run([*as_nobody, cli.PALPATE, *map(str, arguments)], capture_output=True, text=True,
                                      stdin=subprocess.DEVNULL, timeout=600, env=dict(os.environ, HOME="/nonexistent"))
                if as_nobody and "Permission denied" in done.stderr and "setpriv" in done.stderr:
                    self.skipTest("nobody may not run the binary here")
                self.assertEqual(done.returncode, cli.OUTPUT, done.stderr)
                self.assertIn("ermission", done.stderr)
        self.assertEqual(list(locked.iterdir()), [])

    def test_a_full_disk(self):
        # a limit on file sizes stands in for it: writes fail half-way
        def limited():
            resource.setrlimit(resource.RLIMIT_FSIZE, (600, resource.RLIM_INFINITY))

        for verb, arguments in self.writing_verbs(self.folder / "out").items():
            with self.subTest(verb):
                self.fail_clearly(cli.OUTPUT, *arguments, preexec_fn=limited)
        left = [p for p in self.folder.rglob("*") if p.is_file() and p.suffix not in (".h5",)]
        self.assertEqual(left, [])

    def test_a_disk_that_fills_during_a_recording(self):
        def limited():
            resource.setrlimit(resource.RLIMIT_FSIZE, (1_500_000, resource.RLIM_INFINITY))

        recording = self.folder / "run.h5"
        self.fail_clearly(cli.OUTPUT, "simulate", self.scene, "--script", self.long_script, "-o", recording,
                          preexec_fn=limited)
        again = self.succeed("replay", recording, self.scene)
        self.assertIn("cut short", again.stdout)

    def interrupt(self, arguments, growing=None, number=signal.SIGINT):
        """Signals palpate in the middle of its work: when the file `growing` has content, else after 0.4 s."""
        process = subprocess.Popen([cli.PALPATE, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                   stdin=subprocess.DEVNULL, text=True)
        if growing:
            while process.poll() is None and not (growing.exists() and growing.stat().st_size > 50_000):
                time.sleep(0.01)
        else:
            time.sleep(0.4)
        process.send_signal(number)
        out, err = process.communicate(timeout=120)
        return process.returncode, out, err

    def test_interrupts(self):
        large = self.made / "large"
        self.succeed("data", "fetch", "knee-phantom", "-o", large, "--voxel", "0.4")
        labels = next(large.glob("*.seg.nrrd"))
        recording = self.folder / "run.h5"
        # each of these works for seconds
        cases = {
            "data": (["data", "fetch", "knee-phantom", "--voxel", "0.25", "-o", self.folder / "out"], None),
            "prepare": (["prepare", labels, "--sigma", "8", "--engine", "fourier", "-o", self.folder / "f.nrrd"], None),
            "simulate": (["simulate", self.scene, "--script", self.long_script, "-o", recording], recording),
            "verify": (["verify", "accuracy", "--json", self.folder / "v.json"], None),
        }
        for verb, (arguments, growing) in cases.items():
            with self.subTest(verb):
                code, _, err = self.interrupt(arguments, growing)
                self.assertEqual(code, cli.INTERRUPTED, err)
                self.assertIn("interrupted", err)
        self.assertIn("identical", self.succeed("replay", recording, self.scene).stdout)
        left = sorted(p.name for p in self.folder.rglob("*") if p.is_file())
        self.assertEqual(left, ["run.h5"])

    def test_killed_while_recording(self):
        recording = self.folder / "run.h5"
        code, _, _ = self.interrupt(["simulate", self.scene, "--script", self.long_script, "-o", recording], recording,
                                    signal.SIGKILL)
        self.assertEqual(code, -signal.SIGKILL)
        self.assertIn("cut short", self.succeed("replay", recording, self.scene).stdout)

    def test_progress_is_shown_on_a_terminal_and_quiet_is_quiet(self):
        def stderr_on_a_terminal(*options):
            master, slave = pty.openpty()
            process = subprocess.Popen([cli.PALPATE, *options, "simulate", str(self.scene), "--script", str(self.script)],
                                       stdout=subprocess.DEVNULL, stderr=slave, stdin=subprocess.DEVNULL)
            os.close(slave)
            shown = b""
            while True:
                try:
                    piece = os.read(master, 4096)
                except OSError:
                    break
                if not piece:
                    break
                shown += piece
            process.wait()
            os.close(master)
            return shown

        self.assertIn(b"%", stderr_on_a_terminal())
        self.assertEqual(stderr_on_a_terminal("-q"), b"")

    def test_garbage_in_every_file(self):
        garbage = self.folder / "garbage"
        garbage.write_bytes(os.urandom(5000))
        for ending in (".nrrd", ".nii.gz", ".mha", ".toml", ".h5", ".ctbl"):
            (self.folder / f"garbage{ending}").write_bytes(garbage.read_bytes())
        for arguments in (["info", self.folder / "garbage.nrrd"], ["info", self.folder / "garbage.nii.gz"],
                          ["info", self.folder / "garbage.mha"], ["simulate", self.folder / "garbage.toml"],
                          ["simulate", self.scene, "--script", self.folder / "garbage.toml"],
                          ["replay", self.folder / "garbage.h5"], ["report", self.folder / "garbage.h5"],
                          ["info", self.labels, "--names", self.folder / "garbage.ctbl"]):
            with self.subTest(arguments):
                self.fail_clearly(cli.BAD_INPUT, *arguments)


if __name__ == "__main__":
    cli.main()
