"""What the end-to-end tests share: running palpate, finding data, skipping visibly."""

import ctypes
import faulthandler
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import shared_cache

PALPATE = os.environ["PALPATE"]
# it checks itself, and takes several times as long
SANITIZED = bool(os.environ.get("PALPATE_SANITIZE"))
# voxel edge of the generated knee in tests that do not depend on image detail, mm
KNEE_MM = "2.0" if SANITIZED else "1.5"
# a script for where the whole palpation is no matter either
TOUCH = '[[step]]\napproach = "femur"\nspeed = 200.0\n[[step]]\npress = 0.8\n'

# nothing is taken from the user's cache, or left in it
os.environ["PALPATE_CACHE"] = ""


def share_prepared_models():
    """From here on runs of this script take what tests of this build have prepared. Not where preparing is the subject."""
    shared_cache.share_prepared_models(PALPATE)


# the verbs as a library; a sanitized one cannot be loaded into a Python that is not
VERBS = None if SANITIZED or not os.environ.get("PALPATE_VERBS") else ctypes.CDLL(os.environ["PALPATE_VERBS"])
# verbs that start the program's own file again, or become another program
IN_A_PROCESS = {"explore", "cohort", "doctor", "verify", "supervise"}

OK, BAD_INPUT, USAGE, LIMIT, OUTPUT, UNAVAILABLE, INTERRUPTED = 0, 1, 2, 3, 4, 5, 130


def spawn(*arguments, **options):
    """Runs the palpate binary in a process of its own. For tests of process behaviour: crashes, signals, limits,
    privileges, environment, standard streams, and input that may crash a parser. Returns what run() does."""
    return subprocess.run([PALPATE, *map(str, arguments)], capture_output=True, text=True,
                          errors="replace", stdin=subprocess.DEVNULL, timeout=600, **options)


def run(*arguments, env=None):
    """Runs a command line of palpate and returns the finished process, its output as text. It runs in this process where
    the build has the verbs as a library, and the verb needs no process of its own.

    @param env  the whole environment of the run
    """
    words = list(map(str, arguments))
    if VERBS is None or not IN_A_PROCESS.isdisjoint(words):
        return spawn(*words, env=env)
    environment = dict(os.environ)
    nothing, out, err = os.open(os.devnull, os.O_RDONLY), os.memfd_create("out"), os.memfd_create("err")
    try:
        if env is not None:
            set_environment(env)
        code = VERBS.palpate_run(len(words), (ctypes.c_char_p * len(words))(*map(os.fsencode, words)), nothing, out, err)
        return subprocess.CompletedProcess([PALPATE, *words], code, *map(text_of, (out, err)))
    finally:
        set_environment(environment)
        for descriptor in (nothing, out, err):
            os.close(descriptor)


def spawn_only():
    """From here on every run of this script is a process of its own."""
    global VERBS
    VERBS = None


def set_environment(environment):
    """Replaces the environment of this process; no other thread may read it at the same time."""
    for name in os.environ.keys() - environment.keys():
        del os.environ[name]
    for name, value in environment.items():
        if os.environ.get(name) != value:
            os.environ[name] = value


def text_of(descriptor):
    """As subprocess reads text."""
    with open(descriptor, encoding="utf-8", errors="replace", closefd=False) as file:
        file.seek(0)
        return file.read()


def shared_data(name):
    """A file below a folder of PALPATE_DATA, or None."""
    for folder in os.environ.get("PALPATE_DATA", "").split(":"):
        if folder and (pathlib.Path(folder) / name).exists():
            return pathlib.Path(folder) / name
    return None


def need(name):
    """A file below a folder of PALPATE_DATA; without it the test is skipped, in CI it fails."""
    path = shared_data(name)
    if path is None:
        missing(f"{name} in a folder of PALPATE_DATA")
    return path


def unprivileged_prefix():
    """Command prefix that runs a program as an unprivileged user, so that file permissions apply; empty if this process
    is not root. Without setpriv the test fails in CI and is skipped elsewhere."""
    if os.geteuid() != 0:
        return []
    command = ["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"]
    if shutil.which(command[0]) is None:
        missing("setpriv (util-linux)")
    return command


