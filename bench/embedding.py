#!/usr/bin/env python3
"""Overhead of palpate called from C and Python relative to C++, measured in one process, and speed of the
reinforcement-learning environment relative to real time.

    PALPATE_LIBRARY=libpalpate.so.1 PALPATE=palpate bench/embedding.py build/bench/bench/libembedding_ticks.so [DATA] [--json FILE]

Ticks follow the path of a simulated hand on `palpation-block`; the hash of all of them is the same in every language, or nothing is
timed. Each round times every contender once, by the processor time of the thread; the figures are medians. Short runs are compared
with as many runs of the program, by the processor time of all processes. DATA has the folder knee_dess, a real knee: an environment
steps on it, and without DATA on the phantom of a knee.
"""

import argparse
import ctypes
import json
import os
import pathlib
import resource
import statistics
import subprocess
import sys
import tempfile
import time

sys.dont_write_bytecode = True
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "bindings/python"))

import numpy as np

import palpate as pp
from palpate import _library as c

SCENE = "palpation-block:spacing=2"
DT_S = 1e-3


def median_us(works, rounds, ticks):
    """{name: microseconds of processor time for each of the ticks that a call of works[name] does}."""
    taken = {name: [] for name in works}
    for _ in range(rounds):
        for name, work in works.items():
            begin = time.thread_time()
            work()
            taken[name].append((time.thread_time() - begin) / ticks * 1e6)
    return {name: statistics.median(times) for name, times in taken.items()}


def ticks(library, rounds):
    """A tick in C++, in C and in Python."""
    bench = ctypes.CDLL(library)
    bench.bench_cpp_open.restype = ctypes.c_void_p
    bench.bench_cpp_ticks.argtypes = (ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_double)
    bench.bench_cpp_run.argtypes, bench.bench_cpp_run.restype = bench.bench_cpp_ticks.argtypes, ctypes.c_double
    bench.bench_cpp_hash.argtypes, bench.bench_cpp_hash.restype = (ctypes.c_void_p,), ctypes.c_uint64
    bench.bench_cpp_close.argtypes = (ctypes.c_void_p,)
    bench.bench_c_ticks.argtypes = (ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_double)
    model = pp.load(SCENE)
    tips = np.ascontiguousarray(pp.simulate(model, seed=1).records["tip_world_mm"])
    count = len(tips)
    cpp, cpp_run = bench.bench_cpp_open(SCENE.encode()), bench.bench_cpp_open(SCENE.encode())
    sessions = {name: pp.Session(model, frame="world") for name in ("C", "C batch", "Python, views", "Python, arrays", "Python batch, records")}
    poses = sessions["C batch"]._empty_poses(count)
    poses["tip_mm"][:, 0] = tips
    tick = ctypes.cast(c.lib.plp_session_tick, ctypes.c_void_p)

    def python_views():
        session = sessions["Python, views"]
        tip, advance = session.tip, session.advance
        for at in tips:
            tip[:] = at
            advance()

    def python_arrays():
        step = sessions["Python, arrays"].tick
        for at in tips:
            step(at)

    works = {"C++": lambda: bench.bench_cpp_ticks(cpp, tips.ctypes.data, count, DT_S),
             "C": lambda: c.check(bench.bench_c_ticks(sessions["C"]._handle, tick, tips.ctypes.data, count, DT_S)),
             "C batch": lambda: c.check(c.lib.plp_session_run(sessions["C batch"]._handle, poses.ctypes.data, count, DT_S, None, None)),
             "Python, views": python_views, "Python, arrays": python_arrays,
             "C++, records": lambda: bench.bench_cpp_run(cpp_run, tips.ctypes.data, count, DT_S),
             "Python batch, records": lambda: sessions["Python batch, records"].run(tips, dt=DT_S)}
    for work in works.values():
        work()
    hashes = {bench.bench_cpp_hash(cpp), bench.bench_cpp_hash(cpp_run), *(session.hash for session in sessions.values())}
    if len(hashes) != 1:
        sys.exit(f"embedding.py: runs differ: {hashes}")
    found = median_us(works, rounds, count)
    # the loop itself, and writing a position into an array, are the caller's
    tip = sessions["Python, views"].tip

    def empty():
        for at in tips:
            tip[:] = at

    loop_us = median_us({"loop": empty}, rounds, count)["loop"]
    for session in (cpp, cpp_run):
        bench.bench_cpp_close(session)
    print(f"{count} ticks of a hand on {SCENE}, {rounds} rounds; a loop in Python that writes the positions takes {loop_us:.2f} µs")
    for name, us in found.items():
        extra = us - found["C++"] - (loop_us if name.startswith("Python,") else 0)
        print(f"{name:24}{us:8.3f} µs{extra:+8.3f} µs{us / found['C++']:8.2f}")
    print(f"Python batch with records beside C++ with records: {found['Python batch, records'] / found['C++, records']:.2f}")
    return {**found, "Python loop": loop_us}


