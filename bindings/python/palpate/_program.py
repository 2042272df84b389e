"""The command `palpate` of a wheel: replaces itself by the program that the wheel carries."""

import os
import pathlib
import sys


def main() -> None:
    program = pathlib.Path(__file__).resolve().parent / "bin" / "palpate"
    os.execv(program, [str(program), *sys.argv[1:]])
