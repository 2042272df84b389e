"""palpate explore: the loop on the real clock, its end by itself and by signals, a disk that fills, the live line, and
what it says where nothing is privileged. Nothing here asks how punctual the machine is."""

import contextlib
import fcntl
import os
import pathlib
import re
import resource
import shutil
import signal
import socket
import struct
import subprocess
import termios
import time

import cli
from live_session import ERASE, PRESS, PRESSES, SLOW_MACHINE, KneeSessionTest

# dt (s), rendered force (N), unclamped force (N) and flags of each tick: one line for the last 1000 ticks before the
# stop request, one for the ticks from it on
LAST_FORCES = """
import sys, h5py, numpy
with h5py.File(sys.argv[1]) as run:
    paused = numpy.flatnonzero(run["ticks/switches"][:] & 4)[0]
    rows = numpy.column_stack([run["ticks/dt_s"][:], numpy.linalg.norm(run["device0/force_N"][:], axis=1),
                               run["device0/unclamped_force_N"][:], run["device0/flags"][:]])
for part in (rows[max(0, paused - 1000):paused], rows[paused:]):
    print(*(",".join(map(repr, row.tolist())) for row in part))
"""
# not finite, slewed, stale, jump, device fault, halted, emergency stop, passivity
WITHHELD = 2 | 128 | 512 | 1024 | 2048 | 4096 | 8192 | 1 << 20


