"""Compares volumes that palpate.wasm reads with those that libpalpate reads, and the forces on them.

usage: files_test.py PALPATE.WASM

Generated NRRD, NIfTI and MetaImage files of every type of number, byte order and orientation, damaged ones, what
cases/make_cases.py in a folder of PALPATE_DATA makes, and the volumes there. Equal are labels, scan, grid and hash of the model,
or the message of what is refused; forces along a path of presses within 1e-6 N. PYTHONPATH and PALPATE_LIBRARY name the Python
package and the library.
"""

import gzip
import hashlib
import json
import os
import random
import struct
import subprocess
import sys
import tempfile
import zlib
from pathlib import Path

import numpy as np

os.environ["PALPATE_CACHE"] = ""  # each file is read, and nothing is left in the user's cache
import palpate  # noqa: E402
from forces_test import compare  # noqa: E402

SEED = int(os.environ.get("PALPATE_TEST_SEED", "20261130"))
random_numbers = random.Random(SEED)
NAMES = "value\tname\n1\tfemur\n2\ttibia\n3\tpatella\n"

TYPES = {  # numpy's name: NRRD's, MetaImage's, NIfTI's number
    "int8": ("int8", "MET_CHAR", 256), "uint8": ("uint8", "MET_UCHAR", 2), "int16": ("int16", "MET_SHORT", 4),
    "uint16": ("uint16", "MET_USHORT", 512), "int32": ("int32", "MET_INT", 8), "uint32": ("uint32", "MET_UINT", 768),
    "int64": ("int64", "MET_LONG_LONG", 1024), "uint64": ("uint64", "MET_ULONG_LONG", 1280),
    "float32": ("float", "MET_FLOAT", 16), "float64": ("double", "MET_DOUBLE", 64)}


def some_labels(size=(30, 26, 22)):
    """Three overlapping balls, the last of which has an edge."""
    i, j, k = np.indices(size)
    labels = np.zeros(size, int)
    for value, centre, radius in ((1, (10, 12, 10), 7), (2, (20, 13, 11), 6), (3, (14, 20, 14), 4)):
        labels[(i - centre[0]) ** 2 + (j - centre[1]) ** 2 + (k - centre[2]) ** 2 <= radius ** 2] = value
    labels[:, :, 18:] = 0
    return labels


def some_affine(voxel_mm=(1.1, 0.9, 1.3)):
    """Voxel to LPS: permuted, mirrored or oblique axes."""
    directions = np.linalg.qr(np.array([[random_numbers.gauss(0, 1) for _ in range(3)] for _ in range(3)]))[0]
    if random_numbers.random() < 0.4:
        directions = np.eye(3)[:, random_numbers.sample(range(3), 3)] * [random_numbers.choice((1, -1)) for _ in range(3)]
    affine = np.eye(4)
    affine[:3, :3] = directions * voxel_mm
    affine[:3, 3] = [random_numbers.uniform(-200, 200) for _ in range(3)]
    return affine


def stored(labels, kind, big):
    return labels.astype(np.dtype(kind).newbyteorder(">" if big else "<")).tobytes(order="F")


def nrrd(labels, kind, big, affine, encoding="raw", more="", space="left-posterior-superior"):
    vectors = " ".join("(" + ",".join(repr(float(x)) for x in affine[:3, a]) + ")" for a in range(3))
    origin = ",".join(repr(float(x)) for x in affine[:3, 3])
    header = (f"NRRD0005\ntype: {TYPES[kind][0]}\ndimension: 3\nspace: {space}\nsizes: {' '.join(map(str, labels.shape))}\n"
              f"space directions: {vectors}\nkinds: domain domain domain\nendian: {'big' if big else 'little'}\n"
              f"encoding: {encoding}\nspace origin: ({origin})\n{more}\n")
    voxels = stored(labels, kind, big)
    return header.encode() + (gzip.compress(voxels) if encoding == "gzip" else voxels)


