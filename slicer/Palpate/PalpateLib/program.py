"""The program palpate: where it is, and a session of it."""

import collections
import os
import re
import shutil
import signal
import subprocess
import threading

from .errors import PalpateError

PUBLISHED = re.compile(r"OpenIGTLink at (\S+) port (\d+)")
PAGE = re.compile(r"open (https?://\S+)")
# preparation of a large scan takes minutes
START_WITHIN_S = 600
END_WITHIN_S = 15


def find_program(given=""):
    """@param given  a path chosen by the user; empty: searched for in PALPATE and in PATH
    @returns the path of the program"""
    for path in (given, os.environ.get("PALPATE", "")):
        if path:
            if os.access(path, os.X_OK) and os.path.isfile(path):
                return path
            raise PalpateError("is no program", path, "choose the file palpate itself")
    found = shutil.which("palpate")
    if found is None:
        raise PalpateError("palpate is not found on this machine", "",
                           "install it (docs/guide/packages.md), or choose the file palpate")
    return found


def run_program(program, arguments, environment=None):
    """Runs a verb to its end. @returns its output; raises PalpateError with palpate's own message"""
    done = subprocess.run([program, *map(str, arguments)], stdin=subprocess.DEVNULL, capture_output=True, text=True,
                          errors="replace", env=environment, check=False)
    if done.returncode != 0:
        raise PalpateError(_error_text(done.stderr.splitlines()) or f"ended with code {done.returncode}", "palpate")
    return done.stdout


def _error_text(lines):
    """palpate's own error, without its prefix."""
    for n, line in enumerate(lines):
        if line.startswith("palpate: error: "):
            return "\n".join([line[len("palpate: error: "):], *lines[n + 1:]])
    return "\n".join(list(lines)[-3:])


class Session:
    """A running `palpate explore`, which publishes by OpenIGTLink at a free port of this machine."""

    def __init__(self, program, arguments, environment=None):
        """Waits until it publishes and its page is served. @param arguments  those of explore, without --openigtlink"""
        command = [program, "explore", *map(str, arguments), "--openigtlink", "0"]
        try:
            self._process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                                             stderr=subprocess.PIPE, text=True, errors="replace", env=environment)
        except OSError as error:
            raise PalpateError(f"cannot be started ({error.strerror})", program) from error
        self._lines = collections.deque(maxlen=200)
        self._has_page = "--no-viewer" not in command
        self._published = threading.Event()
        self.port, self.page = None, None
        self._reader = threading.Thread(target=self._read, name="palpate messages", daemon=True)
        self._reader.start()
        if not self._published.wait(START_WITHIN_S) or self.port is None:
            self.end()
            raise PalpateError(_error_text(list(self._lines)) or "did not begin", "palpate")

    def is_running(self):
        return self._process.poll() is None

    def fault(self):
        """Why it ended by itself; empty while it runs and after an orderly end."""
        return "" if self._process.poll() in (None, 0) else _error_text(list(self._lines))

    def end(self):
        """Ends it as Ctrl-C does: the force fades out first."""
        if self.is_running():
            self._process.send_signal(signal.SIGINT)
        try:
            self._process.wait(END_WITHIN_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join()
        self._process.stderr.close()

    def _read(self):
        for line in self._process.stderr:
            self._lines.append(line.rstrip("\n"))
            if found := PAGE.search(line):
                self.page = found.group(1)
            if found := PUBLISHED.search(line):
                self.port = int(found.group(2))
            if self.port is not None and (self.page is not None or not self._has_page):
                self._published.set()
        self._published.set()
