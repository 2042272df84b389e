#!/usr/bin/env python3
"""Checks that every hazard of the threat model has a measure and tests, and that the tests exist.

    check_threat_model.py DOCUMENT ROOT

A test is named as `FILE: Suite.Test`, in C++ as in Python. Prints a line for each fault; exit code 1 when there is any.
"""

import pathlib
import re
import sys

HEAD = ["hazard", "cause", "effect", "measure", "test"]
# a row that continues the hazard above leaves its name out
MAY_BE_EMPTY = {"hazard"}


def exists(root, file, suite, test):
    """Whether a file has that test."""
    path = root / file
    if not path.is_file():
        return False
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        # of a class everything up to the next one
        body = re.search(rf"^class {re.escape(suite)}\b.*?(?=^\S|\Z)", text, re.MULTILINE | re.DOTALL)
        return bool(body and re.search(rf"^    def {re.escape(test)}\(", body[0], re.MULTILINE))
    return bool(re.search(rf"^TEST(?:_F|_P)?\({re.escape(suite)},\s*{re.escape(test)}\)", text, re.MULTILINE))


def rows(text):
    """(line, cells) of the table of hazards."""
    lines = [(number, [cell.strip() for cell in line.strip().strip("|").split("|")] if line.startswith("| ") else None)
             for number, line in enumerate(text.splitlines(), 1)]
    begins = [index for index, (_, cells) in enumerate(lines) if cells == HEAD]
    if len(begins) != 1:
        return []
    found = []
    # its head is followed by a line of dashes
    for number, cells in lines[begins[0] + 2:]:
        if cells is None:
            break
        found.append((number, cells))
    return found


def faults(document, root):
    """What is wrong, a line each."""
    found = []
    table = rows(document.read_text(encoding="utf-8"))
    if not table:
        found.append(f"{document}: has no table of {', '.join(HEAD)}")
    for number, cells in table:
        where = f"{document}:{number}"
        if len(cells) != len(HEAD):
            found.append(f"{where}: has {len(cells)} cells instead of {len(HEAD)}")
            continue
        found += [f"{where}: says nothing of the {name}" for name, cell in zip(HEAD, cells)
                  if not cell and name not in MAY_BE_EMPTY]
        named = re.findall(r"`([^`]+)`", cells[-1])
        if not named:
            found.append(f"{where}: names no test")
        for name in named:
            match = re.fullmatch(r"(\S+): (\w+)\.(\w+)", name)
            if not match or not exists(root, *match.groups()):
                found.append(f"{where}: there is no test {name}")
    return found


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    document, root = map(pathlib.Path, sys.argv[1:])
    found = faults(document, root)
    print("\n".join(found) if found else f"{len(rows(document.read_text(encoding='utf-8')))} rows, every test is there")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
