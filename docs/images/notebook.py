"""Runs the notebook docs/guide/python.ipynb in the working folder, cell by cell in one namespace as Jupyter does. Its figures go to
files alone.

usage: notebook.py PICTURE...     with the `palpate` of a build folder on the PATH

Fails unless each picture named is there afterwards and has more than one colour.
"""

import json
import os
import pathlib
import shutil
import sys

sys.dont_write_bytecode = True
ROOT = pathlib.Path(__file__).resolve().parents[2]
os.environ["MPLBACKEND"] = "Agg"
os.environ.setdefault("PALPATE_LIBRARY", str(pathlib.Path(shutil.which("palpate") or "").resolve().parents[2] / "src/bindings/c/libpalpate.so"))
sys.path.insert(0, str(ROOT / "bindings/python"))
from matplotlib import image  # noqa: E402


def main(pictures):
    notebook = json.loads((ROOT / "docs/guide/python.ipynb").read_text(encoding="utf-8"))
    namespace = {"__name__": "__main__"}
    for number, cell in enumerate(notebook["cells"]):
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), f"python.ipynb, cell {number}", "exec"), namespace)
    for name in pictures:
        if not os.path.isfile(name) or image.imread(name).std() == 0:
            sys.exit(f"python.ipynb did not draw {name}")


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    main(sys.argv[1:])
