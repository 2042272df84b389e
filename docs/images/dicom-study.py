"""Writes a scan that palpate wrote as NRRD as a folder of DICOM, as it comes from a PACS.

usage: dicom-study.py SCAN.nrrd FOLDER
"""

import os
import pathlib
import sys

sys.dont_write_bytecode = True
sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "..", "tests", "docs"))
import fixtures  # noqa: E402

if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    fixtures.write_study(pathlib.Path(sys.argv[2]), fixtures.read_volume(pathlib.Path(sys.argv[1])))