def layered_nrrd(layers, affine, names):
    """A .seg.nrrd of overlapping segments: the layer is the first axis."""
    vectors = " ".join("(" + ",".join(repr(float(x)) for x in affine[:3, a]) + ")" for a in range(3))
    segments = "".join(f"Segment{n}_ID:=s{n}\nSegment{n}_Name:={name}\nSegment{n}_Layer:={n}\nSegment{n}_LabelValue:=1\n"
                       f"Segment{n}_Color:=0.{n + 2} 0.5 0.5\n" for n, name in enumerate(names))
    header = (f"NRRD0004\ntype: uint8\ndimension: 4\nspace: RAS\nsizes: {len(layers)} {' '.join(map(str, layers[0].shape))}\n"
              f"space directions: none {vectors}\nkinds: list domain domain domain\nencoding: gzip\nspace origin: (1,2,3)\n"
              f"{segments}\n")
    return header.encode() + gzip.compress(np.stack(layers).astype(np.uint8).tobytes(order="F"))


def nifti(labels, kind, big, affine, form="s", version=1, slope=0.0, intercept=0.0):
    order = ">" if big else "<"
    ras = np.diag([-1, -1, 1, 1]) @ affine
    voxel_mm = np.linalg.norm(ras[:3, :3], axis=0)
    dim = [3, *labels.shape, 1, 1, 1, 1]
    quaternion, handed = quaternion_of(ras[:3, :3] / voxel_mm)
    number, bits = TYPES[kind][2], 8 * np.dtype(kind).itemsize
    codes = (int("q" in form), int("s" in form))
    if version == 1:
        header = bytearray(352)
        put = lambda at, layout, *values: struct.pack_into(order + layout, header, at, *values)
        put(0, "i", 348), put(40, "8h", *dim), put(70, "hh", number, bits), put(76, "8f", handed, *voxel_mm, 1, 1, 1, 1)
        put(108, "fff", 352, slope, intercept), put(123, "b", 2), put(252, "hh", *codes)
        put(256, "6f", *quaternion, *ras[:3, 3]), put(280, "12f", *ras[:3].ravel())
        header[344:348] = b"n+1\0"
    else:
        header = bytearray(544)
        put = lambda at, layout, *values: struct.pack_into(order + layout, header, at, *values)
        put(0, "i", 540), put(12, "hh", number, bits), put(16, "8q", *dim), put(104, "8d", handed, *voxel_mm, 1, 1, 1, 1)
        put(168, "q", 544), put(176, "dd", slope, intercept), put(344, "ii", *codes)
        put(352, "6d", *quaternion, *ras[:3, 3]), put(400, "12d", *ras[:3].ravel()), put(500, "i", 2)
        header[4:12] = b"n+2\0\r\n\x1a\n"
    return bytes(header) + stored(labels, kind, big)


def quaternion_of(rotation):
    """Quaternion (b, c, d) with a >= 0 of a matrix, and its handedness."""
    handed = 1 if np.linalg.det(rotation) > 0 else -1
    rotation = rotation @ np.diag([1, 1, handed])
    matrix = np.array([[rotation[0, 0] - rotation[1, 1] - rotation[2, 2], 0, 0, 0],
                       [rotation[0, 1] + rotation[1, 0], rotation[1, 1] - rotation[0, 0] - rotation[2, 2], 0, 0],
                       [rotation[0, 2] + rotation[2, 0], rotation[1, 2] + rotation[2, 1],
                        rotation[2, 2] - rotation[0, 0] - rotation[1, 1], 0],
                       [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1],
                        np.trace(rotation)]]) / 3
    vector = np.linalg.eigh(matrix)[1][:, -1]
    return vector[:3] * (1 if vector[3] >= 0 else -1), handed


def metaimage(labels, kind, big, affine, packed, data="LOCAL"):
    voxels = stored(labels, kind, big)
    body = zlib.compress(voxels) if packed else voxels
    voxel_mm = np.linalg.norm(affine[:3, :3], axis=0)
    numbers = lambda values: " ".join(repr(float(x)) for x in values)
    header = (f"ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = {big}\nCompressedData = {packed}\n"
              f"TransformMatrix = {numbers((affine[:3, :3] / voxel_mm).T.ravel())}\nOffset = {numbers(affine[:3, 3])}\n"
              f"ElementSpacing = {numbers(voxel_mm)}\nDimSize = {' '.join(map(str, labels.shape))}\n"
              f"ElementType = {TYPES[kind][1]}\nElementDataFile = {data}\n").encode()
    return (header + body, b"") if data == "LOCAL" else (header, body)


