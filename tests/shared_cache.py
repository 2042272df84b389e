"""A cache of prepared models that the tests of one build share."""

import hashlib
import os
import pathlib
import shutil


def share_prepared_models(program):
    """Sets PALPATE_CACHE of this process to a folder of the build that all its tests share. The folder is keyed by the
    program's hash, and those of other hashes are deleted. Without a build folder the cache is off."""
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
