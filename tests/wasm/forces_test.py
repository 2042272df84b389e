"""Compares the forces of palpate.wasm with those of libpalpate, tick by tick, on a knee and on tissue that deforms.

usage: forces_test.py PALPATE.WASM

A tip presses the scene from several sides: it approaches, slides over what it meets, and leaves. libpalpate leads it by its
forces; palpate.wasm, in Node, gets the same poses. PYTHONPATH and PALPATE_LIBRARY name the Python package and the library.
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import palpate
from palpate import _library as c

LIMIT_N = 1e-6
KNEE, BLOCK = "knee-phantom:spacing=1.5", "palpation-block"
DT_S = 1e-3
SPEED_MM_S, SLIDE_TICKS = 100, 400
FAR_MM = 90


def path(session, sides, press_N):
    """Tips of presses from so many sides and the force of each tick, both (ticks, 3), World."""
    tips, forces = [], []

    def go(tip):
        force, _ = session.tick(tip, dt=DT_S)
        tips.append(np.array(tip))
        forces.append(force)
        return np.linalg.norm(force)

    step = SPEED_MM_S * DT_S
    for angle in np.arange(sides) * 2 * np.pi / sides:
        inward = -np.array([np.cos(angle), np.sin(angle), 0.2])
        inward /= np.linalg.norm(inward)
        aside = np.array([0, 0, 1.0])
        tip = -FAR_MM * inward
        depth = 0
        while go(tip) < press_N and depth < FAR_MM:
            pressed = np.linalg.norm(forces[-1]) > 0.05
            move = step / 10 if pressed else step
            tip, depth = tip + move * inward, depth + move
        for _ in range(SLIDE_TICKS):
            tip = tip + 0.02 * aside
            go(tip)
        for _ in range(200):
            tip = tip - step * inward
            go(tip)
        # to the next side, out of the volume, as fast as a hand moves and not as a jump
        for _ in range(int(2 * FAR_MM / step) + 300):
            away = -FAR_MM * 1.5 * inward
            gap = away - tip
            length = np.linalg.norm(gap)
            if length < step:
                break
            tip = tip + step * gap / length
            go(tip)
    return np.array(tips), np.array(forces)


def compare(module, scene, sides, press_N, passes, soft, folder=None):
    """Compares one scene, a file in `folder` if that is given; `soft` solves deforming tissue, in the ticks of both."""
    begun = time.perf_counter()
    model = palpate.load(Path(folder, scene) if folder else scene)
    native_model_s = time.perf_counter() - begun
    tips, _ = path(palpate.Session(model, frame="world", solve_soft_tissue=soft), sides, press_N)

    poses = np.zeros(len(tips), c.POSE)
    poses["size"] = c.POSE.itemsize
    poses["tip_mm"] = tips
    poses["orientation_wxyz"][:, 0] = 1
    session = palpate.Session(model, frame="world", solve_soft_tissue=soft)
    wrenches = np.zeros(len(tips), c.WRENCH)
    wrenches["size"] = c.WRENCH.itemsize
    native_s = np.inf
    for _ in range(passes):
        c.check(c.lib.plp_session_reset(session._handle))
        begun = time.process_time()
        c.check(c.lib.plp_session_run(session._handle, c.address(poses), len(tips), DT_S, c.address(wrenches), None))
        native_s = min(native_s, time.process_time() - begun)

    with tempfile.TemporaryDirectory() as results:
        files = Path(results, "poses"), Path(results, "wrenches")
        poses.tofile(files[0])
        node = Path(__file__).with_name("run_poses.mjs")
        run = subprocess.run(["node", "--no-warnings", node, module, scene, *files, str(passes), str(int(soft)), folder or results],
                             check=True, capture_output=True, text=True)
        figures = json.loads(run.stdout)
        other = np.fromfile(files[1], c.WRENCH)

    force, difference = wrenches["force_N"], np.abs(wrenches["force_N"] - other["force_N"])
    touching = np.linalg.norm(force, axis=1) > 0
    print(f"{scene}: {len(tips)} ticks, {touching.sum()} with force, at most {np.linalg.norm(force, axis=1).max():.2f} N")
    print(f"largest difference {difference.max():.3g} N; {(difference.max(axis=1) > 0).sum()} ticks differ")
    print(f"tick {1e6 * native_s / len(tips):.2f} us native, {1e6 * figures['ticks_s'] / len(tips):.2f} us WebAssembly, "
          f"ratio {figures['ticks_s'] / native_s:.2f}" + ", solutions included" * soft)
    print(f"model {native_model_s:.2f} s native (with the cache), {figures['model_s']:.2f} s WebAssembly, {figures['memory_MiB']:.0f} MiB")
    assert touching.sum() > 1000, "the path touches too little to compare anything"
    assert difference.max() <= LIMIT_N, f"forces differ by {difference.max()} N"


def main():
    module = Path(sys.argv[1])
    compare(module, KNEE, sides=8, press_N=1.5, passes=5, soft=False)
    compare(module, BLOCK, sides=2, press_N=0.5, passes=1, soft=True)


if __name__ == "__main__":
    main()