class Explore(KneeSessionTest):
    def assert_faded(self, recording):
        done = subprocess.run(["/usr/bin/python3", "-c", LAST_FORCES, recording], capture_output=True, text=True)
        if "No module named" in done.stderr:
            cli.missing("python3-h5py")
        self.assertEqual(done.returncode, 0, done.stderr)
        pressed, fading = ([tuple(map(float, pair.split(","))) for pair in line.split()]
                           for line in done.stdout.splitlines())
        self.assertGreater(max(force_N for _, force_N, _, _ in pressed), 0.4)
        self.assertEqual(fading[-1][1], 0)
        # below a ramp of 0.1 s, and down but for what the hand still moves; where the machine stood still the force was
        # withheld for a tick, and comes back from less
        passed_s = 0
        for before, (dt_s, force_N, asked_N, flags) in zip([pressed[-1]] + fading, fading):
            _, before_N, asked_before_N, flags_before = before
            passed_s += dt_s
            self.assertLessEqual(force_N, min(1.4, asked_N * max(0, 1 - passed_s / 0.1)) + 1e-9)
            if not (int(flags) | int(flags_before)) & WITHHELD:
                self.assertLessEqual(force_N, before_N + max(0, asked_N - asked_before_N) + 1e-9)

    @cli.long
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
        # but for the lists of what became of late ticks, which grow with the machine's load
        lists = r"\d+ late: |force changed in ticks: "
        self.assertLessEqual(max(len(line) for line in done.stdout.splitlines() if not re.match(lists, line)), 80)
        # no terminal: no live line and no codes for one
        self.assertNotIn("\033", done.stdout + done.stderr)
        self.assertNotIn(" Hz  ", done.stderr)

    def test_signals_end_a_session_in_good_order(self):
        sessions = {}
        for number in (signal.SIGINT, signal.SIGTERM):
            recording = self.folder / f"{number}.h5"
            sessions[number] = recording, self.terminal(*self.explore("-o", recording, "--repeat"))
        for number, (recording, terminal) in sessions.items():
            with self.subTest(number):
                # it presses in the last frame that is whole
                terminal.wait_until(lambda: len(terminal.frames()) > 6 and re.search(PRESSES, terminal.frames()[-2]), PRESSES)
                terminal.process.send_signal(number)
                code, out = terminal.finish()
                self.assertEqual(code, cli.OK, terminal.shown)
                self.assertGreater(cli.contact_figures(out)["femur"][2], 0.4)
                self.assert_replays(recording, out, self.scene)
                self.assert_faded(recording)

                # the line was redrawn, fitted, and is gone
                for frame in terminal.frames():
                    self.assertLess(len(frame.split("\r")[0]), 80, frame)
                for line in terminal.screen():
                    self.assertNotIn(" Hz  ", line)
                self.assertIn("stopped", terminal.screen())

    @cli.long
    def test_a_vanished_terminal_and_closed_pipes_end_nothing(self):
        recording = self.folder / "run.h5"
        session = subprocess.Popen([cli.PALPATE, *self.explore("-o", recording, "--repeat")], stdin=subprocess.DEVNULL,
                                   stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.addCleanup(session.wait)
        self.addCleanup(session.kill)
        for line in session.stderr:
            if line.startswith("supervisor: "):
                break
        session.stdout.close()
        session.stderr.close()
        session.send_signal(signal.SIGHUP)
        session.send_signal(signal.SIGPIPE)
        time.sleep(1)
        self.assertIsNone(session.poll())
        session.send_signal(signal.SIGTERM)
        # it was felt and recorded to its end, and its figures could not be printed
        self.assertEqual(session.wait(timeout=300), cli.OUTPUT)
        self.assertNotIn("cut short", self.succeed("replay", recording, self.scene).stdout)

    def interrupted_twice(self, recording):
        terminal = self.terminal(*self.explore("-o", recording))
        terminal.wait_for(" Hz  ")
        terminal.process.send_signal(signal.SIGINT)
        # the second after the first was taken, not together with it
        while terminal.process.poll() is None and cli.sigint_is_in("ShdPnd", terminal.process):
            time.sleep(0.001)
        terminal.process.send_signal(signal.SIGINT)
        return terminal.finish()[0]

    @cli.long
    def test_a_second_interrupt_ends_at_once(self):
        # faster than the force fades out: where this process had no processor meanwhile, another time
        for attempt in range(5):
            recording = self.folder / f"{attempt}.h5"
            code = self.interrupted_twice(recording)
            if code != cli.OK:
                break
        self.assertEqual(code, -signal.SIGINT)
        self.assertIn("cut short", self.succeed("replay", recording, self.scene).stdout)

    def test_keys_stop_and_pause_the_force(self):
        # where the machine stands still the hand may give its step up: it begins again
        terminal = self.terminal(*self.explore("--repeat"), keyboard=True)
        terminal.wait_for(PRESSES)
        before = termios.tcgetattr(terminal.master)
        # a stop only stops, however often it is asked for
        for _ in range(3):
            terminal.press(b" ")
            terminal.wait_for(r" 0\.00/\S+ N .*EMERGENCY STOP: r rearms")
        # the hand leaves what it touched, and then another key is heard
        self.rearm(terminal)
        terminal.wait_for(PRESSES)
        terminal.press(b"p")
        terminal.wait_for(r" 0\.00/\S+ N .*PAUSED")
        # Ctrl-Z does nothing, and Ctrl-C is still an end in good order
        terminal.press(b"\x1a")
        terminal.wait_for(" Hz  ")
        terminal.press(b"\x03")
        code, out = terminal.finish()
        self.assertEqual(code, cli.OK, terminal.shown)
        self.assertRegex(out, r"force changed in ticks: .*paused \d+.*emergency stop \d+")
        self.assertFalse(before[3] & termios.ECHO, "keys were not shown")

    @cli.long
    def test_narrow_status_line_shows_how_to_rearm(self):
        terminal = self.terminal(*self.explore("--repeat"), keyboard=True)
        terminal.wait_for(PRESSES)
        # on a machine that stood still the line ends with what it skipped, where that still fits
        for pause in (signal.SIGSTOP, signal.SIGCONT):
            os.kill(terminal.process.pid, pause)
            time.sleep(0.3)
        terminal.wait_for(r" skip \d+")
        for columns, end in ((60, r"[^\r]*"), (40, "")):
            fcntl.ioctl(terminal.master, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
            terminal.press(b" ")
            terminal.wait_for(r"N  .* EMERGENCY STOP: r rearms" + end + re.escape(ERASE))
            self.assertLess(len(terminal.shown.split(ERASE)[-2]), columns)

    def rearm(self, terminal):
        for _ in range(100):
            terminal.press(b"r")
            # the last frame may not be whole yet
            terminal.wait_for(r"(?s) Hz  .* Hz  .* Hz  ")
            if "EMERGENCY STOP" not in terminal.frames()[-2]:
                return
            time.sleep(0.2)
        self.fail(f"it was never rearmed; shown: {terminal.shown[-500:]}")

    def test_quiet_is_quiet(self):
        terminal = self.terminal("-q", *self.explore("--seconds", "0.3"))
        code, out = terminal.finish()
        self.assertEqual((code, SLOW_MACHINE.sub("", terminal.shown)), (cli.OK, ""))
        self.assertIn("lateness us", out)

    @cli.long
    def test_ports(self):
        with socket.socket() as taken:
            taken.bind(("127.0.0.1", 0))
            taken.listen()
            port = taken.getsockname()[1]
            self.expect_error(cli.UNAVAILABLE, *self.explore("--port", port, "-o", self.folder / "run.h5"),
                              message="choose another --port")
        self.assertFalse((self.folder / "run.h5").exists())
        # the usual one is taken, by this or by who keeps it for longer than another test does
        with socket.socket() as usual:
            usual.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            for _ in range(600):
                try:
                    usual.bind(("127.0.0.1", 8480))
                    usual.listen()
                    break
                except OSError:
                    time.sleep(0.1)
            done = self.succeed(*self.explore("--seconds", "0.1"))
        self.assertIn("port 8480 is taken", done.stderr)
        self.assertRegex(done.stderr, r"(?m)^to see it, open http://127\.0\.0\.1:84[89]\d/$")
        self.assertNotIn(":8480/", done.stderr)

    @cli.long
    def test_nothing_listens_without_a_viewer(self):
        terminal = self.terminal(*self.explore("--no-viewer"))
        terminal.wait_for(" Hz  ")
        for link in pathlib.Path(f"/proc/{terminal.process.pid}/fd").iterdir():
            # one may be closed just now
            with contextlib.suppress(FileNotFoundError):
                self.assertFalse(os.readlink(link).startswith("socket:"))
        self.assertNotIn("http", terminal.shown)
        terminal.process.send_signal(signal.SIGINT)
        self.assertEqual(terminal.finish()[0], cli.OK)

    def test_requests_beyond_the_limits_are_refused(self):
        recording = self.folder / "run.h5"
        for options, says in ((["--listen", "0.0.0.0"], "--token-file"), (["--listen", "example.org"], "numeric"),
                              (["--tls-cert", self.script], "--tls-key"),
                              (["--device", "pointer", "--no-viewer"], "leave out --no-viewer"),
                              (["--device", "pointer"], "a script moves the simulated hand only"),
                              (["--device", "spoon"], "spoon"), (["--port", "65536"], "whole number between")):
            with self.subTest(options):
                self.expect_error(cli.USAGE, *self.explore("-o", recording, *options), message=says)
        self.expect_error(cli.USAGE, "explore", self.scene, "--device", "pointer", "--repeat", message="a script moves the simulated hand only")
        self.expect_error(cli.BAD_INPUT, *self.explore("--token-file", self.folder / "missing"), message="missing")
        self.assertFalse(recording.exists())

    @cli.long
    def test_a_disk_that_fills_ends_the_recording_and_not_the_session(self):
        def limited():
            # little more than a recording without a tick, so that a few will do
            resource.setrlimit(resource.RLIMIT_FSIZE, (80_000, resource.RLIM_INFINITY))

        recording = self.folder / "run.h5"
        done = self.expect_error(cli.OUTPUT, *self.explore("--seconds", "2", "--rate", "4000", "-o", recording),
                                 message="cannot be written", runner=cli.spawn, preexec_fn=limited,
                                 env=dict(os.environ, PALPATE_CACHE=""))
        self.assertEqual(SLOW_MACHINE.sub("", done.stderr).count("palpate: warning:"), 1, done.stderr)
        self.assertIn("the session continues", done.stderr)
        self.assertLess(done.stderr.index("palpate: warning:"), done.stderr.index("palpate: error:"))
        ticks, skipped = (int(re.search(rf"(\d+) {word}", done.stdout).group(1)) for word in ("ticks", "skipped"))
        # the disk was full within the first milliseconds; a busy machine loses some of the last ones
        self.assertGreaterEqual(ticks + skipped, 4000)
        self.assertIn("cut short", self.succeed("replay", recording, self.scene).stdout)

    @cli.long
    def test_without_privileges_it_runs_and_says_so(self):
        self.folder.chmod(0o755)
        for path in (self.made, *self.made.rglob("*")):
            path.chmod(0o755)
        palpate = self.folder / "palpate"
        shutil.copy(cli.PALPATE, palpate)

        def unprivileged():
            resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
            resource.setrlimit(resource.RLIMIT_MEMLOCK, (65536, 65536))

        done = subprocess.run([*cli.unprivileged_prefix(), palpate, *map(str, self.explore("--seconds", "0.3"))],
                              capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=600,
                              preexec_fn=unprivileged, env=dict(os.environ, HOME="/nonexistent"))
        self.assertEqual(done.returncode, cli.OK, done.stderr)
        self.assertRegex(done.stderr, r"(?m)^scheduler: SCHED_OTHER \(SCHED_FIFO refused: .*rtprio.*CAP_SYS_NICE")
        self.assertRegex(done.stderr, r"(?m)^memory: not locked \(mlockall refused: .*memlock")
        self.assertIn("docs/guide/explore.md", done.stderr)
        self.assertRegex(done.stdout, r"(?m)^\d+ ticks, ")
        # who asks for nothing is refused nothing
        done = self.succeed(*self.explore("--seconds", "0.1", "--no-realtime"))
        for who in ("scheduler", "watchdog", "supervisor"):
            self.assertRegex(done.stderr, rf"(?m)^{who}: SCHED_OTHER \(SCHED_FIFO not requested")
        self.assertNotIn("refused", done.stderr)

    @cli.long
    def test_rendered_stiffness_is_reported(self):
        scene = self.folder / "scene.toml"
        text = self.scene.read_text().replace("knee/", f"{self.made}/knee/")
        scene.write_text(text + "\n[workspace]\nscale = 2.0\nforce_gain = 0.25\n")
        done = self.succeed("explore", scene, "--script", self.script, "--seconds", "0.1")
        self.assertIn("rendered stiffness = scale x force gain = 0.5 times that of the tissue", done.stderr)
        self.assertRegex(done.stderr, r"(?m)^  bone +0\.75 N/mm$")
        self.assertNotIn("rendered stiffness", self.succeed(*self.explore("--seconds", "0.1")).stderr)

    def test_what_a_new_user_gets_wrong(self):
        recording = self.folder / "run.h5"
        for option, value in (("--rate", "100"), ("--rate", "20000"), ("--spin", "-1"), ("--seconds", "0"),
                              ("--seconds", "nan"), ("--max-force", "1000"), ("--cpu", "-1"), ("--seed", "x")):
            with self.subTest(option, value=value):
                self.expect_error(cli.USAGE, *self.explore("-o", recording, option, value), message="number between")
        self.expect_error(cli.USAGE, *self.explore("--cpu", "4000"), message="no CPU 4000")
        self.expect_error(cli.USAGE, "explore", message="target")
        self.expect_error(cli.USAGE, *self.explore("--second", "3"), message="did you mean --seconds?")
        self.expect_error(cli.BAD_INPUT, "explore", "knee-phantm", message="palpate data list")
        self.expect_error(cli.BAD_INPUT, "explore", self.folder / "missing.toml", message="missing")
        self.expect_error(cli.BAD_INPUT, "explore", self.scene, "-s", self.folder / "missing.toml", message="missing")
        self.expect_error(cli.OUTPUT, *self.explore("-o", self.folder / "missing" / "run.h5"), message="missing")
        self.expect_error(cli.USAGE, *self.explore("-o", self.script), message="would replace an input")
        self.expect_error(cli.USAGE, *self.explore("-o", self.scene), message="would replace an input")
        elbow = self.folder / "elbow.toml"
        elbow.write_text(PRESS.replace("femur", "elbow"))
        self.expect_error(cli.BAD_INPUT, "explore", self.scene, "-s", elbow, "-o", recording, message="elbow.toml:1")
        self.assertFalse(recording.exists())


if __name__ == "__main__":
    cli.share_prepared_models()
    cli.main()
