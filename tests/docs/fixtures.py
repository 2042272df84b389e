"""Small versions of the files that the manual's examples assume; each page gets them in its folder."""

import collections
import gzip
import math
import re
import shutil
import struct

import dicom_files

PRESS = '''title = "Press"

[[step]]
approach = "femur"
speed = 200.0

[[step]]
press = 0.8

[[step]]
hold = 0.2

[[step]]
leave = true
'''
# one line and one structure, for what reads a plan
PLAN = '''title = "A hole"

[[trajectory]]
name = "hole"
entry = [34.0, -14.0, 18.0]
target = [20.0, -9.0, 24.0]
enters = ["femur"]
'''
# places of a patient, mm, LPS
POINTS = {"a": (30.0, 0.0, 0.0), "b": (0.0, 40.0, 0.0), "c": (0.0, 0.0, 50.0), "d": (-30.0, -20.0, 10.0)}


def seen(place):
    """Where a tracker sees a place: turned by 90 degrees about z and moved."""
    x, y, z = place
    return 100 - y, x + 20, z - 30


def table(places):
    return "".join(f"{name},{x},{y},{z}\n" for name, (x, y, z) in places.items())


def markups(kind, places):
    listed = ", ".join(f'{{"label": "{name}", "position": [{x}, {y}, {z}]}}' for name, (x, y, z) in places.items())
    return f'{{"markups": [{{"type": "{kind}", "coordinateSystem": "LPS", "coordinateUnits": "mm", "controlPoints": [{listed}]}}]}}'


def poses():
    """Poses of a tool that pivots about its tip, 100 mm below its markers: lines of x, y, z (mm) and a quaternion,
    scalar last."""
    lines = []
    for n in range(200):
        a, b = 0.5 * math.cos(0.37 * n), 0.5 * math.sin(0.61 * n)
        turn = math.hypot(a, b)
        x, y, w = a * math.sin(turn / 2) / turn, b * math.sin(turn / 2) / turn, math.cos(turn / 2)
        # the turned axis of the tool, and so where its markers are when its tip rests in a dimple
        axis = 2 * w * y, -2 * w * x, 1 - 2 * (x * x + y * y)
        lines.append(" ".join(f"{v:.9f}" for v in (*(100 * v for v in axis), x, y, 0.0, w)) + "\n")
    return "".join(lines)


def read_volume(file):
    """Sizes, spacing, origin and bytes of the voxels of what palpate wrote as NRRD with gzip, along the patient's axes."""
    head, _, packed = file.read_bytes().partition(b"\n\n")
    fields = dict(line.split(": ", 1) for line in head.decode().splitlines() if ": " in line and line[0] != "#")
    return (list(map(int, fields["sizes"].split())),
            [max(map(float, axis.strip("()").split(","))) for axis in fields["space directions"].split()],
            list(map(float, fields["space origin"].strip("()").split(","))), gzip.decompress(packed))


