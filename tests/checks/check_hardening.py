#!/usr/bin/env python3
"""Checks that programs contain the exploit mitigations of their build (cmake/compiler.cmake, SECURITY.md).

    check_hardening.py PROGRAM...

Prints a line for each protection that is not there; exit code 1 when there is any. Requires x86-64 Linux programs with
symbols; for other processors only the processor-independent mitigations are checked.
"""

import pathlib
import re
import subprocess
import sys

# the first instruction of a function that may be jumped to
ENDBR64 = bytes.fromhex("f30f1efa")
# a large frame is taken page by page, each touched: by g++ with `or`, by clang with `mov`
PROBES = [bytes.fromhex("4881ec00100000" + touch) for touch in ("48830c2400", "48c7042400000000")]
# a few functions of assembler or of other compilers would be no fault
LEAST_MARKED = 0.99


def readelf(program, *options):
    return subprocess.run(["readelf", "--wide", *options, program], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                          text=True, check=True).stdout


def own_functions(program):
    """Addresses of the functions of namespace palpate that other objects may call."""
    rows = re.findall(r"^ *\d+: ([0-9a-f]+) +\d+ FUNC +(?:GLOBAL|WEAK) +\S+ +\d+ _ZNK?7palpate",
                      readelf(program, "--syms"), re.MULTILINE)
    return sorted({int(address, 16) for address in rows if int(address, 16)})


def sections(program):
    """{name: (address, offset, size)}"""
    rows = re.findall(r"^ *\[ *\d+\] (\.\S+) +\S+ +([0-9a-f]+) ([0-9a-f]+) ([0-9a-f]+)",
                      readelf(program, "--sections"), re.MULTILINE)
    return {name: tuple(int(number, 16) for number in numbers) for name, *numbers in rows}


def faults(program):
    """What is not protected, a line each."""
    head, segments = readelf(program, "--file-header"), readelf(program, "--segments")
    dynamic, imported = readelf(program, "--dynamic"), readelf(program, "--dyn-syms")
    found = []

    def must(holds, what):
        if not holds:
            found.append(f"{program}: {what}")

    # where it lies in memory, and what may be written there
    must(re.search(r"Type: +DYN", head) and re.search(r"\(FLAGS_1\).*\bPIE\b", dynamic), "lies at a fixed address (no PIE)")
    must("GNU_RELRO" in segments, "its table of relocations stays writable (no -z relro)")
    must(re.search(r"\(FLAGS\).*BIND_NOW|\(FLAGS_1\).*\bNOW\b", dynamic), "resolves functions late, into a writable table (no -z now)")
    stack = re.search(r"GNU_STACK.* ([R ][W ][E ]) ", segments)
    must(stack and "E" not in stack[1], "its stack may be executed (no -z noexecstack)")

    # what the compiler put into functions
    must(re.search(r"\b__stack_chk_fail\b", imported), "no function looks after its frame (no -fstack-protector-strong)")
    must(re.search(r"\b__(?!stack)\w+_chk\b", imported), "sizes of copies are not checked (no _FORTIFY_SOURCE)")
    if not re.search(r"Machine: .*X86-64", head):
        return found
    address, offset, size = sections(program)[".text"]
    text = pathlib.Path(program).read_bytes()[offset:offset + size]
    must(any(probe in text for probe in PROBES), "a large frame may step over the stack's guard page (no -fstack-clash-protection)")
    own = [place for place in own_functions(program) if address <= place < address + size]
    marked = sum(text.startswith(ENDBR64, place - address) for place in own)
    must(own, "has no symbols of palpate, so nothing can be said of its functions")
    must(not own or marked >= LEAST_MARKED * len(own),
         f"{len(own) - marked} of {len(own)} functions may be entered in their middle (no -fcf-protection=full)")
    return found


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    found = [fault for program in sys.argv[1:] for fault in faults(program)]
    print("\n".join(found or [f"{program}: protected" for program in sys.argv[1:]]))
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
