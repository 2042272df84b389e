"""palpate explore: the loop on the real clock, its end by itself and by signals, a disk that fills, the live line, and
what it says where nothing is privileged. Nothing here asks how punctual the machine is."""

import fcntl
import os
import pathlib
import pty
import re
import resource
import select
import shutil
import signal
import subprocess
import tempfile
import termios
import time
import unittest

import cli

PRESS = '[[step]]\napproach = "femur"\nspeed = 200.0\n[[step]]\npress = 0.8\n[[step]]\nhold = 60.0\n'
ERASE = "\r\033[K"

# s since the tick before, N sent and N asked of ticks in the last second before the loop was told to stop; then the same
# from that tick on
LAST_FORCES = """
import sys, h5py, numpy
with h5py.File(sys.argv[1]) as run:
    paused = numpy.flatnonzero(run["ticks/switches"][:] & 4)[0]
    rows = numpy.column_stack([run["ticks/dt_s"][:], numpy.linalg.norm(run["device0/force_N"][:], axis=1),
                               run["device0/unclamped_force_N"][:]])
for part in (rows[max(0, paused - 1000):paused], rows[paused:]):
    print(*(",".join(map(repr, row.tolist())) for row in part))
"""


class Terminal:
    """palpate with its stderr on a terminal, and that terminal's keys when it has a keyboard; its frames are what each
    redrawing of the live line shows."""

    def __init__(self, *arguments, keyboard=False):
        self.master, slave = pty.openpty()
        own = {"start_new_session": True, "preexec_fn": lambda: fcntl.ioctl(slave, termios.TIOCSCTTY, 0)}
        self.process = subprocess.Popen([cli.PALPATE, *map(str, arguments)],
                                        stdin=slave if keyboard else subprocess.DEVNULL,
                                        stdout=subprocess.PIPE, stderr=slave, text=True, **(own if keyboard else {}))
        os.close(slave)
        self.shown = ""

    def press(self, key):
        os.write(self.master, key)
        self.shown = ""

    def read(self):
        """More of what is shown; False at the end."""
        if not select.select([self.master], [], [], 60)[0]:
            raise AssertionError(f"nothing for a minute; shown: {self.shown[-500:]}")
        try:
            piece = os.read(self.master, 4096)
        except OSError:
            piece = b""
        self.shown += piece.decode()
        return bool(piece)

    def wait_for(self, pattern):
        while not re.search(pattern, self.shown):
            if not self.read():
                raise AssertionError(f"ended without {pattern}; shown: {self.shown[-500:]}")

    def finish(self):
        while self.read():
            pass
        out, _ = self.process.communicate(timeout=60)
        return self.process.returncode, out

    def close(self):
        self.process.kill()
        self.process.communicate()
        os.close(self.master)

    def frames(self):
        return [frame for frame in self.shown.split(ERASE) if " Hz  late " in frame]

    def screen(self):
        """What is left to see at the end, a string a line."""
        return [line.split(ERASE)[-1] for line in self.shown.replace("\r\n", "\n").split("\n")]


