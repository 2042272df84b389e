#!/usr/bin/env python3
"""Draws sections of the generated knee: python3 phantom-sections.py FOLDER PICTURE.png

FOLDER is where `palpate data fetch knee-phantom -o FOLDER` put the two volumes. Needs NumPy.
"""
import gzip
import struct
import sys
import zlib
from pathlib import Path

import numpy as np

TYPES = {"float": "<f4", "uint8": "u1", "unsigned char": "u1", "uint16": "<u2", "unsigned short": "<u2"}


def read_nrrd(path):
    """Voxels indexed [k, j, i] and the header's fields."""
    data = path.read_bytes()
    end = data.index(b"\n\n")
    fields = {}
    for line in data[:end].decode().splitlines()[1:]:
        key, _, value = line.partition(":")
        if not line.startswith("#"):
            fields[key] = value.lstrip("= ").strip()
    voxels = np.frombuffer(gzip.decompress(data[end + 2 :]), TYPES[fields["type"]])
    return voxels.reshape([int(n) for n in fields["sizes"].split()][::-1]), fields


def colours(fields):
    """The colour of every label, from Slicer's segment fields."""
    table = np.zeros((256, 3))
    for key, value in fields.items():
        if key.endswith("_LabelValue"):
            table[int(value)] = [float(c) for c in fields[key.replace("LabelValue", "Color")].split()]
    return 255 * table


def section(volume, axis, mm, origin, spacing):
    image = np.take(volume, round((mm - origin[axis]) / spacing), 2 - axis)
    return image if axis == 2 else image[::-1]  # superior and anterior are up


def write_png(path, image):
    rows = b"".join(b"\0" + row.tobytes() for row in image.astype(np.uint8))
    chunk = lambda kind, body: struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
    header = struct.pack(">IIBBBBB", image.shape[1], image.shape[0], 8, 2, 0, 0, 0)
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows, 9)) + chunk(b"IEND", b"")
    )


def main():
    folder = Path(sys.argv[1])
    scan, fields = read_nrrd(folder / "knee-phantom.nrrd")
    labels, segments = read_nrrd(folder / "knee-phantom.seg.nrrd")
    table = colours(segments)
    origin = [float(x) for x in fields["space origin"].strip("()").split(",")]
    spacing = float(fields["space directions"].split(",")[0].strip("("))

    rows = []
    for coloured in (False, True):
        tiles = []
        for axis, mm in ((0, 20.0), (1, 5.0), (2, 27.0)):  # sagittal, coronal, axial
            # 64 greys are enough to see by and make a small file
            grey = np.clip(section(scan, axis, mm, origin, spacing) / 900, 0, 1) * 63 // 1 * 4
            image = np.repeat(grey[..., None], 3, 2)
            if coloured:
                label = section(labels, axis, mm, origin, spacing)
                shade = 0.45 * image + 0.55 * table[label]
                image = np.where((label > 0)[..., None], shade, image) // 4 * 4
            tile = np.zeros((200, 183, 3))
            tile[: image.shape[0], : image.shape[1]] = image[:200, :183]
            tiles.append(tile)
        rows.append(np.hstack(tiles))
    write_png(Path(sys.argv[2]), np.vstack(rows))


main()
