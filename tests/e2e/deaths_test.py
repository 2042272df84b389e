"""palpate explore under every signal, an exception in each thread, a full disk, closed streams and SIGSTOP, each at a
random time. Each time its supervisor's log says what happened, its recording
replays as far as it goes, and nothing of it stays behind. A trial of some causes in every run, PALPATE_TEST_DEATHS=all takes all causes 20 times."""

import contextlib
import http.client
import json
import os
import pathlib
import random
import re
import resource
import select
import signal
import struct
import subprocess
import tempfile
import threading
import time
import urllib.request

import cli
import live_session

# big enough to be pressed, and soon ready
KNEE_MM = "3.0"
SEED = int(os.environ.get("PALPATE_TEST_SEED", "20261121").replace("any", str(random.randrange(10**9))))
# a death detected later than this is printed with the supervisor's log entry
LATE_MS = 100
ALL = os.environ.get("PALPATE_TEST_DEATHS") == "all"

# signals without a handler: the default action terminates the program
DEADLY = [signal.SIGKILL, signal.SIGQUIT, signal.SIGILL, signal.SIGTRAP, signal.SIGABRT, signal.SIGBUS, signal.SIGFPE,
          signal.SIGUSR1, signal.SIGSEGV, signal.SIGUSR2, signal.SIGALRM, signal.SIGSTKFLT, signal.SIGXCPU, signal.SIGVTALRM,
          signal.SIGPROF, signal.SIGIO, signal.SIGPWR, signal.SIGSYS, signal.SIGRTMIN, signal.SIGRTMAX]
GENTLE = [signal.SIGINT, signal.SIGTERM]
# ignored: stopping would leave a device at its last force, and ending would drop the session without need
IGNORED = [signal.SIGHUP, signal.SIGPIPE, signal.SIGXFSZ, signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU]


def trials(causes, few):
    """Those of a run, in order: all of them often, or a few by the seed."""
    return causes * 20 if ALL else random.Random(SEED).sample(causes, few)


class SchedulingDelayProbe(threading.Thread):
    """Measures the scheduling delay of an idle thread within a `with` block, at the supervisor's real-time priority
    where permitted, or at normal priority, as reference for the detection times."""

    SUPERVISOR = 95

    def __init__(self, priority=None):
        super().__init__()
        self.priority, self.latest_ms, self.ended = priority, 0.0, False

    def run(self):
        if self.priority is not None:
            with contextlib.suppress(PermissionError):
                os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(self.priority))
        while not self.ended:
            asked = time.monotonic()
            time.sleep(0.001)
            self.latest_ms = max(self.latest_ms, 1000 * (time.monotonic() - asked) - 1)

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *_):
        self.ended = True
        self.join()


class Session:
    """palpate explore that palpates for ever, records and is watched."""

    def __init__(self, recording, log, arguments, **environment):
        self.recording, self.log = recording, log
        self.process = subprocess.Popen(
            [cli.PALPATE, *arguments], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            preexec_fn=self.as_a_user_would, env=os.environ | environment)
        self.told = ""
        self.read_until("supervisor: ")
        children = pathlib.Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split()
        self.supervisor = pathlib.Path(f"/proc/{children[0]}")

    @staticmethod
    def as_a_user_would():
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        # a test that runs in the background ignores some
        for number in (signal.SIGINT, signal.SIGQUIT, signal.SIGHUP):
            signal.signal(number, signal.SIG_DFL)

    def read_until(self, words):
        """What it says on stderr from the start to that line."""
        while words not in self.told:
            line = self.process.stderr.readline()
            assert line, f"ended without '{words}': {self.told}"
            self.told += line

    def events(self):
        return [json.loads(line) for line in self.log.read_text().splitlines()]

    def end(self):
        """(exit code, stdout, all of stderr), with the supervisor gone."""
        out, rest = self.process.communicate(timeout=300)
        self.wait_until(lambda: not self.supervisor.exists(), "its supervisor is gone")
        return self.process.returncode, out, self.told + rest

    @staticmethod
    def wait_until(done, what):
        until = time.monotonic() + 300
        while not done():
            assert time.monotonic() < until, f"five minutes until {what}"
            time.sleep(0.002)

    def close(self):
        if self.process.poll() is None:
            self.process.kill()
        for stream in (self.process.stdout, self.process.stderr):
            stream.close()
        self.process.wait()