class Explore(cli.PalpateTest):
    @classmethod
    def setUpClass(cls):
        cls._made = tempfile.TemporaryDirectory(prefix="palpate-e2e-")
        made = cls.made = pathlib.Path(cls._made.name)
        done = cli.run("data", "fetch", "knee-phantom", "-o", made / "knee", "--voxel", "1.5")
        assert done.returncode == 0, done.stderr
        labels = next((made / "knee").glob("*.seg.nrrd"))
        cls.scene, cls.script = made / "scene.toml", made / "press.toml"
        done = cli.run("scene", "new", labels, "-o", cls.scene)
        assert done.returncode == 0, done.stderr
        cls.script.write_text(PRESS)

    @classmethod
    def tearDownClass(cls):
        cls._made.cleanup()

    def terminal(self, *arguments, **options):
        terminal = Terminal(*arguments, **options)
        self.addCleanup(terminal.close)
        return terminal

    def explore(self, *options):
        return ["explore", self.scene, "--script", self.script, *options]

    def assert_replays(self, recording, stdout, scene=None):
        again = self.succeed("replay", recording, *([scene] if scene else []))
        self.assertIn("identical", again.stdout)
        self.assertNotIn("cut short", again.stdout)
        self.assertEqual(cli.run_hash(again.stdout), cli.run_hash(stdout))

    def assert_faded(self, recording):
        done = subprocess.run(["/usr/bin/python3", "-c", LAST_FORCES, recording], capture_output=True, text=True)
        if "No module named" in done.stderr:
            cli.missing("python3-h5py")
        self.assertEqual(done.returncode, 0, done.stderr)
        pressed, fading = ([tuple(map(float, pair.split(","))) for pair in line.split()]
                           for line in done.stdout.splitlines())
        self.assertGreater(max(force_N for _, force_N, _ in pressed), 0.4)
        self.assertEqual(fading[-1][1], 0)
        # below a ramp of 0.1 s, and down but for what the hand still moves
        passed_s, before_N = 0, pressed[-1][1]
        for dt_s, force_N, asked_N in fading:
            passed_s += dt_s
            self.assertLessEqual(force_N, min(1.4, asked_N * max(0, 1 - passed_s / 0.1)) + 1e-9)
            self.assertLessEqual(force_N, before_N + 0.01 + 30 * dt_s)
            before_N = force_N

    def test_a_generated_knee_for_a_time(self):
        recording = self.folder / "run.h5"
        done = self.succeed("explore", "knee-phantom", "--seconds", "3", "-o", recording)
        self.assert_replays(recording, done.stdout)
        ticks, rate = re.search(r"^(\d+) ticks, ([\d.]+) a second, [\d.]+ % on time$", done.stdout, re.M).groups()
        skipped = re.search(r"^(\d+) skipped, \d+ dropped, \d+ stalls$", done.stdout, re.M).group(1)
        self.assertGreaterEqual(int(ticks) + int(skipped), 3000)
        self.assertLess(float(rate), 1001)
        self.assertRegex(done.stdout, r"(?m)^lateness us( +[\d.]+){4}$")
        self.assertRegex(done.stderr, r"(?m)^scheduler: SCHED_")
        self.assertRegex(done.stderr, r"(?m)^memory: (not )?locked")
        self.assertLessEqual(max(map(len, done.stdout.splitlines())), 80)
        # no terminal: no live line and no codes for one
        self.assertNotIn("\033", done.stdout + done.stderr)
        self.assertNotIn(" Hz  late ", done.stderr)

    def test_signals_end_a_session_in_good_order(self):
        sessions = {}
        for number in (signal.SIGINT, signal.SIGTERM):
            recording = self.folder / f"{number}.h5"
            sessions[number] = recording, self.terminal(*self.explore("-o", recording))
        for number, (recording, terminal) in sessions.items():
            with self.subTest(number):
                terminal.wait_for(r" 0\.[5-9]\d/1\.40 N  femur")
                terminal.process.send_signal(number)
                code, out = terminal.finish()
                self.assertEqual(code, cli.OK, terminal.shown)
                self.assertGreater(cli.held(out)["femur"][2], 0.4)
                self.assert_replays(recording, out, self.scene)
                self.assert_faded(recording)

                # the line was redrawn, fitted, and is gone
                frames = terminal.frames()
                self.assertGreater(len(frames), 5)
                for frame in frames:
                    self.assertLess(len(frame.split("\r")[0]), 80, frame)
                for line in terminal.screen():
                    self.assertNotIn(" Hz  late ", line)
                self.assertIn("stopped", terminal.screen())

    def test_a_second_interrupt_ends_at_once(self):
        recording = self.folder / "run.h5"
        terminal = self.terminal(*self.explore("-o", recording))
        terminal.wait_for(" Hz  late ")
        # faster than the force fades out
        terminal.process.send_signal(signal.SIGINT)
        time.sleep(0.01)
        terminal.process.send_signal(signal.SIGINT)
        code, _ = terminal.finish()
        self.assertEqual(code, -signal.SIGINT)
        self.assertIn("cut short", self.succeed("replay", recording, self.scene).stdout)

    def test_keys_stop_and_pause_the_force(self):
        terminal = self.terminal(*self.explore(), keyboard=True)
        terminal.wait_for(r" 0\.[5-9]\d/1\.40 N  femur")
        before = termios.tcgetattr(terminal.master)
        terminal.press(b" ")
        terminal.wait_for(r" 0\.00/\S+ N .*EMERGENCY STOP")
        terminal.press(b" ")
        terminal.wait_for(r" 0\.[5-9]\d/1\.40 N  femur")
        terminal.press(b"p")
        terminal.wait_for(r" 0\.00/\S+ N .*PAUSED")
        # Ctrl-Z does nothing, and Ctrl-C is still an end in good order
        terminal.press(b"\x1a")
        terminal.wait_for(" Hz  late ")
        terminal.press(b"\x03")
        code, out = terminal.finish()
        self.assertEqual(code, cli.OK, terminal.shown)
        self.assertRegex(out, r"force changed in ticks: .*paused \d+.*emergency stop \d+")
        self.assertFalse(before[3] & termios.ECHO, "keys were not shown")

    def test_quiet_is_quiet(self):
        terminal = self.terminal("-q", *self.explore("--seconds", "0.3"))
        code, out = terminal.finish()
        self.assertEqual((code, terminal.shown), (cli.OK, ""))
        self.assertIn("lateness us", out)

    def test_a_disk_that_fills_ends_the_recording_and_not_the_session(self):
        def limited():
            resource.setrlimit(resource.RLIMIT_FSIZE, (150_000, resource.RLIM_INFINITY))

        recording = self.folder / "run.h5"
        done = self.fail_clearly(cli.OUTPUT, *self.explore("--seconds", "2", "--rate", "4000", "-o", recording),
                                 says="cannot be written", preexec_fn=limited)
        self.assertEqual(done.stderr.count("palpate: warning:"), 1, done.stderr)
        self.assertIn("the session goes on", done.stderr)
        self.assertLess(done.stderr.index("palpate: warning:"), done.stderr.index("palpate: error:"))
        ticks, skipped = (int(re.search(rf"(\d+) {word}", done.stdout).group(1)) for word in ("ticks", "skipped"))
        self.assertGreaterEqual(ticks + skipped, 8000)
        self.assertIn("cut short", self.succeed("replay", recording, self.scene).stdout)

    def test_without_privileges_it_runs_and_says_so(self):
        self.folder.chmod(0o755)
        for path in (self.made, *self.made.rglob("*")):
            path.chmod(0o755)
        palpate = self.folder / "palpate"
        shutil.copy(cli.PALPATE, palpate)

        def unprivileged():
            resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
            resource.setrlimit(resource.RLIMIT_MEMLOCK, (65536, 65536))

        done = subprocess.run([*cli.as_nobody(), palpate, *map(str, self.explore("--seconds", "0.3"))],
                              capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=600,
                              preexec_fn=unprivileged, env=dict(os.environ, HOME="/nonexistent"))
        self.assertEqual(done.returncode, cli.OK, done.stderr)
        self.assertRegex(done.stderr, r"(?m)^scheduler: SCHED_OTHER \(SCHED_FIFO refused: .*rtprio.*CAP_SYS_NICE")
        self.assertRegex(done.stderr, r"(?m)^memory: not locked \(mlockall refused: .*memlock")
        self.assertIn("docs/explore.md", done.stderr)
        self.assertRegex(done.stdout, r"(?m)^\d+ ticks, ")
        # who asks for nothing is refused nothing
        done = self.succeed(*self.explore("--seconds", "0.1", "--no-realtime"))
        self.assertIn("SCHED_FIFO not asked for", done.stderr)
        self.assertNotIn("refused", done.stderr)

    def test_the_stiffness_that_is_felt_is_told(self):
        scene = self.folder / "scene.toml"
        text = self.scene.read_text().replace("knee/", f"{self.made}/knee/")
        scene.write_text(text + "\n[workspace]\nscale = 2.0\nforce_gain = 0.25\n")
        done = self.succeed("explore", scene, "--script", self.script, "--seconds", "0.1")
        self.assertIn("felt stiffness, scale x force gain = 0.5 times the tissue's", done.stderr)
        self.assertRegex(done.stderr, r"(?m)^  bone +0\.75 N/mm$")
        self.assertNotIn("felt stiffness", self.succeed(*self.explore("--seconds", "0.1")).stderr)

    def test_what_a_new_user_gets_wrong(self):
        recording = self.folder / "run.h5"
        for option, value in (("--rate", "100"), ("--rate", "20000"), ("--spin", "-1"), ("--seconds", "0"),
                              ("--seconds", "nan"), ("--max-force", "1000"), ("--cpu", "-1"), ("--seed", "x")):
            with self.subTest(option, value=value):
                self.fail_clearly(cli.USAGE, *self.explore("-o", recording, option, value), says="number between")
        self.fail_clearly(cli.USAGE, *self.explore("--cpu", "4000"), says="no CPU 4000")
        self.fail_clearly(cli.USAGE, "explore", says="target")
        self.fail_clearly(cli.USAGE, *self.explore("--second", "3"), says="did you mean --seconds?")
        self.fail_clearly(cli.BAD_INPUT, "explore", "knee-phantm", says="palpate data list")
        self.fail_clearly(cli.BAD_INPUT, "explore", self.folder / "missing.toml", says="missing")
        self.fail_clearly(cli.BAD_INPUT, "explore", self.scene, "-s", self.folder / "missing.toml", says="missing")
        self.fail_clearly(cli.OUTPUT, *self.explore("-o", self.folder / "missing" / "run.h5"), says="missing")
        self.fail_clearly(cli.USAGE, *self.explore("-o", self.script), says="would replace an input")
        self.fail_clearly(cli.USAGE, *self.explore("-o", self.scene), says="would replace an input")
        elbow = self.folder / "elbow.toml"
        elbow.write_text(PRESS.replace("femur", "elbow"))
        self.fail_clearly(cli.BAD_INPUT, "explore", self.scene, "-s", elbow, "-o", recording, says="elbow.toml:1")
        self.assertFalse(recording.exists())


if __name__ == "__main__":
    cli.main()
