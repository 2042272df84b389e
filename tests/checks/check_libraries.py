#!/usr/bin/env python3
"""Checks the licence of every library that a program loads.

    check_libraries.py LIST PROGRAM [LIBRARY...]

LIBRARY is one of its own that it loads later. LIST names each allowed library with its Debian package and licence. A library that is not listed, a
GPL-only one, and one that comes from another package than the list says, are faults.
"""

import os
import pathlib
import re
import shutil
import subprocess
import sys

# licensed under the GPL alone (or loading what is): linking them would put palpate under it
FORBIDDEN = {
    "libfftw3": "FFTW, GPL-2+", "libfftw3f": "FFTW, GPL-2+", "libfftw3l": "FFTW, GPL-2+",
    "libITKFFT": "loads FFTW, GPL-2+",
    "libreadline": "GNU readline, GPL-3+", "libhistory": "GNU readline, GPL-3+",
    "libgsl": "GNU Scientific Library, GPL-3+", "libgslcblas": "GNU Scientific Library, GPL-3+",
    "libcholmod": "SuiteSparse, GPL-2+", "libumfpack": "SuiteSparse, GPL-2+",
    "libCGAL": "CGAL, GPL-3+", "libgdbm": "GNU dbm, GPL-3+", "libmpfrcx": "GPL-3+",
}
# in sanitized builds, from the compiler itself
SANITIZERS = re.compile(r"lib(asan|ubsan|tsan|lsan|clang_rt\.[a-z_]+)$")
# the kernel's page, no file
NO_FILE = ("linux-vdso",)


def stem(soname):
    """'libITKCommon-5.2.so.1' -> 'libITKCommon'; 'libldap-2.5.so.0' keeps its release, as the list does."""
    name = re.sub(r"\.so(\.[0-9.]+(debian)?)?$", "", os.path.basename(soname))
    return re.sub(r"-5\.\d+$", "", name) if name.startswith(("libITK", "libitk")) else name


def read_list(file):
    """{stem: (package, licence)}"""
    allowed = {}
    for number, line in enumerate(pathlib.Path(file).read_text().splitlines(), 1):
        if not line.strip() or line.startswith("#"):
            continue
        fields = line.split(None, 2)
        if len(fields) != 3:
            sys.exit(f"{file}:{number}: expected 'library package licence'")
        allowed[fields[0]] = (fields[1], fields[2])
    return allowed


def loaded_libraries(program):
    """[(soname, path or None)] as the dynamic linker resolves them."""
    output = subprocess.run(["ldd", program], stdout=subprocess.PIPE, text=True, check=True).stdout
    libraries = []
    for line in output.splitlines():
        match = re.match(r"\s*(\S+)(?: => (\S.*?))? \(0x|\s*(\S+) => not found", line)
        if match and not (match[1] or "").startswith(NO_FILE):
            libraries.append((match[1] or match[3], match[2] or match[1]))
    return libraries


def package_of(path):
    """The Debian package that owns a file, or None where that cannot be told."""
    if path is None or shutil.which("dpkg-query") is None:
        return None
    # /lib is a link to /usr/lib, and packages own either name
    real = os.path.realpath(path)
    for name in (path, real, real.removeprefix("/usr"), "/usr" + path):
        found = subprocess.run(["dpkg-query", "-S", name], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                               text=True, check=False).stdout
        if found:
            return found.split(":")[0]
    return None


def faults(allowed, libraries, owner=package_of):
    """What is wrong, a line each."""
    found = []
    for soname, path in libraries:
        name = stem(soname)
        if name in FORBIDDEN:
            found.append(f"{soname}: forbidden ({FORBIDDEN[name]})")
        elif SANITIZERS.match(name):
            continue
        elif name not in allowed:
            found.append(f"{soname}: not in the list (package {owner(path)}): check its licence and add it")
        else:
            package = owner(path)
            if package is not None and package != allowed[name][0]:
                found.append(f"{soname}: comes from {package}, the list says {allowed[name][0]}: check its licence")
    return found


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    allowed = read_list(sys.argv[1])
    # GPL-only licences do not belong into the list either
    found = [f"{name}: listed under {licence}" for name, (_, licence) in allowed.items()
             if re.match(r"A?GPL", licence) and " or " not in licence and "exception" not in licence.lower()]
    libraries = {}
    for program in sys.argv[2:]:
        loaded = dict(loaded_libraries(program))
        if not loaded:
            found.append(f"{program}: loads no library at all; is it the program?")
        libraries.update(loaded)
    found += faults(allowed, libraries.items())
    print("\n".join(found) if found else f"{len(libraries)} libraries, all listed")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
