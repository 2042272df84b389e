#!/usr/bin/env python3
"""Checks that the release build rejects references to destroyed temporaries.

    check_dangling.py BUILD

The sanitized build does not watch the scopes of temporaries (cmake/compiler.cmake), so the release build has to see a
dangling expression when it compiles. Each of these functions has one; they are compiled with the flags of a source of
palpate's, and each must be complained of. The same functions as they ought to be compile.
"""

import json
import pathlib
import re
import shlex
import subprocess
import sys
import tempfile

# description: (function with the placeholder KEPT, text that makes it dangle, text that makes it valid)
CASES = {
    "an expression of a temporary's": ("double NAME(const Vector3d& a, double s) { KEPT e = a + s * Vector3d(1, 2, s).cwiseAbs(); return e.sum(); }",
                                       "auto", "const Vector3d"),
    "a product with what a function returned": ("double NAME(const Matrix3d& a, double s) { KEPT e = a * made(s); return e.sum(); }",
                                                "auto", "const Vector3d"),
    "coefficients of an expression": ("double NAME(const Vector3d& a, double s) { KEPT e = (a + made(s)).cwiseMax(made(2 * s)); double sum = 0; "
                                      "for (int i = 0; i < 3; ++i) sum += e[i]; return sum; }", "auto", "const Vector3d"),
    "what eval() returned": ("double NAME(const Matrix3d& a, const Vector3d& b) { KEPT e = (a * b).eval() - b; return e.norm(); }",
                             "auto", "const Vector3d"),
    "a reference into a temporary": ("double NAME(double s) { const Vector3d KEPT e = held(s).eigen(); return e.sum(); }", "&", ""),
    "a view of a temporary": ("double NAME(double s) { KEPT e = three(s); return e[0] + e[1]; }",
                              "const std::span<const double>", "const std::array<double, 3>"),
    "the larger of two temporaries": ("int NAME(int s) { const int KEPT larger = std::max(2 * s, 3); return larger; }", "&", ""),
}
BEGIN = """#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <span>
using Eigen::Matrix3d;
using Eigen::Vector3d;
struct Held {
  Vector3d vector;
  const Vector3d& eigen() const { return vector; }
};
Vector3d made(double s);
Held held(double s);
std::array<double, 3> three(double s);
"""


def compiler(build):
    """How the build compiles a unit of the proxy's, up to what it compiles; and in which folder."""
    entry = next(e for e in json.loads((pathlib.Path(build) / "compile_commands.json").read_text())
                 if "palpate_contact.dir" in e["command"])
    arguments = [a for a in shlex.split(entry["command"]) if not a.endswith("ccache")]
    return arguments[:arguments.index("-o")], entry["directory"]


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    command, folder = compiler(sys.argv[1])
    with tempfile.TemporaryDirectory() as scratch:
        source = pathlib.Path(scratch, "cases.cc")

        def compiled(texts):
            source.write_text(BEGIN + "\n".join(text.replace("NAME", f"case_{n}") for n, text in enumerate(texts)) + "\n")
            return subprocess.run(command + ["-c", str(source), "-o", str(source.with_suffix(".o"))], cwd=folder,
                                  stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)

        fine = compiled(text.replace("KEPT", right) for text, _, right in CASES.values())
        if fine.returncode != 0:
            sys.exit(f"refused where nothing dangles:\n{fine.stdout}")
        wrong = compiled(text.replace("KEPT", dangling) for text, dangling, _ in CASES.values())
    # the compiler names the function on a line before each message
    complaints, function = set(), None
    for line in wrong.stdout.splitlines():
        if named := re.search(r"(?:In function|inlined from) .*\bcase_(\d+)\(", line):
            function = int(named[1])
        elif re.search(r"error: .*\[-Werror=(dangling-pointer|uninitialized|maybe-uninitialized)", line):
            complaints.add(function)
    missed = [name for n, name in enumerate(CASES) if n not in complaints]
    if missed:
        sys.exit(f"compiles although it dangles: {', '.join(missed)}\n{wrong.stdout}")
    print(f"{len(CASES)} kinds of dangling expression are refused")


if __name__ == "__main__":
    main()