def sigint_is_in(field, process):
    """Whether SIGINT is set in a signal mask of a process, `field` of /proc/PID/status: "SigCgt" (handled) or "ShdPnd"
    (pending)."""
    status = pathlib.Path(f"/proc/{process.pid}/status").read_text()
    signals = int(re.search(rf"^{field}:\s*(\w+)$", status, re.MULTILINE).group(1), 16)
    return bool(signals >> (signal.SIGINT - 1) & 1)


def wait_for_handler(process):
    """Waits until the process has installed a handler for SIGINT, or has ended; before that SIGINT would kill it."""
    while process.poll() is None and not sigint_is_in("SigCgt", process):
        time.sleep(0.01)


def missing(what):
    """Skips the test, or fails it in CI."""
    if os.environ.get("CI") == "true":
        raise AssertionError(f"needs {what}")
    raise unittest.SkipTest(f"needs {what}")


def device_columns(recording, *names):
    """{name: values by tick} of a recording's first device. h5py belongs to the system's Python, which need not be this one."""
    read = ("import h5py, json, sys\nwith h5py.File(sys.argv[1]) as run:\n"
            "    print(json.dumps({name: run['device0'][name][:].tolist() for name in sys.argv[2:]}))")
    done = subprocess.run(["/usr/bin/python3", "-c", read, recording, *names], capture_output=True, text=True)
    if "No module named" in done.stderr:
        missing("python3-h5py")
    if done.returncode != 0:
        raise AssertionError(done.stderr)
    return json.loads(done.stdout)


def contact_figures(stdout):
    """{structure: (held s, mean N, peak N)} from what simulate prints."""
    rows = re.findall(r"^(\S+) +([\d.]+) +([\d.]+) +([\d.]+)$", stdout, re.MULTILINE)
    return {name: tuple(map(float, values)) for name, *values in rows}


def run_hash(stdout):
    return re.search(r"run hash ([0-9a-f]{16})", stdout).group(1)


class PalpateTest(unittest.TestCase):
    def setUp(self):
        self._folder = tempfile.TemporaryDirectory(prefix="palpate-e2e-")
        self.folder = pathlib.Path(self._folder.name)

    def tearDown(self):
        self._folder.cleanup()

    def succeed(self, *arguments, runner=run, **options):
        """@param runner  run or spawn"""
        done = runner(*arguments, **options)
        self.assertEqual(done.returncode, OK, f"palpate {arguments}: {done.stderr}")
        return done

    def expect_error(self, code, *arguments, message="", runner=run, **options):
        """Fails with this exit code and one clear error, without a trace of a crash. @param runner  run or spawn"""
        done = runner(*arguments, **options)
        self.assertEqual(done.returncode, code, f"palpate {arguments}: {done.stdout} {done.stderr}")
        self.assertEqual(done.stderr.count("palpate: error:"), 1, done.stderr)
        self.assertNotIn("bug:", done.stderr)
        self.assertNotIn("terminate called", done.stderr)
        self.assertNotIn("Sanitizer", done.stderr)
        self.assertIn(message, done.stderr)
        return done


