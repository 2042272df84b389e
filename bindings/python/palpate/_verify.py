"""The suites of `palpate verify`, as figures in Python."""

from __future__ import annotations

import json
import os
import pathlib
import shutil
import subprocess
import tempfile
from typing import Any, Dict

from . import _library as c

_EXCEEDED = 3  # exit code: a figure exceeds its limit
_UNAVAILABLE = 5  # exit code: the suites' own program is missing


def _program() -> str:
    """Path of the program: PALPATE_PROGRAM, within a wheel, else as the shell finds it."""
    named = os.environ.get("PALPATE_PROGRAM")
    carried = pathlib.Path(__file__).resolve().parent / "bin" / "palpate"
    found = named or (str(carried) if carried.is_file() else shutil.which("palpate"))
    if not found:
        raise c.Unavailable("verify: the program palpate was not found\n  install it, or name it in PALPATE_PROGRAM")
    return found


def verify(suite: str, **options: Any) -> Dict[str, Any]:
    """Measures palpate on this machine and compares the figures with their limits, as `palpate verify` does. Takes minutes.

    Args:
        suite: "contact", "accuracy", "latency", "stability", "removal" or "tissue".
        options: of the suite "latency": seconds, spin, rate and scene.

    Returns:
        The figures as `--json` writes them (docs/reference/verify.md), and "kept": whether all figures are within their limits.

    Raises:
        BadInput: an unknown suite or option. Unavailable: the program is missing. Internal: it failed.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / "figures.json"
        words = [word for name, value in options.items() for word in (f"--{name}", str(value))]
        try:
            done = subprocess.run([_program(), "verify", str(suite), "--json", str(file), *words], stdout=subprocess.DEVNULL,
                                  stderr=subprocess.PIPE, text=True, errors="replace", check=False)
        except OSError as error:
            raise c.Unavailable(f"verify: {error}\n  name the program in PALPATE_PROGRAM") from error
        if done.returncode not in (0, _EXCEEDED):
            kind = {1: c.BadInput, 2: c.BadInput, _UNAVAILABLE: c.Unavailable}.get(done.returncode, c.Internal)
            raise kind(done.stderr.strip().replace("palpate: error: ", "") or f"verify: exit code {done.returncode}")
        figures: Dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        return {**figures, "kept": done.returncode == 0}
