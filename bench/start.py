#!/usr/bin/env python3
"""Duration of cold and warm starts of a scene until the model is ready for the default method. Each start is a process
of start_bench; cold starts have an empty cache, warm ones the cache of the first.

    bench/start.py build/bench/bench/start_bench [--repeat N] SCENE...
"""

import argparse
import os
import pathlib
import resource
import statistics
import subprocess
import tempfile
import time


def start(program, scene, cache):
    """(wall s, processor s, the hashes, MiB)"""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    begun = time.monotonic()
    done = subprocess.run([program, scene], env={**os.environ, "PALPATE_CACHE": cache}, check=True, capture_output=True,
                          text=True)
    wall = time.monotonic() - begun
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    model, surfaces, mebibytes = done.stdout.split()
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, (model, surfaces), int(mebibytes)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("program")
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--repeat", type=int, default=5)
    options = parser.parse_args()
    median = statistics.median
    print(f"medians of {options.repeat}: s of time / s of processor / MiB at most")
    for scene in options.scenes:
        first, later = [], []
        for _ in range(options.repeat):
            # by turns, so that what else the machine does is the same to both
            with tempfile.TemporaryDirectory() as cache:
                first.append(start(options.program, scene, cache))
                later.append(start(options.program, scene, cache))
                kept = sum(path.stat().st_size for path in pathlib.Path(cache).iterdir())
        assert len({hashes for _, _, hashes, _ in first + later}) == 1, "not the same model"
        columns = [f"{median(s[0] for s in starts):.2f} / {median(s[1] for s in starts):.2f} / {median(s[3] for s in starts)}"
                   for starts in (first, later)]
        ratio = median(f[0] / l[0] for f, l in zip(first, later))
        print(f"{pathlib.Path(scene).name}: first {columns[0]}; later {columns[1]}; {ratio:.1f} times as fast; "
              f"{kept / 1e6:.1f} MB kept", flush=True)


if __name__ == "__main__":
    main()
