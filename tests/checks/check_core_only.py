#!/usr/bin/env python3
"""Builds a third-party program against the installed core and checks which libraries it loads.

The core must need Eigen and Highway alone: no other package is looked for where it is configured by itself, none of its
sources includes another library's header, and a program that links every object of it, called or not, loads no other
library. A program whose flags give Eigen's types another layout must not link.
"""

import argparse
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys

# what the compiler brings, and Highway; Eigen is headers only
ALLOWED = re.compile(r"^(linux-vdso|ld-linux-[a-z0-9-]+|libc|libm|libgcc_s|libstdc\+\+|libpthread|librt|libdl"
                     r"|libhwy|libasan|libubsan|libtsan)\.so")
# Headers that its sources may not include: all in /usr/include but those of Eigen, Highway, the compiler and the
# system. Headers directly in /usr/include may be the system's; a library that installs there is detected by ldd.
OTHER_HEADER = re.compile(r"/usr/(?:local/)?include/(?!eigen3/|hwy/|c\+\+/|(?:x86_64|aarch64)-linux-gnu/|linux/|asm|bits/|sys/|gnu/)[^/\s]+/\S+")
# packages that the core must not even look for
FORBIDDEN_IN_CACHE = ("ITK_DIR", "HDF5", "CURL", "TBB_DIR", "OPENSSL", "kissfft_DIR", "PNG_", "tomlplusplus",
                      "nlohmann_json_DIR", "CLI11_DIR")


def run(command):
    result = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    if result.returncode != 0:
        print(result.stdout[-8000:])
        sys.exit(f"failed: {' '.join(map(str, command))}")
    return result.stdout


def other_headers(folder):
    """What the sources of a configured build include of libraries that the core must do without."""
    found = set()
    for entry in json.loads((folder / "compile_commands.json").read_text()):
        command, found_in_it = re.subn(r" -o \S+ -c ", " -M ", entry["command"])
        if found_in_it != 1:
            sys.exit(f"cannot be asked for its headers: {command}")
        result = subprocess.run(command, shell=True, cwd=entry["directory"], stdout=subprocess.PIPE, text=True, check=False)
        if result.returncode != 0:
            sys.exit(f"failed: {command}")
        found.update(OTHER_HEADER.findall(result.stdout))
    return sorted(found)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for option in ("--source", "--installs", "--build", "--cmake", "--cxx"):
        parser.add_argument(option, required=True)
    parser.add_argument("--sanitize", default="")
    options = parser.parse_args()

    # what the consumer needs, it needs without optimisation, too, and then calls what would else be inlined
    flags = ["-G", "Ninja", "-DCMAKE_BUILD_TYPE=", "-DCMAKE_CXX_FLAGS=-O0", f"-DCMAKE_CXX_COMPILER={options.cxx}",
             f"-DPALPATE_SANITIZE={options.sanitize}"]
    core, consumer = (pathlib.Path(options.build) / name for name in ("core", "consumer"))
    installed = pathlib.Path(options.build).resolve() / "installed"
    # by itself; in units, which read each header once
    run([options.cmake, "-S", options.source, "-B", core, "-DPALPATE_CORE_ONLY=ON", "-DPALPATE_BUILD_TESTS=OFF",
         "-DCMAKE_UNITY_BUILD=ON", "-DCMAKE_UNITY_BUILD_BATCH_SIZE=0", *flags])
    if headers := other_headers(core):
        sys.exit(f"the core includes {', '.join(headers)}")
    # what an earlier version installed is not to be found
    shutil.rmtree(installed, ignore_errors=True)
    run([options.cmake, "--install", options.installs, "--component", "core", "--prefix", installed])
    run([options.cmake, "-S", pathlib.Path(__file__).parent / "core_consumer", "-B", consumer, f"-DCMAKE_PREFIX_PATH={installed}", *flags])
    run([options.cmake, "--build", consumer, "--parallel", "1"])

    # as -mavx512f would, on any processor
    otherwise = [*flags]
    otherwise[3] += " -DEIGEN_MAX_STATIC_ALIGN_BYTES=64"
    elsewhere = consumer.with_name("consumer-otherwise")
    run([options.cmake, "-S", pathlib.Path(__file__).parent / "core_consumer", "-B", elsewhere, f"-DCMAKE_PREFIX_PATH={installed}", *otherwise])
    linked = subprocess.run([options.cmake, "--build", elsewhere, "--parallel", "1"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                            text=True, check=False)
    if linked.returncode == 0 or not re.search(r"undefined reference to .*CompiledWithEigenTypesAlignedTo<64>", linked.stdout):
        print(linked.stdout[-8000:])
        sys.exit("a program with another layout of Eigen's types was not refused by the linker")

    cache = "".join((folder / "CMakeCache.txt").read_text() for folder in (core, consumer))
    sought = [name for name in FORBIDDEN_IN_CACHE if re.search(rf"^{name}", cache, re.MULTILINE)]
    if sought:
        sys.exit(f"configuring the core looked for: {', '.join(sought)}")

    # how somebody else's program is linked is his own affair
    rules = (consumer / "build.ninja").read_text()
    linking = rules[rules.index("build core_consumer: "):].split("\n\n", 1)[0]
    forced = re.findall(r"-Wl,-z,?\S*|-z \w+", linking)
    if forced:
        sys.exit(f"who links the core gets flags of ours: {', '.join(forced)}")

    program = consumer / "core_consumer"
    print(run([program]).strip())
    loaded = [line.split()[0] for line in run(["ldd", program]).splitlines() if line.strip()]
    strangers = [name for name in loaded if not ALLOWED.match(os.path.basename(name))]
    if strangers:
        sys.exit(f"the core loads more than Highway and the compiler's libraries: {', '.join(strangers)}")
    print("loads", ", ".join(sorted(os.path.basename(name) for name in loaded)))


if __name__ == "__main__":
    main()