def generate(folder):
    """Writes volumes, each in a folder of its own with a table of names. Returns (folder, scene, segmentation)."""
    labels, made = some_labels(), []

    def add(name, content, names=True, **others):
        home = folder / str(len(made))
        home.mkdir(parents=True)
        (home / name).write_bytes(content)
        for other, bytes_of in others.items():
            (home / other.replace("__", ".")).write_bytes(bytes_of)
        if names:
            (home / "names.tsv").write_text(NAMES)
        made.append((str(home), name, None))

    for n, kind in enumerate(TYPES):
        for big in (False, True):
            affine = some_affine()
            add("a.nrrd", nrrd(labels, kind, big, affine, ("raw", "gzip")[n % 2], space=random_numbers.choice(("LPS", "RAS"))))
            image = nifti(labels, kind, big, affine, ("s", "q", "qs", "")[(2 * n + big) % 4])
            add("a.nii.gz", gzip.compress(image)) if n % 2 else add("a.nii", image)
            add("a.mha", metaimage(labels, kind, big, affine, n % 2 == 0)[0])
    for form in ("q", "q", "q", "s", "qs", ""):
        add("a.nii.gz", gzip.compress(nifti(labels, "int16", False, some_affine(), form)))
        add("a.nii", nifti(labels, "int16", True, some_affine(), form, version=2))
    add("a.nii", nifti(labels * 85, "uint8", False, some_affine(), slope=1 / 85))
    header, body = metaimage(labels, "int16", False, some_affine(), True, "a.zraw")
    add("a.mhd", header, a__zraw=body)
    header, body = metaimage(labels, "int16", True, some_affine(), False, "a.raw")
    add("a.mhd", header, a__raw=body)
    add("a.nhdr", nrrd(labels, "uint8", False, some_affine(), more="data file: a.raw\n").split(b"\n\n")[0] + b"\n\n",
        a__raw=stored(labels, "uint8", False))
    several = gzip.compress(nifti(labels, "uint8", False, some_affine())[:500]) + gzip.compress(
        nifti(labels, "uint8", False, some_affine())[500:])
    add("members.nii.gz", several + b"\0" * 100)
    balls = [labels == 1, (labels == 1) | (labels == 2), labels == 3]
    add("a.seg.nrrd", layered_nrrd(balls, some_affine(), ("femur", "tibia", "patella")), names=False)
    add("femur.nii.gz", gzip.compress(nifti((labels == 1) * 1, "uint8", False, some_affine())), names=False)

    # refused
    good = nrrd(labels, "int16", False, some_affine(), "gzip")
    add("cut.nrrd", good[:-100])
    add("flipped.nrrd", good[:-200] + bytes([good[-200] ^ 255]) + good[-199:])
    add("header.nrrd", good[:60])
    add("cut.nii", nifti(labels, "int16", False, some_affine())[:-10])
    add("short.nii", b"\x5c\x01\0\0" + bytes(100))
    add("empty.nrrd", b"")
    add("png.nrrd", b"\x89PNG\r\n\x1a\n" + bytes(100))
    add("text.nii.gz", b"not a volume")
    add("negative.nrrd", nrrd(labels - 1, "int16", False, some_affine()))
    add("large.nrrd", nrrd(labels * 70000, "int32", False, some_affine()))
    add("missing.mhd", metaimage(labels, "int16", False, some_affine(), False, "nowhere.raw")[0])
    add("outside.mhd", metaimage(labels, "int16", False, some_affine(), False, "../names.tsv")[0])
    add("promises.nrrd", b"NRRD0004\ntype: int16\ndimension: 3\nsizes: 1200 1200 1200\nendian: little\nencoding: gzip\n\n" + bytes(90))
    add("contradiction.nrrd", nrrd(labels, "uint8", False, some_affine(), more="spacings: 1 1 1\n"))
    for n in range(60):
        damaged = bytearray(random_numbers.choice((good, nifti(labels, "uint8", False, some_affine(), "q"))))
        for _ in range(random_numbers.randint(1, 4)):
            damaged[random_numbers.randrange(min(len(damaged), 400))] = random_numbers.randrange(256)
        add("damaged" + (".nrrd" if damaged[:2] == b"NR" else ".nii"), bytes(damaged))
    return made