def write_nifti(file, volume):
    """The same as NIfTI: its axes are RAS."""
    sizes, spacing, origin, voxels = volume
    kind, bits = {1: (2, 8), 2: (512, 16), 4: (16, 32)}[len(voxels) // math.prod(sizes)]
    head = bytearray(352)
    struct.pack_into("<i", head, 0, 348)
    struct.pack_into("<8h", head, 40, 3, *sizes, 1, 1, 1, 1)
    struct.pack_into("<hh", head, 70, kind, bits)
    struct.pack_into("<8f", head, 76, 1, *spacing, 1, 1, 1, 1)
    struct.pack_into("<f", head, 108, 352)
    head[123] = 2  # mm
    struct.pack_into("<hh", head, 252, 0, 1)
    for row, sign in enumerate((-1, -1, 1)):
        struct.pack_into("<4f", head, 280 + 16 * row, *(sign * spacing[row] * (row == n) for n in range(3)), sign * origin[row])
    head[344:347] = b"n+1"
    file.write_bytes(gzip.compress(bytes(head) + voxels, compresslevel=1))


def stl(low, high):
    """A box as ASCII STL, LPS, mm. make() puts it so far anterior that reading it as RAS would place it outside the
    scan."""
    corners = [[(low, high)[n >> axis & 1][axis] for axis in range(3)] for n in range(8)]
    faces = [(0, 2, 1), (1, 2, 3), (4, 5, 6), (5, 7, 6), (0, 1, 4), (1, 5, 4), (2, 6, 3), (3, 6, 7), (0, 4, 2), (2, 4, 6), (1, 3, 5), (3, 7, 5)]
    return "solid box\n" + "".join("facet normal 0 0 0\nouter loop\n" + "".join("vertex {} {} {}\n".format(*corners[n]) for n in face)
                                   + "endloop\nendfacet\n" for face in faces) + "endsolid box\n"


def write_study(folder, scan):
    """The same as a folder of DICOM, one file for each slice."""
    (nx, ny, nz), spacing, (x, y, z), voxels = scan
    voxels = struct.unpack(f"<{nx * ny * nz}f", voxels)
    storage = "1.2.840.10008.5.1.4.1.1.4"  # MR
    folder.mkdir()
    for k in range(nz):
        name = f"1.2.3.4.{k + 1}"
        pixels = struct.pack(f"<{nx * ny}H", *(max(0, round(v)) for v in voxels[nx * ny * k:nx * ny * (k + 1)]))
        data = [(8, 0x08, "CS", "ORIGINAL\\PRIMARY\\AXIAL"), (8, 0x16, "UI", storage), (8, 0x18, "UI", name), (8, 0x60, "CS", "MR"),
                (8, 0x90, "PN", "Nobody"), (16, 0x10, "PN", "Nobody"), (16, 0x20, "LO", "0"), (16, 0x30, "DA", "19700101"),
                (24, 0x50, "DS", str(spacing[2])), (32, 0x0d, "UI", "1.2.3"), (32, 0x0e, "UI", "1.2.3.4"), (32, 0x11, "IS", "1"),
                (32, 0x13, "IS", str(k + 1)), (32, 0x32, "DS", f"{x}\\{y}\\{z + k * spacing[2]}"),
                (32, 0x37, "DS", "1\\0\\0\\0\\1\\0"), (32, 0x52, "UI", "1.2.3.5"), (40, 2, "US", struct.pack("<H", 1)),
                (40, 4, "CS", "MONOCHROME2"), (40, 0x10, "US", struct.pack("<H", ny)), (40, 0x11, "US", struct.pack("<H", nx)),
                (40, 0x30, "DS", f"{spacing[1]}\\{spacing[0]}"), (40, 0x100, "US", struct.pack("<H", 16)),
                (40, 0x101, "US", struct.pack("<H", 16)), (40, 0x102, "US", struct.pack("<H", 15)),
                (40, 0x103, "US", struct.pack("<H", 0)), (0x7fe0, 0x10, "OW", pixels)]
        dicom_files.write_file(folder / f"IM{k + 1:04}", storage, name, data)


def make(folder, palpate):
    """Writes them. `palpate(*arguments)` runs the program in the folder, and fails the test where it fails."""
    palpate("data", "fetch", "knee-phantom", "-o", "phantom")
    scan, labels = folder / "phantom/knee-phantom.nrrd", folder / "phantom/knee-phantom.seg.nrrd"
    for name in ("mr.nrrd", "scan.nrrd"):
        shutil.copy(scan, folder / name)
    for name in ("knee.seg.nrrd", "labels.seg.nrrd", "labels.nrrd"):
        shutil.copy(labels, folder / name)
    palpate("scene", "new", "mr.nrrd", "labels.seg.nrrd", "--modality", "mr", "-o", "scene.toml")
    for name in ("mr.nii.gz", "scan.nii.gz"):
        write_nifti(folder / name, read_volume(scan))
    write_nifti(folder / "labels.nii.gz", read_volume(labels))
    structures = re.findall(r"^Segment(\d+)_(LabelValue|Name):=(.*)$", labels.read_bytes().partition(b"\n\n")[0].decode(), re.MULTILINE)
    named = collections.defaultdict(dict)
    for number, key, value in structures:
        named[number][key] = value
    (folder / "dseg.tsv").write_text("value\tname\n" + "".join(f"{one['LabelValue']}\t{one['Name']}\n" for one in named.values()))
    shutil.copy(folder / "dseg.tsv", folder / "labels.tsv")
    write_study(folder / "study", read_volume(scan))
    shutil.copytree(folder / "study", folder / "STUDY")
    palpate("export", "labels.seg.nrrd", "study", "--keep-identifiers", "-o", "seg.dcm")
    square = [(10, -20), (30, -20), (30, 0), (10, 0)]
    dicom_files.write_structure_set(folder / "structures.dcm", [("femur", [(z, square) for z in range(10, 31, 2)])], "1.2.3.4")
    (folder / "surfaces").mkdir()
    (folder / "surfaces/femur.stl").write_text(stl((-15, -58, 10), (15, -52, 40)), encoding="utf-8")
    (folder / "cases.tsv").write_text("case\tstudy\tsegmentation\tscript\tseed\nK01\tstudy\tseg.dcm\tpress.toml\t1\n")
    for name, text in (("press.toml", PRESS), ("script.toml", PRESS), ("plan.toml", PLAN), ("poses.csv", poses()),
                       ("tracked.csv", table({name: seen(p) for name, p in POINTS.items()})), ("scan.mrk.json", markups("Fiducial", POINTS)),
                       ("tunnel.mrk.json", markups("Line", {"hole-1": (34.0, -14.0, 18.0), "hole-2": (20.0, -9.0, 24.0)}))):
        (folder / name).write_text(text, encoding="utf-8")
    palpate("simulate", "knee-phantom", "-o", "run.h5")
