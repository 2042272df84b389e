#!/usr/bin/env python3
"""docs/reference/cxx.md lists every public header, once, and no other.

    check_cxx_page.py [ROOT]
"""

import collections
import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
PAGE = "docs/reference/cxx.md"


def faults(root):
    page = (root / PAGE).read_text(encoding="utf-8")
    # the first table leads to some of them by task; the lists begin below
    lists = page.partition("\n## The core\n")[2]
    listed = collections.Counter(re.findall(r"^\| `(palpate/[\w/]+\.h)` \|", lists, re.MULTILINE))
    there = {path.relative_to(root / "include").as_posix() for path in (root / "include/palpate").rglob("*.h")}
    return [*(f"{PAGE} does not list {name}" for name in sorted(there - listed.keys())),
            *(f"{PAGE} lists {name}, which is not there" for name in sorted(listed.keys() - there)),
            *(f"{PAGE} lists {name} {count} times" for name, count in sorted(listed.items()) if count > 1)]


def main():
    found = faults(pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT)
    print("".join(fault + "\n" for fault in found) or "every public header is listed\n", end="")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