class Deaths(cli.PalpateTest):
    @classmethod
    def setUpClass(cls):
        print(f"seed {SEED}", flush=True)
        cls._made = tempfile.TemporaryDirectory(prefix="palpate-e2e-")
        made = pathlib.Path(cls._made.name)
        assert cli.run("data", "fetch", "knee-phantom", "-o", made / "knee", "--voxel", KNEE_MM).returncode == cli.OK
        cls.scene, cls.script = made / "scene.toml", made / "press.toml"
        assert cli.run("scene", "new", next((made / "knee").glob("*.seg.nrrd")), "-o", cls.scene).returncode == cli.OK
        cls.script.write_text(cli.TOUCH + "[[step]]\nhold = 60.0\n")
        cls.random = random.Random(SEED)

    @classmethod
    def tearDownClass(cls):
        cls._made.cleanup()

    def explore(self, recording, log, *viewers):
        log.unlink(missing_ok=True)
        return ["explore", self.scene, "--script", self.script, "--repeat", *(viewers or ("--no-viewer",)), "-o", recording,
                "--supervisor-log", log]

    def begin(self, *viewers, **environment):
        """A session, at a random moment of it."""
        recording, log = self.folder / "run.h5", self.folder / "supervisor.log"
        session = Session(recording, log, self.explore(recording, log, *viewers), **environment)
        self.addCleanup(session.close)
        time.sleep(self.random.uniform(0, 2))
        return session

    def assert_replays(self, recording, whole):
        again = self.succeed("replay", recording, self.scene)
        self.assertIn("identical", again.stdout)
        self.assertEqual("cut short" not in again.stdout, whole, again.stdout)

    def assert_nothing_left(self, claims=0):
        """Beside what was asked for there is nothing, but for as many empty locks of a process that could not give them back;
        the next session in this folder takes and removes them."""
        left = [path for path in self.folder.iterdir() if path.name not in ("run.h5", "supervisor.log")]
        self.assertEqual(len(left), claims, left)
        for path in left:
            self.assertTrue(path.name.endswith(".lock") and path.stat().st_size == 0, left)

    def test_nothing_of_the_patient_stands_in_a_core_dump(self):
        def dies_with_a_core(arguments, when):
            """Whether the system wrote one for a process that may have one as large as it likes."""
            pid = os.fork()
            if pid == 0:
                with contextlib.suppress(ValueError, OSError):
                    resource.setrlimit(resource.RLIMIT_CORE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
                os.chdir(self.folder)
                null = os.open(os.devnull, os.O_RDWR)
                for stream in range(3):
                    os.dup2(null, stream)
                os.execv(arguments[0], arguments)
            when()
            os.kill(pid, signal.SIGABRT)
            return os.WCOREDUMP(os.waitpid(pid, 0)[1])

        recording = self.folder / "run.h5"
        felt = [str(cli.PALPATE), *map(str, self.explore(recording, self.folder / "supervisor.log"))]
        began = time.monotonic()

        def prepared():
            while not recording.exists() and time.monotonic() < began + 120:
                time.sleep(0.05)

        self.assertFalse(dies_with_a_core(felt, prepared))
        # where the system writes any, the test would see it
        if not dies_with_a_core(["/bin/sleep", "60"], lambda: time.sleep(0.3)):
            print("this system writes no core dumps: nothing was seen", flush=True)

    def print_figures(self, what, figures_ms):
        figures_ms.sort()
        at = [figures_ms[int(part * (len(figures_ms) - 1))] for part in (0.5, 0.99, 1)]
        print(f"{what}, {len(figures_ms)} trials, ms: {at[0]:.2f} (p50), {at[1]:.2f} (p99), {at[2]:.2f} (largest)",
              flush=True)

    def test_what_it_dies_of_is_seen_and_written_down(self):
        seen_ms = []
        for number in trials(DEADLY, 4):
            with self.subTest(number):
                session = self.begin()
                with SchedulingDelayProbe(SchedulingDelayProbe.SUPERVISOR) as bare, SchedulingDelayProbe() as ordinary:
                    then_ns = time.monotonic_ns()
                    session.process.send_signal(number)
                    code, _, _ = session.end()
                self.assertEqual(code, -number)
                event, = session.events()
                self.assertEqual((event["kind"], event["session"]), ("death", session.process.pid))
                self.assertGreaterEqual(event["halted_ns"], event["observed_ns"])
                self.assertGreaterEqual(event["observed_ns"], event["last_beat_ns"])
                seen_ms.append((event["halted_ns"] - then_ns) / 1e6)
                if seen_ms[-1] > LATE_MS:
                    print(f"{signal.Signals(number).name}: seen {seen_ms[-1]:.1f} ms after it, a bare thread of the supervisor's priority "
                          f"late by {bare.latest_ms:.1f}, an ordinary one by {ordinary.latest_ms:.1f}; {json.dumps(event)}", flush=True)
                self.assert_replays(session.recording, whole=False)
                self.assert_nothing_left(claims=2)
        self.print_figures("seen after the signal", seen_ms)

    @cli.long
    def test_signals_that_ask_for_the_end_get_one_in_good_order(self):
        took_ms = []
        for number in trials(GENTLE, 1):
            with self.subTest(number):
                session = self.begin()
                then = time.monotonic()
                session.process.send_signal(number)
                code, _, told = session.end()
                took_ms.append(1000 * (time.monotonic() - then))
                self.assertEqual((code, session.events()), (cli.OK, []), told)
                self.assert_replays(session.recording, whole=True)
                self.assert_nothing_left()
        self.print_figures("ended after the signal", took_ms)

    @cli.long
    def test_signals_that_end_nothing(self):
        for number in trials(IGNORED, 2):
            with self.subTest(number):
                session = self.begin()
                session.process.send_signal(number)
                # its recording goes on growing
                size = session.recording.stat().st_size
                session.wait_until(lambda: session.recording.stat().st_size > size, "it records more")
                session.process.terminate()
                code, _, told = session.end()
                self.assertEqual((code, session.events()), (cli.OK, []), told)
                self.assert_replays(session.recording, whole=True)
                self.assert_nothing_left()

    @cli.long
    def test_stopped_for_a_while_it_goes_on(self):
        for _ in trials([signal.SIGSTOP], 1):
            recording, log = self.folder / "run.h5", self.folder / "supervisor.log"
            terminal = live_session.Terminal(*self.explore(recording, log))
            self.addCleanup(terminal.close)
            terminal.wait_for(live_session.PRESSES)
            time.sleep(self.random.uniform(0, 1))
            terminal.process.send_signal(signal.SIGSTOP)
            time.sleep(0.3)
            # what was shown until then
            while select.select([terminal.master], [], [], 0)[0]:
                terminal.read()
            terminal.shown = ""
            terminal.process.send_signal(signal.SIGCONT)
            terminal.wait_for(live_session.PRESSES)
            terminal.process.terminate()
            code, out = terminal.finish()
            self.assertEqual(code, cli.OK, terminal.shown)
            # nothing was sent at first
            self.assertRegex(out, r"halted \d+")
            # its device is simulated: nobody else is told to halt it, and it is not killed for standing still
            self.assertEqual(log.read_text(), "")
            self.assert_replays(recording, whole=True)
            self.assert_nothing_left()

    @cli.long
    def test_closed_streams_end_nothing(self):
        for _ in trials(["closed streams"], 1):
            session = self.begin()
            session.process.stdout.close()
            session.process.stderr.close()
            size = session.recording.stat().st_size
            session.wait_until(lambda: session.recording.stat().st_size > size, "it records more")
            session.process.terminate()
            # its figures could not be printed
            self.assertEqual(session.process.wait(timeout=300), cli.OUTPUT)
            session.wait_until(lambda: not session.supervisor.exists(), "its supervisor is gone")
            self.assertEqual(session.events(), [])
            self.assert_replays(session.recording, whole=True)
            self.assert_nothing_left()

    @cli.long
    def test_a_full_disk_ends_the_recording_alone(self):
        for n, _ in enumerate(trials(["full disk"], 1)):
            session = self.begin()
            size = session.recording.stat().st_size
            most = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
            resource.prlimit(session.process.pid, resource.RLIMIT_FSIZE, (size, most))
            session.read_until("the session continues")
            # goes on, and ends or dies as any other does
            if n % 2 == 0:
                session.process.terminate()
                code, _, _ = session.end()
                self.assertEqual((code, session.events()), (cli.OUTPUT, []))
                self.assert_nothing_left()
            else:
                session.process.kill()
                code, _, _ = session.end()
                self.assertEqual((code, [event["kind"] for event in session.events()]), (-signal.SIGKILL, ["death"]))
                self.assert_nothing_left(claims=2)
            self.assert_replays(session.recording, whole=False)

    # unnamed: main, stop watch (console.cc), simulated hand, recorder, late-tick monitor, soft-tissue solver; then the
    # named threads
    THREADS = sorted(6 * ["palpate"] + ["palpate-guard", "palpate-servo", "viewer-pictures", "viewer-volumes", "viewers"])

    def begin_watched(self):
        """(a session that serves a page, the file that chooses who throws, [(name, number)] of its threads as they began)"""
        chosen = pathlib.Path(self._made.name) / "chosen"
        self.choose(chosen, 0)
        session = self.begin("--port", "0", LD_PRELOAD=os.environ["THROWING_THREADS"], THROWING_THREAD=str(chosen))
        session.read_until("open http")
        threads = []

        def are_there():
            tasks = sorted(pathlib.Path(f"/proc/{session.process.pid}/task").iterdir(), key=lambda task: int(task.name))
            threads[:] = [((task / "comm").read_text().strip(), int(task.name)) for task in tasks]
            return sorted(name for name, _ in threads) == self.THREADS

        session.wait_until(are_there, "its threads have their names")
        # the second waits for a signal, and for nothing else
        return session, chosen, threads[:1] + threads[2:]

    def thread_that_prepares_fields(self, session):
        """The thread that makes them."""
        def threads():
            return {int(task.name) for task in pathlib.Path(f"/proc/{session.process.pid}/task").iterdir()}

        before = threads()
        # those there are no longer suit
        viewer = self.viewer(session)
        answer = viewer.ask(type="tissue", tissue=0, stiffness_N_per_mm=1.1)
        self.assertEqual(answer["type"], "done", answer)
        self.assertEqual(viewer.ask(type="set", method="b-spline")["type"], "done")
        session.wait_until(lambda: threads() - before, "somebody makes them")
        # what it begins comes after it, and goes again
        return min(threads() - before)

    def viewer(self, session):
        viewer = live_session.Viewer(self.address(session))
        self.addCleanup(viewer.close)
        return viewer

    def feel_b_spline(self, session):
        viewer = self.viewer(session)
        self.assertEqual(viewer.ask(type="set", method="b-spline")["type"], "done")
        while viewer.state.get("method") != "b-spline":
            viewer.next()

    @staticmethod
    def choose(chosen, thread):
        # in place, for others have it mapped
        file = os.open(chosen, os.O_RDWR | os.O_CREAT, 0o600)
        os.pwrite(file, struct.pack("i", thread), 0)
        os.close(file)

    @staticmethod
    def address(session):
        return re.search(r"open (http://[^/]+/)", session.told)[1]

    def ask_page(self, session, path):
        with urllib.request.urlopen(self.address(session) + path.lstrip("/"), timeout=300) as answer:
            return json.loads(answer.read()) if path == "/api/scene" else len(answer.read())

    # an exception in the viewer server's thread or in the field-preparation thread does not end the session
    @cli.long
    def test_an_exception_in_any_thread(self):
        seen_ms = []
        maker = len(self.THREADS) - 1  # of fields: it begins when the first are wanted
        for place in trials(list(range(maker + 1)), 2):
            session, chosen, threads = self.begin_watched()
            name, number = threads[place] if place < maker else ("fields", self.thread_that_prepares_fields(session))
            with self.subTest(name, place=place):
                volume = self.ask_page(session, "/api/scene")["volume"]
                size = session.recording.stat().st_size
                then_ns = time.monotonic_ns()
                self.choose(chosen, number)
                if name == "viewers":
                    session.read_until("an error in the server")
                    self.choose(chosen, 0)
                    self.assertEqual(self.ask_page(session, "/api/scene")["volume"], volume)
                    session.wait_until(lambda: session.recording.stat().st_size > size, "it records more")
                    session.process.terminate()
                elif name == "fields":
                    # it gives up what it was about, and is there for what is asked next
                    time.sleep(self.random.uniform(0, 0.2))
                    self.choose(chosen, 0)
                    self.feel_b_spline(session)
                    session.wait_until(lambda: session.recording.stat().st_size > size, "it records more")
                    session.process.terminate()
                elif name in ("viewer-volumes", "viewer-pictures"):
                    view = f"/api/picture/{volume['hash']}?view=16,16,0,0,0,1,0,0,0,1,0"
                    # nobody answers
                    with contextlib.suppress(OSError, http.client.HTTPException):
                        self.ask_page(session, f"/api/volume/labels/{volume['hash']}" if name == "viewer-volumes" else view)
                code, _, told = session.end()
                dies = name not in ("viewers", "fields")
                self.assertEqual(code, -signal.SIGABRT if dies else cli.OK, told)
                self.assertEqual("thrown for a test" in told, dies, told)
                self.assertEqual([event["kind"] for event in session.events()], ["death"] * dies)
                if dies:
                    seen_ms.append((session.events()[0]["halted_ns"] - then_ns) / 1e6)
                self.assert_replays(session.recording, whole=not dies)
                self.assert_nothing_left(claims=2 * dies)
        if seen_ms:
            self.print_figures("seen after the exception was due", seen_ms)


if __name__ == "__main__":
    cli.main()