def shared():
    """Volumes in the folders of PALPATE_DATA, and those that its script of cases makes."""
    made = []
    for root in filter(None, os.environ.get("PALPATE_DATA", "").split(":")):
        root = Path(root)
        for scene, segmentation in (("torso_ct/example_ct_sm.nii.gz", "example_seg.nii.gz"), ("torso_ct/example_seg.nii.gz", None),
                                    ("knee_dess/SAG_3D_DESS_RIGHT_bones_cart_men_fib-label.nrrd", None)):
            if (root / scene).exists():
                made.append((str((root / scene).parent), Path(scene).name, segmentation))
        for pattern in ("dicom_seg/*.nrrd", "edge/nrrd_*/*.n*", "edge/nifti/*"):
            made += [(str(file.parent), file.name, None) for file in sorted(root.glob(pattern))]
    return made


def cases(folder):
    made = []
    for root in filter(None, os.environ.get("PALPATE_DATA", "").split(":")):
        script = Path(root, "cases", "make_cases.py")
        if not script.exists():
            continue
        subprocess.run([sys.executable, script, folder], check=True, stdout=subprocess.DEVNULL)
        made += [(str(folder), file.name, None) for file in sorted(Path(folder).iterdir())
                 if file.is_file() and file.name.endswith((".nrrd", ".nii", ".nii.gz", ".mha"))]
    return made


def natively(folder, scene, segmentation):
    """As read_files.mjs, by libpalpate, with the same names in messages."""
    here = os.getcwd()
    os.chdir(folder)
    try:
        model = palpate.load(scene, segmentation)
    except palpate.Error as error:
        return {"problem": str(error)}
    finally:
        os.chdir(here)
    sha = lambda values: hashlib.sha256(np.asarray(values).tobytes(order="F")).hexdigest()
    try:
        scan = sha(model.scan())
    except palpate.Error:
        scan = None
    return {"hash": str(model.hash), "dims": list(model.shape), "spacing": model.spacing.tolist(),
            "direction": model.direction.ravel().tolist(), "origin": model.origin.tolist(), "labels": sha(model.labels()), "scan": scan}


def is_equal(ours, other):
    """Whether all is equal to the bit, but for the last bits of a position: WebAssembly has mathematical functions of its own."""
    place = ("spacing", "direction", "origin")
    unequal = {key for key in {**ours, **other} if ours.get(key) != other.get(key)}
    if unequal - {*place, "hash"} or unequal == {"hash"}:
        return False
    return all(np.allclose(ours[key], other[key], rtol=1e-14, atol=1e-14) for key in place if key in unequal)


def main():
    module = Path(sys.argv[1])
    print(f"PALPATE_TEST_SEED={SEED}")
    with tempfile.TemporaryDirectory() as folder:
        files = generate(Path(folder, "made")) + cases(str(Path(folder, "cases"))) + shared()
        listing = Path(folder, "list.json")
        listing.write_text(json.dumps(files))
        run = subprocess.run(["node", "--no-warnings", Path(__file__).with_name("read_files.mjs"), module, listing], check=True,
                             capture_output=True, text=True)
        others = json.loads(run.stdout)
        read, refused, different = 0, 0, []
        for one, other in zip(files, others, strict=True):
            name, ours = "/".join(filter(None, one[1:])), natively(*one)
            seconds, memory = other.pop("seconds"), other.pop("memory_MiB", 0)
            # a page has less memory, and says so before it looks at the rest; it has no decoder of bzip2
            if ("problem" in ours and "this page may take" in other.get("problem", "")) or "compressed by bzip2" in other.get("problem", ""):
                refused += 1
                continue
            if not is_equal(ours, other):
                keys = [key for key in {**ours, **other} if ours.get(key) != other.get(key)]
                different.append(f"{name}: " + "; ".join(f"{key}: {ours.get(key)} | {other.get(key)}" for key in keys))
            read, refused = read + ("hash" in ours), refused + ("problem" in ours)
            if seconds > 2:
                print(f"{name}: {seconds:.1f} s, {memory:.0f} MiB in WebAssembly")
        print(f"{len(files)} files, {read} read, {refused} refused, {len(different)} differ")
        for line in different:
            print(line)
        assert read > 90 and refused > 20, "too few to compare anything"
        assert not different, "palpate.wasm reads other than libpalpate"
        for one in (files[1], next(file for file in files if file[1] == "a.seg.nrrd")):
            compare(module, one[1], sides=8, press_N=1.5, passes=5, soft=False, folder=one[0])


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main()
