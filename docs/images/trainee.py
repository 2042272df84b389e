"""Writes the script by which a trainee of tests/e2e/trainees.py does a task.

usage: trainee.py TASK KIND SEED > SCRIPT.toml    of trace-an-edge, bone-to-plan and others, as an expert, heavy and others do them
"""

import os
import sys

sys.dont_write_bytecode = True
sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "..", "tests", "e2e"))
import trainees  # noqa: E402

if __name__ == "__main__":
    if len(sys.argv) != 4 or sys.argv[1] not in trainees.TASKS:
        sys.exit(__doc__)
    print(trainees.script_text(sys.argv[1], sys.argv[2], int(sys.argv[3])), end="")
