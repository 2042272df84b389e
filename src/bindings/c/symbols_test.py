#!/usr/bin/env python3
"""What libpalpate.so exports: the functions that palpate.h declares and palpate.map lists, each of one version, and nothing else.
And palpate.h compiles by itself as C99, C11 and C++17 without a warning.

    symbols_test.py LIBRARY CC CXX
"""

import pathlib
import re
import subprocess
import sys
import unittest

HERE = pathlib.Path(__file__).resolve().parent
HEADER = HERE.parents[2] / "include" / "palpate.h"
LIBRARY, CC, CXX = sys.argv[1:4]
WARNINGS = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror", "-fsyntax-only", "-I", str(HEADER.parent)]


class Symbols(unittest.TestCase):
    def test_the_library_exports_what_the_header_declares(self):
        declared = re.findall(r"^PLP_API\s[^;(]*?\b(plp_\w+)\(", HEADER.read_text(encoding="utf-8"), re.MULTILINE)
        listed = re.findall(r"^    (\w+);$", (HERE / "palpate.map").read_text(encoding="utf-8"), re.MULTILINE)
        self.assertGreater(len(declared), 40)
        self.assertEqual(sorted(listed), sorted(declared))
        shown = subprocess.run(["nm", "-D", "--defined-only", LIBRARY], stdout=subprocess.PIPE, text=True, check=True).stdout
        exported = [line.split()[2] for line in shown.splitlines() if not line.split()[2].startswith("PALPATE_")]
        self.assertEqual(sorted(exported), sorted(f"{name}@@PALPATE_1" for name in declared))

    def test_the_header_compiles_by_itself(self):
        for compiler, standard in ((CC, "c99"), (CC, "c11"), (CXX, "c++17")):
            language = "c++" if "++" in standard else "c"
            with self.subTest(standard=standard):
                done = subprocess.run([compiler, f"-std={standard}", *WARNINGS, "-x", language, str(HERE / "header_test.c")],
                                      stderr=subprocess.PIPE, text=True, check=False)
                self.assertEqual((done.returncode, done.stderr), (0, ""))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