def short_runs(count):
    """Runs with a stiffness each, in one process and by the program."""
    def spent_s():
        return sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))

    with tempfile.TemporaryDirectory() as folder:
        script = pathlib.Path(folder, "press.toml")
        script.write_text('[[step]]\napproach = "patella"\n[[step]]\npress = 0.5\n[[step]]\nleave = true\n', encoding="utf-8")
        begin = spent_s()
        model = pp.load("knee-phantom")
        for seed in range(count):
            pp.simulate(model, script, seed=seed)
        python_s = spent_s() - begin
        begin = spent_s()
        for seed in range(count):
            subprocess.run([os.environ["PALPATE"], "simulate", "knee-phantom", "--script", str(script), "--seed", str(seed)], check=True,
                           stdout=subprocess.DEVNULL)
        program_s = spent_s() - begin
    print(f"{count} short runs: {python_s:.2f} s in Python, {program_s:.2f} s by the program, ratio {python_s / program_s:.2f}")
    return {"Python": python_s, "program": program_s}


def environment(data, rounds):
    """Simulated seconds per second of processor time: an environment strokes a patient at 1 kHz, by 50 actions a second."""
    knee = pp.load(str(next(pathlib.Path(data, "knee_dess").glob("*.nrrd"))) if data else "knee-phantom")
    found = {}
    for model, law in ((knee, False), (pp.load(SCENE), False), (pp.load(SCENE), True)):
        env = pp.Env(model, solve_soft_tissue=law, seconds=1e9)
        seen, _ = env.reset(seed=1)
        start, up = seen["tip"], env.up
        side = np.cross(up, [1, 0, 0])
        times, forces = [], []
        steps = 100
        for n in range(rounds):
            begin = time.process_time()
            for step in range(steps):
                # down through the clearance of 3 mm and 2 mm into the patient, then to and fro
                depth = min(5, 0.1 * (n * steps + step))
                target = start - depth * up + 3 * np.sin(0.05 * step) * side
                seen, *_ = env.step(np.r_[target, 1, 0, 0, 0])
                forces.append(np.linalg.norm(seen["force"]))
            times.append(time.process_time() - begin)
        kind = f"{model.title}, {'solved tissue' if law else 'layers'}"
        found[kind] = steps / 50 / statistics.median(times)
        print(f"Env on {kind}: {found[kind]:.1f} times real time a core; in contact in "
              f"{100 * np.mean(np.array(forces) > 0.01):.0f} % of the steps, up to {max(forces):.2f} N")
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("library", help="libembedding_ticks.so")
    parser.add_argument("data", nargs="?", help="folder with knee_dess")
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--json", help="file for the figures")
    given = parser.parse_args()
    figures = {"tick_us": ticks(given.library, given.rounds), "runs_s": short_runs(given.runs),
               "env_times_real_time": environment(given.data, given.rounds)}
    if given.json:
        pathlib.Path(given.json).write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
