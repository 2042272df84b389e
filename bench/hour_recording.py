#!/usr/bin/env python3
"""An hour of palpation, at 1 or 10 kHz: simulated, replayed, reported. Says the time and the most memory of each.

usage: hour_recording.py [--palpate PROGRAM] [--minutes 59] [--rate 1000] [--folder FOLDER] [TARGET]

The memory is the most that the program, or the process in which it reads HDF5, had at a time (getrusage). Exit code 1 where replay or report take more than 300 MB, or the run does not replay.
"""

import argparse
import os
import pathlib
import subprocess
import sys
import tempfile
import time

MOST_MB = 300
# two structures in turn, with everything that a script can ask for
VISIT = """
[[step]]
approach = "{structure}"
[[step]]
press = 0.8
[[step]]
hold = 20.0
[[step]]
slide = 3.0
direction = "left"
[[step]]
leave = true
"""


def measured(*command):
    """Exit code, output, seconds and MB of a command."""
    begun = time.monotonic()
    process = subprocess.Popen([str(word) for word in command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    output = process.stdout.read()
    _, status, used = os.wait4(process.pid, 0)
    return os.waitstatus_to_exitcode(status), output, time.monotonic() - begun, used.ru_maxrss * 1024 / 1e6


def main():
    arguments = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    arguments.add_argument("target", nargs="?", default="knee-phantom", help="a data set or a scene file")
    arguments.add_argument("--palpate", default="build/release/apps/palpate/palpate")
    arguments.add_argument("--minutes", type=float, default=59.0, help="of palpation, below 60")
    arguments.add_argument("--rate", type=int, default=1000, help="ticks a second, at most 10000")
    arguments.add_argument("--structures", nargs="+", default=["femur", "tibia"])
    arguments.add_argument("--folder", type=pathlib.Path, help="keeps the recording and the report there")
    options = arguments.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.folder or pathlib.Path(temporary)
        script, run, page = folder / "hour.toml", folder / "hour.h5", folder / "hour.html"

        # how long a visit takes, then as many as there is time for
        def simulate(visits):
            names = [options.structures[i % len(options.structures)] for i in range(visits)]
            script.write_text("".join(VISIT.format(structure=name) for name in names))
            return measured(options.palpate, "simulate", options.target, "--script", script, "-o", run, "--rate", options.rate)

        few = len(options.structures)
        code, output, _, _ = simulate(few)
        if not run.exists():
            sys.exit(output)
        ticks = int(output.split(" ticks")[0].split()[-1])
        visits = max(few, int(options.minutes * 60 * options.rate / (ticks / few)))
        failed = False
        for name, work in (
            ("simulate", lambda: simulate(visits)),
            ("replay", lambda: measured(options.palpate, "replay", run, *target_of(options))),
            ("report", lambda: measured(options.palpate, "report", run, *target_of(options), "-o", page)),
        ):
            code, output, seconds, megabytes = work()
            # a step that the hand does not reach ends with 3, and is recorded all the same
            bad = code not in (0, 3) if name == "simulate" else code != 0 or megabytes > MOST_MB
            failed = failed or bad
            if bad and code != 0:
                sys.exit(output)
            print(f"{name:9} {seconds:8.1f} s {megabytes:8.1f} MB  exit code {code}{'  TOO MUCH' if bad else ''}", flush=True)
            lines = [line for line in output.splitlines() if "identical" in line or " ticks" in line]
            print("".join(f"          {line}\n" for line in lines[-1:]), end="", flush=True)
        print(f"recording {run.stat().st_size / 1e6:.1f} MB, report {page.stat().st_size / 1e6:.2f} MB")
        sys.exit(failed)


def target_of(options):
    return [] if options.target == "knee-phantom" else [options.target]


if __name__ == "__main__":
    main()
