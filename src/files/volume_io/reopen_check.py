"""Reads what write_examples wrote with software that is not ours: NIfTI with nibabel, the headers of NRRD and
MetaImage by their published formats. Each must hold the geometry and the voxels that were meant."""

import gzip
import os
import pathlib
import re
import struct
import subprocess
import sys
import zlib

try:
    import nibabel
except ImportError:
    nibabel = None

SKIPPED = 77


def read_nifti(path):
    image = nibabel.load(path)
    affine = image.affine
    ras_to_lps = (-1, -1, 1)
    columns = [[ras_to_lps[r] * affine[r][c] for r in range(3)] for c in range(3)]
    origin = [ras_to_lps[r] * affine[r][3] for r in range(3)]
    # both forms must say the same, since programs differ in which one they take
    difference = abs(image.get_sform() - image.get_qform()).max()
    assert difference < 1e-4, f"{path.name}: sform and qform differ by {difference}"
    assert image.header.get_xyzt_units()[0] == "mm", f"{path.name}: lengths are not in mm"
    return list(image.shape), origin, columns, image.get_fdata().flatten(order="F").tolist()


def read_nrrd(path):
    head, data = path.read_bytes().split(b"\n\n", 1)
    lines = [line for line in head.decode().splitlines()[1:] if not line.startswith("#")]
    fields = dict(line.split(": ", 1) for line in lines)
    assert fields["space"] == "left-posterior-superior" and fields["encoding"] == "gzip"
    assert fields["type"] == "short" and fields["endian"] == "little"
    vectors = [[float(n) for n in v.split(",")] for v in re.findall(r"\(([^)]*)\)", fields["space directions"])]
    origin = [float(n) for n in fields["space origin"].strip("()").split(",")]
    values = gzip.decompress(data)
    return [int(n) for n in fields["sizes"].split()], origin, vectors, shorts(values)


def read_metaimage(path):
    head, data = path.read_bytes().split(b"ElementDataFile = LOCAL\n", 1)
    fields = dict(line.split(" = ", 1) for line in head.decode().splitlines())
    assert fields["ElementType"] == "MET_SHORT" and fields["BinaryDataByteOrderMSB"] == "False"
    matrix = [float(n) for n in fields["TransformMatrix"].split()]
    spacing = [float(n) for n in fields["ElementSpacing"].split()]
    columns = [[matrix[3 * c + r] * spacing[c] for r in range(3)] for c in range(3)]
    origin = [float(n) for n in fields["Offset"].split()]
    return [int(n) for n in fields["DimSize"].split()], origin, columns, shorts(zlib.decompress(data))


def shorts(data):
    return list(struct.unpack(f"<{len(data) // 2}h", data))


def main(program, folder):
    folder = pathlib.Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    listing = subprocess.run([program, folder], check=True, capture_output=True, text=True).stdout.splitlines()
    checked = 0
    for line in listing:
        name, *numbers = line.split()
        if ".nii" in name and nibabel is None:
            continue
        reader = read_nrrd if name.endswith(".nrrd") else read_metaimage if name.endswith(".mha") else read_nifti
        dims, origin, columns, values = reader(folder / name)
        meant = [float(n) for n in numbers]
        found = dims + origin + [n for column in columns for n in column]
        worst = max(abs(a - b) for a, b in zip(found, meant, strict=True))
        assert worst < 1e-4, f"{name}: geometry differs by {worst}: {found} instead of {meant}"
        assert values == [7 * n - 100 for n in range(len(values))] and len(values) == dims[0] * dims[1] * dims[2], name
        checked += 1
    print(f"{checked} files hold what was meant")
    assert checked >= 12
    if nibabel is None:
        print("python3-nibabel is missing, the NIfTI files were not read")
        sys.exit(1 if os.environ.get("CI") == "true" else SKIPPED)


main(*sys.argv[1:])
