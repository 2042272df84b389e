"""Writers of small volumes, surfaces and pictures, as files of other programs."""

import itertools
import math
import struct
import zlib


# ---- voxels

def values_at(value, sizes):
    """value(i, j, k) of every voxel, i fastest."""
    return [value(i, j, k) for k, j, i in itertools.product(*map(range, reversed(sizes)))]


def voxel_bytes(values, sizes, code="B"):
    """Little-endian voxels.

    @param values  the bytes themselves, numbers with i fastest, or their function of (i, j, k)
    @param code  of a voxel for `struct`
    """
    if isinstance(values, bytes):
        return values
    values = values_at(values, sizes) if callable(values) else values
    return struct.pack(f"<{len(values)}{code}", *values)


def in_ball(place, sizes, radius):
    """Whether a voxel lies in a ball around the grid's middle; all in voxels."""
    (i, j, k), (ni, nj, nk) = place, sizes
    return (i - ni / 2) ** 2 + (j - nj / 2) ** 2 + (k - nk / 2) ** 2 < radius ** 2


def ball(sizes, radius):
    """Label map of `in_ball`: a byte a voxel, 1 inside."""
    return voxel_bytes(lambda *place: in_ball(place, sizes, radius), sizes)


def two_blocks(i, j, k):
    """Labels 1 and 2 of two structures that touch, in a grid of at least 20 voxels along each axis."""
    return (1 if i < 12 else 2) if 4 <= i < 20 and 4 <= j < 20 and 4 <= k < 20 else 0


# ---- NRRD

def nrrd_header(sizes, fields, type_="uint8"):
    """Header of a NRRD. @param sizes  the axes' sizes, or as a text, which may be wrong @param fields  further lines"""
    sizes = sizes if isinstance(sizes, str) else " ".join(map(str, sizes))
    return f"NRRD0004\ntype: {type_}\ndimension: {len(sizes.split())}\nsizes: {sizes}\n{fields}\n".encode()


def grid(spacing=(1, 1, 1), origin=(0, 0, 0)):
    """Fields of a NRRD's grid in LPS, mm."""
    directions = " ".join("(" + ",".join(str(step if a == b else 0) for b in range(3)) + ")" for a, step in enumerate(spacing))
    return f"space: left-posterior-superior\nspace directions: {directions}\nspace origin: ({','.join(map(str, origin))})\n"


def write_nrrd(file, sizes, values, type_="uint8", code="B", fields="", geometry=grid()):
    """Writes an uncompressed little-endian NRRD; returns the file.

    @param values  voxels as for `voxel_bytes`
    @param code  of a voxel for `struct`, as `type_` says
    @param geometry  lines of the grid, by default 1 mm along each axis
    """
    head = nrrd_header(sizes, f"endian: little\n{geometry}encoding: raw\n{fields}", type_)
    file.write_bytes(head + voxel_bytes(values, sizes, code))
    return file


# ---- NIfTI

IDENTITY = ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0))


def nifti1(sizes, values, intent=0, code="B", datatype=2, q_handedness=None, sform=IDENTITY, slope=0, extension=b"", text=b""):
    """A NIfTI-1 of 1 mm voxels.

    @param values  voxels as for `voxel_bytes`
    @param code  of a voxel for `struct`, which `datatype` is in the standard
    @param q_handedness  -1 or 1 for a qform beside the sform, which then is a mirror of it or not
    @param extension  of the header, its size and code included
    @param text  put into the description, the intent's name and the auxiliary file's name
    """
    head = bytearray(352)
    struct.pack_into("<i", head, 0, 348)
    struct.pack_into("<8h", head, 40, 3, *sizes, 1, 1, 1, 1)
    struct.pack_into("<hhh", head, 68, intent, datatype, 8 * struct.calcsize(code))
    struct.pack_into("<8f", head, 76, q_handedness or 1, 1, 1, 1, 0, 0, 0, 0)
    struct.pack_into("<ff", head, 108, 352 + len(extension), slope)
    head[123] = 2
    for at in (148, 228, 328):
        head[at:at + len(text)] = text
    struct.pack_into("<hh", head, 252, 0 if q_handedness is None else 1, 1)
    struct.pack_into("<12f", head, 280, *itertools.chain(*sform))
    head[344:347] = b"n+1"
    head[348] = 1 if extension else 0
    return bytes(head) + extension + voxel_bytes(values, sizes, code)


def nifti_extension(code, text, size=None):
    """An extension of a NIfTI header, padded with zeros to a multiple of 16 bytes, or to a size."""
    size = size or (len(text) + 8 + 15) // 16 * 16
    return struct.pack("<ii", size, code) + text.ljust(size - 8, b"\0")


def nifti2(sizes, values, intent=0):
    """A NIfTI-2 of 1 mm voxels of a byte each. @param values  as for `voxel_bytes`"""
    head = bytearray(544)
    struct.pack_into("<i8shh", head, 0, 540, b"n+2\0\r\n\x1a\n", 2, 8)
    struct.pack_into("<8q", head, 16, 3, *sizes, 1, 1, 1, 1)
    struct.pack_into("<8d", head, 104, 1, 1, 1, 1, 0, 0, 0, 0)
    struct.pack_into("<q", head, 168, 544)
    struct.pack_into("<ii", head, 344, 0, 1)
    struct.pack_into("<12d", head, 400, *itertools.chain(*IDENTITY))
    struct.pack_into("<ii", head, 500, 2, intent)
    return bytes(head) + voxel_bytes(values, sizes)


# ---- pictures

def png(width, height, rows, is_colour=False):
    """An 8-bit PNG. @param rows  bytes of each row: grey, or red, green and blue"""
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    head = struct.pack(">IIBBBBB", width, height, 8, 2 if is_colour else 0, 0, 0, 0)
    packed = zlib.compress(b"".join(b"\0" + row for row in rows))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", packed) + chunk(b"IEND", b"")


# ---- surfaces

def sphere(centre, radius, around=48):
    """Triangles of a sphere, counter-clockwise seen from outside. @param around  points along the equator"""
    def point(u, v):
        turn, fall = 2 * math.pi * (u % around) / around, math.pi * v / (around // 2)
        ring = 0 if v in (0, around // 2) else radius * math.sin(fall)
        return tuple(c + d for c, d in zip(centre, (ring * math.cos(turn), ring * math.sin(turn), radius * math.cos(fall))))

    def faces(u, v):
        a, b, c, d = point(u, v), point(u + 1, v), point(u, v + 1), point(u + 1, v + 1)
        return ((a, c, d), (a, d, b))
    return [triangle for v in range(around // 2) for u in range(around) for triangle in faces(u, v)]


def write_stl(path, triangles, header=b""):
    """A binary STL."""
    data = header.ljust(80) + struct.pack("<I", len(triangles))
    path.write_bytes(data + b"".join(struct.pack("<12fH", 0, 0, 0, *[x for p in t for x in p], 0) for t in triangles))


def write_obj(path, triangles):
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for t in triangles for x, y, z in t]
    lines += [f"f {3 * n + 1} {3 * n + 2} {3 * n + 3}" for n in range(len(triangles))]
    path.write_text("\n".join(lines) + "\n")