class KneeTest(PalpateTest):
    """Provides a coarse generated knee: cls.scan, cls.labels, cls.scene (path for new_scene()) and cls.script, a short
    palpation."""

    @classmethod
    def setUpClass(cls):
        cls._made = tempfile.TemporaryDirectory(prefix="palpate-e2e-")
        made = pathlib.Path(cls._made.name)
        assert run("data", "fetch", "knee-phantom", "-o", made / "knee", "--voxel", KNEE_MM).returncode == OK
        cls.labels = next((made / "knee").glob("*.seg.nrrd"))
        cls.scan = next(p for p in (made / "knee").glob("*.n*") if p != cls.labels and "seg" not in p.name)
        cls.scene, cls.script = made / "scene.toml", made / "touch.toml"
        cls.script.write_text(TOUCH)

    @classmethod
    def tearDownClass(cls):
        cls._made.cleanup()

    @classmethod
    def new_scene(cls, *files):
        done = run("scene", "new", *files, "-o", cls.scene)
        assert done.returncode == OK, done.stderr

    def scene_without_title(self, title=""):
        """The scene's text, its title another or none."""
        plain = re.sub("(?m)^title = .*$", "", self.scene.read_text())
        return plain.replace("[data]", f'title = "{title}"\n\n[data]', 1) if title else plain

    def draw(self, verb, name, *arguments):
        """Draws into a file of that name; nothing else is written or printed."""
        file = self.folder / name
        file.unlink(missing_ok=True)
        done = self.succeed(verb, *arguments, "-o", file)
        # how far long work has got is told too, and how much of the labels lies inside the scan
        said = [line for line in done.stderr.splitlines() if not line.endswith((" %", "lie inside the scan."))]
        self.assertEqual((done.stdout, said), ("", [f"picture: {file}"]))
        self.assertEqual([p.name for p in self.folder.iterdir()], [name])
        return file

    def check_what_cannot_be_drawn(self, verb, ending, cases):
        """@param cases  (exit code, arguments, what the error says), besides those of every picture"""
        file = self.folder / f"picture{ending}"
        for code, arguments, message in [
                (BAD_INPUT, ["--at", "500,0,0"], "--at: the point 500.0, 0.0, 0.0 mm lies outside the volume"),
                (USAGE, ["--at", "a,b,c"], "a is not a number"),
                (USAGE, ["--at", "1,2"], "--at"),
                (USAGE, ["--size", "0"], "number between"), *cases]:
            with self.subTest(arguments):
                self.expect_error(code, verb, self.scene, *arguments, "-o", file, message=message)
        self.expect_error(USAGE, verb, self.scene, message="--output")
        self.expect_error(BAD_INPUT, verb, self.folder / "missing.toml", "-o", file, message="missing")
        self.assertEqual(list(self.folder.iterdir()), [])

    def check_outputs_that_cannot_be_written(self, verb, ending, another):
        """@param ending   file extension that the verb writes @param another  extension that it rejects"""
        missing = self.folder / "missing" / f"picture{ending}"
        self.expect_error(OUTPUT, verb, self.scene, "-o", missing, message="missing")
        self.expect_error(OUTPUT, verb, self.scene, "-o", self.folder, message="folder")
        before = self.labels.read_bytes()
        self.expect_error(USAGE, verb, self.scene, "-o", self.labels, message="would replace an input")
        self.assertEqual(self.labels.read_bytes(), before)
        self.expect_error(USAGE, verb, self.scene, "-o", self.folder / f"picture{another}", message=f"ends in {ending}")
        self.assertEqual(list(self.folder.iterdir()), [])


def long(test):
    """Marks a test that is long by nature: it runs in the script's part `long`, all others in `short`."""
    test.is_long = True
    return test


class PartLoader(unittest.TestLoader):
    """Loads one part of a script's tests."""

    def __init__(self, part):
        super().__init__()
        self.part = part

    def getTestCaseNames(self, case):
        return [name for name in super().getTestCaseNames(case)
                if getattr(getattr(case, name), "is_long", False) == (self.part == "long")]


def end_before_timeout():
    """Prints where the test stands and ends it half a minute before ctest would kill it. A thread waits for that."""
    if "TIMEOUT_S" in os.environ:
        faulthandler.dump_traceback_later(float(os.environ["TIMEOUT_S"]) - 30, exit=True)


def main():
    """Runs the script's tests: all of them, or with `--part short` or `--part long` one part."""
    loader = unittest.defaultTestLoader
    if sys.argv[1:2] == ["--part"]:
        loader = PartLoader(sys.argv[2])
        del sys.argv[1:3]
    end_before_timeout()
    result = unittest.main(exit=False, testLoader=loader).result
    if result.wasSuccessful() and result.testsRun and len(result.skipped) == result.testsRun:
        sys.exit(77)
    sys.exit(not result.wasSuccessful())
