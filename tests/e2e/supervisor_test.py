"""The supervisor of palpate explore: it watches, is replaced when it dies, and keeps its log."""

import json
import os
import pathlib
import resource
import signal
import time

import cli
from live_session import PRESS, PRESSES, KneeSessionTest


class Supervisor(KneeSessionTest):
    def supervisor_of(self, process):
        """The process that watches another, of its children."""
        children = pathlib.Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        names = {child: pathlib.Path(f"/proc/{child}/cmdline").read_bytes().split(b"\0") for child in children}
        return next(int(child) for child, words in names.items() if b"supervise" in words)

    @cli.long
    def test_a_supervisor_watches_and_is_replaced(self):
        terminal = self.terminal(*self.explore("--repeat"))
        terminal.wait_for(PRESSES)
        supervisor = self.supervisor_of(terminal.process)
        os.kill(supervisor, signal.SIGKILL)
        # nobody watches: nothing pushes, until somebody re-arms
        terminal.wait_for("the supervisor died")
        terminal.wait_for("EMERGENCY STOP")
        another = self.supervisor_of(terminal.process)
        self.assertNotEqual(another, supervisor)
        # whatever the session dies of, its supervisor does not stay behind
        terminal.process.kill()
        terminal.finish()
        self.assert_gone(another)

    def assert_gone(self, process):
        for _ in range(600):
            if not pathlib.Path(f"/proc/{process}").exists():
                break
            time.sleep(0.1)
        self.assertFalse(pathlib.Path(f"/proc/{process}").exists())

    @cli.long
    def test_a_supervisor_that_cannot_be_replaced_is_told_of_once(self):
        log = self.folder / "supervisor.log"
        terminal = self.terminal(*self.explore("--repeat", "--no-viewer", "--supervisor-log", log))
        terminal.wait_for(PRESSES)
        # a slow machine may be warned of other things, its tissue's cells for one
        before = terminal.shown.count("warning:")
        # what it needs for another one are files
        limits = resource.prlimit(terminal.process.pid, resource.RLIMIT_NOFILE)
        resource.prlimit(terminal.process.pid, resource.RLIMIT_NOFILE, (3, limits[1]))
        os.kill(self.supervisor_of(terminal.process), signal.SIGKILL)
        terminal.wait_for(r"warning: the supervisor died, and the force stays off because no other can be started:\s+no supervisor: ")
        terminal.wait_for("EMERGENCY STOP")
        # three more tries
        until = time.monotonic() + 3.5
        terminal.wait_until(lambda: time.monotonic() > until, "the time for more tries")
        self.assertEqual(terminal.shown.count("warning:"), before + 1, terminal.shown)
        self.assertIn("EMERGENCY STOP", terminal.frames()[-2])
        resource.prlimit(terminal.process.pid, resource.RLIMIT_NOFILE, limits)
        terminal.wait_for("a supervisor is running again")
        self.assertEqual(terminal.shown.count("warning:"), before + 2, terminal.shown)
        # and it does, with the log of the one before it
        another = self.supervisor_of(terminal.process)
        terminal.process.kill()
        terminal.finish()
        self.assert_gone(another)
        event, = map(json.loads, log.read_text().splitlines())
        self.assertEqual((event["kind"], event["session"]), ("death", terminal.process.pid))

    @cli.long
    def test_the_log_of_the_supervisor_replaces_nothing(self):
        log, tokens = self.folder / "supervisor.log", self.folder / "tokens"
        log.write_text("of another session\n")
        self.succeed(*self.explore("--seconds", "0.1", "--supervisor-log", log))
        self.assertEqual(log.read_text(), "of another session\n")
        self.succeed("token", "-o", tokens)
        inputs = {path: path.read_bytes() for path in (self.scene, self.script, tokens)}
        viewed = ["--token-file", tokens]
        for path in inputs:
            self.expect_error(cli.USAGE, *self.explore(*viewed, "--supervisor-log", path), message="would replace an input")
            self.expect_error(cli.USAGE, *self.explore(*viewed, "-o", path), message="would replace an input")
        self.assertEqual({path: path.read_bytes() for path in inputs}, inputs)
        recording = self.folder / "run.h5"
        self.expect_error(cli.USAGE, *self.explore("-o", recording, "--supervisor-log", f"{self.folder}/./run.h5"),
                          message="is also the recording")
        self.expect_error(cli.USAGE, *self.explore("--no-supervisor", "--supervisor-log", log), message="without a supervisor")
        self.expect_error(cli.OUTPUT, *self.explore("--supervisor-log", self.folder / "missing" / "log"), message="missing")
        # who has not begun leaves none
        elbow = self.folder / "elbow.toml"
        elbow.write_text(PRESS.replace("femur", "elbow"))
        self.expect_error(cli.BAD_INPUT, "explore", self.scene, "-s", elbow, "--supervisor-log", self.folder / "new.log",
                          message="elbow.toml:1")
        self.assertEqual({path.name for path in self.folder.iterdir()}, {"supervisor.log", "tokens", "elbow.toml"})


class Supervise(cli.PalpateTest):
    def test_supervise_is_called_by_explore_alone(self):
        done = cli.run("supervise", "1", "0", "0")
        self.assertEqual(done.returncode, cli.USAGE)
        self.assertIn("started only by palpate explore", done.stderr)


if __name__ == "__main__":
    cli.share_prepared_models()
    cli.main()
