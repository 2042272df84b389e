"""Interrupt, full disk, unwritable folder, missing file at every verb: a clear message, the exit code, and
nothing half-written but a recording that reopens."""

import fcntl
import os
import pathlib
import pty
import resource
import shutil
import signal
import struct
import subprocess
import tempfile
import termios
import time

import cli


def press_script(holds):
    """A script that presses the femur and then holds for so many times 30 s (0: for a moment)."""
    hold = "[[step]]\nhold = 30.0\n" * holds or "[[step]]\nhold = 0.6\n"
    return f'[[step]]\napproach = "femur"\n[[step]]\npress = 0.8\n{hold}[[step]]\nleave = true\n'


def write_blocks(path):
    """A scan of 400 x 400 x 400 voxels, half of them 255, half 0: much work for `prepare`, none to make."""
    head = ("NRRD0005\ntype: uint8\ndimension: 3\nspace: left-posterior-superior\nsizes: 400 400 400\n"
            "space directions: (0.4,0,0) (0,0.4,0) (0,0,0.4)\nspace origin: (0,0,0)\nencoding: raw\n\n")
    path.write_bytes(head.encode() + (bytes(200) + b"\xff" * 200) * 400**2)


class Failures(cli.PalpateTest):
    @classmethod
    def setUpClass(cls):
        # one small knee, its scene and a recording serve every verb
        cls._made = tempfile.TemporaryDirectory(prefix="palpate-e2e-")
        made = cls.made = pathlib.Path(cls._made.name)
        assert cli.run("data", "fetch", "knee-phantom", "-o", made / "knee", "--voxel", cli.KNEE_MM).returncode == 0
        cls.labels = next((made / "knee").glob("*.seg.nrrd"))
        cls.scan = next(p for p in (made / "knee").glob("*.nrrd") if p != cls.labels)
        cls.scene, cls.script = made / "scene.toml", made / "press.toml"
        assert cli.run("scene", "new", cls.scan, cls.labels, "-o", cls.scene).returncode == 0
        cls.script.write_text(press_script(0))
        # one small structure is soon palpated
        cls.patella = made / "patella.toml"
        cls.patella.write_text(f'[data]\nlabels = "{cls.labels}"\n[[tissue]]\nname = "bone"\npreset = "bone"\n'
                               'labels = ["patella"]\n')
        cls.long_script = made / "long.toml"
        cls.long_script.write_text(press_script(100))
        cls.recording = made / "run.h5"
        done = cli.run("simulate", cls.scene, "--script", cls.script, "-o", cls.recording)
        assert done.returncode == 0, done.stderr

    @classmethod
    def tearDownClass(cls):
        cls._made.cleanup()

    def test_a_signal_ends_what_waits_for_others(self):
        # a reader that does not read: the pipe is full, and writing waits
        for number in (signal.SIGTERM, signal.SIGINT):
            reader, writer = os.pipe()
            fcntl.fcntl(writer, fcntl.F_SETPIPE_SZ, 4096)
            with subprocess.Popen([cli.PALPATE, "data", "keys"], stdin=subprocess.DEVNULL, stdout=writer,
                                  stderr=subprocess.PIPE, text=True) as waiting:
                os.close(writer)
                while struct.unpack("i", fcntl.ioctl(reader, termios.FIONREAD, bytes(4)))[0] < 4096:
                    self.assertIsNone(waiting.poll())
                    time.sleep(0.01)
                waiting.send_signal(number)
                _, said = waiting.communicate(timeout=300)
                self.assertEqual(waiting.returncode, cli.INTERRUPTED)
                self.assertIn("interrupted", said)
            os.close(reader)

    def test_signals_end_a_recording_that_is_shown(self):
        plan, task = self.folder / "plan.toml", self.folder / "task.toml"
        plan.write_text('title = "p"\n[[trajectory]]\nname = "t"\nentry = [0, 0, 0]\ntarget = [0, 0, 9]\n')
        task.write_text('title = "t"\n[[region]]\nname = "r"\nstructures = ["patella"]\n[[step]]\nname = "s"\nregion = "r"\n[[metric]]\nname = "time"\n')
        for number, beside in ((signal.SIGTERM, []), (signal.SIGINT, ["--plan", plan, "--task", task])):
            with subprocess.Popen([cli.PALPATE, "replay", self.recording, self.scene, "--view", "--port", "0", *beside], stdin=subprocess.DEVNULL,
                                  stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as shown:
                told = ""
                while "Ctrl-C ends it" not in told:
                    line = shown.stderr.readline()
                    self.assertTrue(line, told)
                    told += line
                shown.send_signal(number)
                _, rest = shown.communicate(timeout=300)
                self.assertEqual(shown.returncode, cli.OK, told + rest)

    def test_where_no_thread_is_to_be_had_it_says_so(self):
        # each would need more stack than there is memory
        self.expect_error(cli.UNAVAILABLE, "data", "keys", message="cannot start a thread",
                          runner=cli.spawn, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_STACK, (1 << 46, 1 << 46)))

    def writing_verbs(self, output):
        """Every verb that writes, writing to `output`."""
        return {
            "data": ["data", "fetch", "knee-phantom", "--voxel", "2", "-o", output],
            "scene": ["scene", "new", self.scan, self.labels, "-o", output],
            "prepare": ["prepare", self.labels, "-o", pathlib.Path(f"{output}.nrrd")],
            "simulate": ["simulate", self.scene, "--script", self.script, "-o", pathlib.Path(f"{output}.h5")],
            "report": ["report", self.recording, self.scene, "-o", pathlib.Path(f"{output}.html")],
            "export": ["export", self.recording, self.scene, "-o", pathlib.Path(f"{output}.seg.nrrd")],
            "forces": ["forces", self.scene, "-o", pathlib.Path(f"{output}.svg")],
            "verify": ["verify", "latency", "--seconds", "0.05", "--rate", "1000", "--scene", self.patella, "--json",
                       pathlib.Path(f"{output}.json")],
        }

    def test_missing_files(self):
        missing = self.folder / "missing.nrrd"
        for arguments in (["info", missing], ["scene", "new", missing, self.labels, "-o", self.folder / "s.toml"],
                          ["scene", "check", missing], ["prepare", missing, "-o", self.folder / "f.nrrd"],
                          ["simulate", self.folder / "missing.toml"], ["replay", missing], ["report", missing],
                          ["export", missing, "-o", self.folder / "left.nrrd"]):
            with self.subTest(arguments[0]):
                self.expect_error(cli.BAD_INPUT, *arguments, message="missing")
        self.assertEqual(list(self.folder.iterdir()), [])

    def test_unknown_names(self):
        self.expect_error(cli.BAD_INPUT, "simulate", "knee-atlass", message="palpate data list")
        self.expect_error(cli.BAD_INPUT, "data", "fetch", "elbow", message="knee-atlas")
        self.expect_error(cli.USAGE, "verify", "beauty", message="accuracy")
        for arguments in ([], ["feel"], ["simulate"], ["simulate", "knee-phantom", "--max-force", "1000"]):
            with self.subTest(arguments):
                self.expect_error(cli.USAGE, *arguments)

    def test_unknown_words_are_named(self):
        for arguments, says in ((["simulat", "x"], "simulat: unknown verb\n  did you mean simulate?"),
                                (["--frob"], "--frob: unknown option"), (["frob", "--help"], "frob: unknown verb"),
                                (["data", "fetc", "head"], "fetc: unknown verb\n  did you mean fetch?"),
                                (["data"], "palpate data needs a verb"), ([], "palpate needs a verb"),
                                (["simulate", "--max-forc", "3", "x"], "did you mean --max-force?"),
                                (["-q", "info", "a", "b"], "b: unexpected argument")):
            with self.subTest(arguments):
                self.expect_error(cli.USAGE, *arguments, message=says)
        # where the mistake comes after a verb, help on it is what was asked for
        self.assertIn("--max-force", self.succeed("simulate", "--frob", "--help").stdout)

    def test_numbers_out_of_range(self):
        field = self.folder / "f.nrrd"
        for arguments in (["simulate", self.scene, "--max-force"], ["simulate", self.scene, "--rate"],
                          ["simulate", self.scene, "--seed"], ["prepare", self.labels, "-o", field, "--sigma"],
                          ["prepare", self.labels, "-o", field, "--threads"],
                          ["prepare", self.scan, "-o", field, "--threshold"],
                          ["data", "fetch", "knee-phantom", "-o", self.folder / "out", "--voxel"]):
            for value in ("nan", "-nan", "inf", "1e300", "-1e10", " ", "1,5", "0x", "18446744073709551617"):
                with self.subTest(arguments[-2:], value=value):
                    self.expect_error(cli.USAGE, *arguments, value, message="number between")
        self.expect_error(cli.USAGE, "simulate", self.scene, "--seed", "-1", message="between 0 and 9007199254740991")
        self.assertEqual(list(self.folder.iterdir()), [])

    def test_prepare_says_what_it_cannot_do(self):
        field = self.folder / "f.nrrd"
        self.expect_error(cli.USAGE, "prepare", self.scene, "-o", field, "--compare", message="--compare")
        done = self.expect_error(cli.USAGE, "prepare", self.scene, "-o", field, "--sigma", "2", message="--sigma")
        # the keys that it names are keys
        keys = self.succeed("scene", "keys").stdout
        for key in ("sigma", "engine", "bits"):
            self.assertIn(key, done.stderr)
            self.assertIn(f"`{key}`", keys)
        self.expect_error(cli.USAGE, "prepare", self.labels, "-o", self.folder / "f.Seg.nrrd", message="segmentation")
        self.assertEqual(list(self.folder.iterdir()), [])

    def test_outputs_do_not_replace_inputs(self):
        inputs = {}
        for path in (self.labels, self.scan, self.scene, self.script, self.recording):
            inputs[path.suffixes[-1] + path.stem] = copy = self.folder / path.name
            shutil.copy(path, copy)
        labels, scan, scene, script, recording = inputs.values()
        scene.write_text(scene.read_text().replace(str(self.made), str(self.folder)).replace("knee/", ""))
        self.succeed("scene", "check", scene)
        link = self.folder / "link.nrrd"
        link.symlink_to(labels.name)
        before = {path: path.read_bytes() for path in inputs.values()}
        for arguments in (["prepare", scan, "-o", scan, "--threshold", "0", "1"], ["prepare", scene, "-o", link],
                          ["prepare", scene, "-o", scan], ["simulate", scene, "-o", scene],
                          ["simulate", scene, "--report", scene], ["simulate", scene, "-o", scan],
                          ["simulate", scene, "-o", self.folder / "r.h5", "--report", labels],
                          ["simulate", scene, "-s", script, "-o", script],
                          ["simulate", scene, "-s", script, "--report", script],
                          ["report", recording, scene, "-o", scene], ["report", recording, scene, "-o", recording],
                          ["report", recording, scene, "-o", self.folder / "." / scan.name]):
            with self.subTest(arguments):
                self.expect_error(cli.USAGE, *arguments, message="would replace an input")
        self.assertEqual({path: path.read_bytes() for path in inputs.values()}, before)
        self.assertEqual({p for p in self.folder.iterdir()}, {link, *inputs.values()})

    def test_the_files_of_a_data_set_are_inputs(self):
        atlas = self.folder / "knee_spl"
        shutil.copytree(cli.need("knee_spl/seg.nrrd").parent, atlas)
        self.expect_error(cli.USAGE, "simulate", "knee-atlas", "-o", atlas / "seg.nrrd", message="would replace an input",
                          env=dict(os.environ, PALPATE_DATA=str(self.folder)))

    def test_two_outputs_are_two_files(self):
        run, link = self.folder / "run.html", self.folder / "link"
        link.symlink_to(run.name)
        for arguments in (["-o", run, "--report", run], ["-o", link, "--report", run],
                          ["--report", self.folder / "run.h5"]):
            with self.subTest(arguments):
                self.expect_error(cli.USAGE, "simulate", self.scene, *arguments, message="would be the same file")
        # a name that nobody gave replaces nothing
        other = self.folder / "run.h5"
        other.write_text("of somebody else")
        self.expect_error(cli.USAGE, "simulate", self.scene, "--report", run, message="name the recording with -o")
        self.assertEqual(other.read_text(), "of somebody else")
        self.assertFalse(run.exists())

    def test_what_a_link_leads_to_is_written(self):
        link, target = self.folder / "link.nrrd", self.folder / "target.nrrd"
        link.symlink_to(target.name)
        self.succeed("prepare", self.labels, "-o", link)
        self.assertTrue(link.is_symlink())
        self.succeed("info", target)

    def test_a_folder_that_does_not_exist(self):
        for verb, arguments in self.writing_verbs(self.folder / "missing" / "out").items():
            if verb == "data":
                continue  # it makes the folder it is given
            with self.subTest(verb):
                self.expect_error(cli.OUTPUT, *arguments, message="missing")
        self.assertEqual(list(self.folder.iterdir()), [])

    def test_a_file_in_place_of_a_folder(self):
        (self.folder / "file").write_text("")
        for verb, arguments in self.writing_verbs(self.folder / "file" / "out").items():
            with self.subTest(verb):
                self.expect_error(cli.OUTPUT, *arguments)
        self.assertEqual([p.name for p in self.folder.iterdir()], ["file"])

    def run_as_nobody(self, *arguments):
        """Runs a copy of palpate that anybody may run, as somebody whom file permissions hold back."""
        self.folder.chmod(0o755)
        self.made.chmod(0o755)
        palpate = self.folder / "palpate"
        if not palpate.exists():
            for program in ("palpate", "palpate-verify"):
                shutil.copy(pathlib.Path(cli.PALPATE).with_name(program), self.folder / program)
                (self.folder / program).chmod(0o755)
        return subprocess.run([*cli.unprivileged_prefix(), palpate, *map(str, arguments)], capture_output=True, text=True,
                              stdin=subprocess.DEVNULL, timeout=600, env=dict(os.environ, HOME="/nonexistent"))

    @cli.long
    def test_an_unwritable_folder(self):
        locked = self.folder / "locked"
        locked.mkdir()
        locked.chmod(0o555)
        for verb, arguments in self.writing_verbs(locked / "out").items():
            with self.subTest(verb):
                done = self.run_as_nobody(*arguments)
                self.assertEqual(done.returncode, cli.OUTPUT, done.stderr)
                self.assertIn("ermission", done.stderr)
        self.assertEqual(list(locked.iterdir()), [])

    @cli.long
    def test_an_unreadable_folder_and_names_that_are_too_long(self):
        locked = self.folder / "locked"
        locked.mkdir()
        (locked / "in.nrrd").write_bytes(self.labels.read_bytes())
        locked.chmod(0)
        for name in (locked / "in", "n" * 300):
            for arguments in (["info", f"{name}.nrrd"], ["info", self.labels, "--names", f"{name}.ctbl"],
                              ["scene", "check", f"{name}.toml"], ["scene", "new", f"{name}.nrrd"],
                              ["prepare", f"{name}.nrrd", "-o", locked.parent / "f.nrrd"],
                              ["simulate", name], ["simulate", f"{name}.toml"],
                              ["simulate", self.scene, "--script", f"{name}.toml"],
                              ["simulate", self.scene, "-o", f"{name}.h5"],
                              ["simulate", self.scene, "--report", f"{name}.html"],
                              ["replay", f"{name}.h5"], ["report", f"{name}.h5"],
                              ["report", self.recording, self.scene, "-o", f"{name}.html"],
                              ["verify", "accuracy", "--json", f"{name}.json"],
                              ["data", "fetch", "knee-phantom", "-o", name]):
                with self.subTest(arguments):
                    done = self.run_as_nobody(*arguments)
                    self.assertIn(done.returncode, (cli.BAD_INPUT, cli.OUTPUT), done.stderr)
                    self.assertEqual(done.stderr.count("palpate: error:"), 1, done.stderr)
                    self.assertNotIn("bug:", done.stderr)
        locked.chmod(0o755)

    @cli.long
    def test_a_lost_standard_output(self):
        for arguments in (["info", self.labels], ["info", self.labels, "--json"], ["data", "list"],
                          ["data", "list", "--json"], ["scene", "keys"], ["task", "keys"], ["scene", "check", self.scene],
                          ["scene", "new", self.labels], ["verify", "--list"], ["--help"], ["--version"],
                          ["prepare", self.labels, "-o", self.folder / "f.nrrd"],
                          ["simulate", self.scene, "--script", self.script], ["replay", self.recording, self.scene]):
            with self.subTest(arguments), open("/dev/full", "w") as full:
                done = subprocess.run([cli.PALPATE, *map(str, arguments)], stdin=subprocess.DEVNULL, stdout=full,
                                      stderr=subprocess.PIPE, text=True, timeout=600)
                self.assertEqual(done.returncode, cli.OUTPUT, done.stderr)
                self.assertIn("standard output", done.stderr)

    @cli.long
    def test_a_full_disk(self):
        # a limit on file sizes stands in for it: writes fail half-way
        def limited():
            resource.setrlimit(resource.RLIMIT_FSIZE, (600, resource.RLIM_INFINITY))

        for verb, arguments in self.writing_verbs(self.folder / "out").items():
            with self.subTest(verb):
                self.expect_error(cli.OUTPUT, *arguments, runner=cli.spawn, preexec_fn=limited)
        left = [p for p in self.folder.rglob("*") if p.is_file() and p.suffix not in (".h5",)]
        self.assertEqual(left, [])

    @cli.long
    def test_a_disk_that_fills_during_a_recording(self):
        def limited():
            resource.setrlimit(resource.RLIMIT_FSIZE, (1_500_000, resource.RLIM_INFINITY))

        recording = self.folder / "run.h5"
        self.expect_error(cli.OUTPUT, "simulate", self.scene, "--script", self.long_script, "-o", recording,
                          runner=cli.spawn, preexec_fn=limited)
        again = self.succeed("replay", recording, self.scene)
        self.assertIn("cut short", again.stdout)

    def interrupt(self, arguments, growing=None, number=signal.SIGINT, delay_s=0.4, handled=False):
        """Signals palpate in the middle of its work: when the file `growing` has content, else after a time, which begins
        when the signal is handled where that is asked for."""
        process = subprocess.Popen([cli.PALPATE, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                   stdin=subprocess.DEVNULL, text=True)
        if handled:
            cli.wait_for_handler(process)
        if growing:
            while process.poll() is None and not (growing.exists() and growing.stat().st_size > 100_000):
                time.sleep(0.01)
        else:
            time.sleep(delay_s)
        if number == signal.SIGKILL:
            # between two writes: of a killed one Linux keeps a part (docs/reference/recording.md)
            process.send_signal(signal.SIGSTOP)
            os.waitid(os.P_PID, process.pid, os.WSTOPPED | os.WEXITED | os.WNOWAIT)
        process.send_signal(number)
        out, err = process.communicate(timeout=600)
        return process.returncode, out, err

    @cli.long
    def test_interrupts(self):
        blocks = self.made / "blocks.nrrd"
        write_blocks(blocks)
        recording = self.folder / "run.h5"
        # each of these works for seconds
        cases = {
            "data": (["data", "fetch", "knee-phantom", "--voxel", "0.25", "-o", self.folder / "out"], None),
            "prepare": (["prepare", blocks, "--threshold", "100", "255", "--sigma", "8", "--engine", "fourier", "-o",
                         self.folder / "f.nrrd"], None),
            "simulate": (["simulate", self.scene, "--script", self.long_script, "-o", recording], recording),
            "verify": (["verify", "accuracy", "--json", self.folder / "v.json"], None),
        }
        for verb, (arguments, growing) in cases.items():
            with self.subTest(verb):
                code, _, err = self.interrupt(arguments, growing, handled=True)
                self.assertEqual(code, cli.INTERRUPTED, err)
                self.assertIn("interrupted", err)
                self.assertEqual("is kept" in err, verb == "simulate", err)
        self.assertIn("identical", self.succeed("replay", recording, self.scene).stdout)
        left = sorted(p.name for p in self.folder.rglob("*") if p.is_file())
        self.assertEqual(left, ["run.h5"])

    @cli.long
    def test_an_interrupt_at_any_moment_leaves_whole_files_or_none(self):
        large = self.made / "large-for-moments"
        # the sanitizers take as long for the coarser knee
        self.succeed("data", "fetch", "knee-phantom", "-o", large, "--voxel", "1.2" if cli.SANITIZED else "0.6")
        labels = next(large.glob("*.seg.nrrd"))
        scan = next(p for p in large.glob("*.nrrd") if p != labels)
        scene, recording = large / "scene.toml", large / "run.h5"
        self.succeed("scene", "new", scan, labels, "-o", scene)
        self.succeed("simulate", scene, "--script", self.script, "-o", recording)
        page, made_scene = self.folder / "run.html", self.folder / "scene.toml"
        interrupted = 0
        for arguments in (["info", labels, "--json"], ["scene", "new", scan, labels, "-o", made_scene],
                          ["scene", "check", scene], ["report", recording, scene, "-o", page],
                          ["replay", recording, scene]):
            for delay_s in (0, 0.01, 0.03, 0.1, 0.3, 1):
                with self.subTest(arguments[0], delay_s=delay_s):
                    page.unlink(missing_ok=True)
                    made_scene.unlink(missing_ok=True)
                    code, out, err = self.interrupt(arguments, delay_s=delay_s)
                    # a program that has not begun yet dies of the signal
                    self.assertIn(code, (cli.OK, cli.INTERRUPTED, -signal.SIGINT), err)
                    if code == cli.OK:
                        self.assertTrue(out.strip() or page.exists() or made_scene.exists())
                    else:
                        self.assertFalse(out, "something was printed before the work was done")
                        self.assertEqual([p for p in self.folder.iterdir()], [])
                    interrupted += code == cli.INTERRUPTED
        self.assertGreater(interrupted, 5)

    @cli.long
    def test_an_interrupted_run_tells_of_a_recording_where_there_is_one(self):
        recording = self.folder / "run.h5"
        for delay_s in (0, 0.05, 0.1, 0.2):
            with self.subTest(delay_s=delay_s):
                recording.unlink(missing_ok=True)
                code, _, err = self.interrupt(["simulate", self.scene, "--script", self.long_script, "-o", recording],
                                              delay_s=delay_s, handled=True)
                self.assertEqual(code, cli.INTERRUPTED, err)
                self.assertEqual("is kept" in err, recording.exists(), err)

    @cli.long
    def test_killed_while_recording(self):
        recording = self.folder / "run.h5"
        code, _, _ = self.interrupt(["simulate", self.scene, "--script", self.long_script, "-o", recording], recording,
                                    signal.SIGKILL)
        self.assertEqual(code, -signal.SIGKILL)
        self.assertIn("cut short", self.succeed("replay", recording, self.scene).stdout)

    @cli.long
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
                self.expect_error(cli.BAD_INPUT, *arguments)


if __name__ == "__main__":
    cli.main()
