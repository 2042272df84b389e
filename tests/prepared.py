"""A cache of prepared models that the tests of one build share."""

import hashlib
import os
import pathlib
import shutil


def share(program):
    """From here on, runs of `program` by this process take what any test of the same build has prepared, and leave there
    what they prepare: in PALPATE_CACHE, a folder in the build folder that belongs to this very program. A program that has
    changed begins with an empty one. Without a build folder nothing is kept."""
    program = pathlib.Path(program).resolve()
    build = program.parents[2]
    if not (build / "CMakeCache.txt").is_file():
        os.environ["PALPATE_CACHE"] = ""
        return
    key = hashlib.blake2b(program.read_bytes(), digest_size=8).hexdigest()
    folder = build / "test-cache" / key
    folder.mkdir(parents=True, exist_ok=True)
    for other in folder.parent.iterdir():
        if other != folder:
            shutil.rmtree(other, ignore_errors=True)
    os.environ["PALPATE_CACHE"] = str(folder)
