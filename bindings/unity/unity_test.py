#!/usr/bin/env python3
"""Palpate.cs over libpalpate.so: its structs are the library's, member by member; it is compiled by mcs and its example run by mono
where they are installed, to the same hash as Python's. Viewer.cs reads the messages of the manual, and receives them there.

    PALPATE_LIBRARY=libpalpate.so PALPATE=palpate unity_test.py
"""

import ctypes
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import unittest

sys.dont_write_bytecode = True
HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent / "python"), str(HERE.parents[1] / "tests")]

try:
    import numpy as np
except ImportError:
    print("no NumPy for this Python")
    sys.exit(77)

import palpate as pp
import tick_stream
from palpate import _library

SOURCE = (HERE / "Runtime/Palpate.cs").read_text(encoding="utf-8")
VIEWER = (HERE / "Runtime/Viewer.cs").read_text(encoding="utf-8")
PLAIN = {"double": ctypes.c_double, "uint": ctypes.c_uint32, "int": ctypes.c_int32, "ulong": ctypes.c_uint64, "Flags": ctypes.c_uint32}
STRUCTS = {"Pose": "plp_pose", "Wrench": "plp_wrench", "Record": "plp_record", "SessionOptions": "plp_session_options"}


def spelled(name):
    """A member of palpate.h in C#'s spelling: tip_world_mm is TipWorldMm."""
    return "".join(part[:1].upper() + part[1:] for part in name.split("_"))


def structs():
    """The structs of Palpate.cs as ctypes lays them out, in order."""
    made = dict(PLAIN)
    for name, body in re.findall(r"StructLayout\(LayoutKind\.Sequential\)\]\s*public struct (\w+)\s*\{(.*?)\n? *\}(?=\n)", SOURCE, re.DOTALL):
        fields = [(member.strip(), made[kind]) for kind, members in re.findall(r"public (\w+) ([\w, ]+);", body) for member in members.split(",")]
        made[name] = type(name, (ctypes.Structure,), {"_fields_": fields})
    return made


# numbers in a message, by the function that reads them
READ = {"UInt32": ("u32", 1), "UInt64": ("u64", 1), "Single": ("f32", 1), "Double": ("f64", 1), "Vector": ("f32", 3), "Quaternion": ("f32", 4)}


def compiled(folder, *sources):
    """A program of C# sources; skips the test where there is no mono."""
    absent = [program for program in ("mcs", "mono") if shutil.which(program) is None]
    if absent:
        raise unittest.SkipTest(f"not installed: {', '.join(absent)} (packages mono-mcs and mono-runtime)")
    program = pathlib.Path(folder) / "Program.exe"
    subprocess.run(["mcs", f"-out:{program}", *(HERE / source for source in sources)], check=True)
    return program


class CSharp(unittest.TestCase):
    def test_its_structs_are_those_of_the_library(self):
        made = structs()
        for name, in_c in STRUCTS.items():
            with self.subTest(name):
                library = list(_library._fields(in_c))
                self.assertEqual([member for member, _ in made[name]._fields_], [spelled(member) for member, _, _ in library])
                for (member, kind), (_, their_kind, offset) in zip(made[name]._fields_, library):
                    self.assertEqual(getattr(made[name], member).offset, offset, member)
                    self.assertEqual(ctypes.sizeof(kind), ctypes.sizeof(their_kind), member)
                self.assertEqual(ctypes.sizeof(made[name]), _library.lib.plp_struct_size(in_c.encode()))

    def test_each_function_that_it_calls_is_there(self):
        called = set(re.findall(r"extern \w+ (plp_\w+)\(", SOURCE))
        self.assertGreater(len(called), 10)
        for name in called:
            self.assertTrue(hasattr(_library.lib, name), name)

    def test_the_example_runs_to_the_hash_of_python(self):
        with tempfile.TemporaryDirectory() as folder:
            program = compiled(folder, "Runtime/Palpate.cs", "Samples/TwoHands.cs")
            (pathlib.Path(folder) / "libpalpate.so").symlink_to(os.environ["PALPATE_LIBRARY"])
            said = subprocess.run(["mono", program], stdout=subprocess.PIPE, text=True, check=True,
                                  env={**os.environ, "LD_LIBRARY_PATH": folder}).stdout
        heights = 80 - 0.03 * np.arange(2000)
        tips = np.stack([np.stack([np.full(2000, x), np.zeros(2000), heights], axis=1) for x in (-15.0, 15.0)], axis=1)
        session = pp.Session(pp.load("knee-phantom:spacing=3"), frame="world", devices=2)
        session.run(tips)
        self.assertIn(f"hash {session.hash:016x}", said)

    def test_its_viewer_reads_the_messages_of_the_manual(self):
        for part in ("tick", "device"):
            # (Flags) and new DeviceSample[] are of the number of devices and the flags
            read = re.findall(rf"\b{part}\.(\w+) = (?:\(Flags\)|new DeviceSample\[)?wire\.(\w+)\(\)", VIEWER)
            expected = [("Device" if name == "devices" else spelled(name), (kind, count)) for name, kind, count in tick_stream.layout(part)]
            self.assertEqual([(name, READ[how]) for name, how in read], expected)

    def test_its_viewer_receives_every_tick(self):
        with tempfile.TemporaryDirectory() as folder:
            program = compiled(folder, "Runtime/Palpate.cs", "Runtime/Viewer.cs", "Samples/WatchTicks.cs")
            session = subprocess.Popen([os.environ["PALPATE"], "explore", "knee-phantom:spacing=3", "--port", "0", "--repeat"], text=True,
                                       stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
            try:
                port = next(found.group(1) for line in session.stderr if (found := re.search(r"open http://127\.0\.0\.1:(\d+)/", line)))
                said = subprocess.run(["mono", program, f"ws://127.0.0.1:{port}/ws", "2000"], stdout=subprocess.PIPE, text=True, check=True).stdout
            finally:
                session.send_signal(signal.SIGINT)
                session.wait()
                session.stderr.close()
        self.assertRegex(said, r"^\d{4} ticks to \d+, 0 lost, ")


if __name__ == "__main__":
    unittest.main(verbosity=2)
