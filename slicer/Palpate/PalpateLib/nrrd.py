"""Writes scans and segmentations as NRRD. Positions in the files are LPS."""

import numpy as np

from .grid import RAS_LPS

TYPES = {"int8": "int8", "uint8": "uint8", "int16": "int16", "uint16": "uint16", "int32": "int32", "uint32": "uint32",
         "int64": "int64", "uint64": "uint64", "float32": "float", "float64": "double"}


def _vector(mm):
    # repr() of a float is exact
    return "(" + ",".join(repr(float(x)) for x in mm) + ")"


def _value(text):
    """A text as the value of a free field: one line."""
    return "".join(c if c.isprintable() else " " for c in text)


def _head(grid, type_name, layers, fields):
    steps, first = RAS_LPS @ grid.steps_mm, RAS_LPS @ grid.first_mm
    # layers of a segmentation are a fourth axis, the slowest
    dimension, sizes, no_direction, kind = (3, "", "", "") if layers is None else (4, f" {layers}", " none", " list")
    lines = ["NRRD0005", f"type: {type_name}", f"dimension: {dimension}", "space: left-posterior-superior",
             "sizes: " + " ".join(map(str, grid.dims)) + sizes,
             "space directions: " + " ".join(_vector(steps[:, n]) for n in range(3)) + no_direction,
             "kinds: domain domain domain" + kind, "endian: little", "encoding: raw", "space origin: " + _vector(first)]
    lines += [f"{key}:={_value(value)}" for key, value in fields]
    return ("\n".join(lines) + "\n\n").encode()


def _write(path, head, arrays):
    with open(path, "wb") as file:
        file.write(head)
        for array in arrays:
            file.write(np.ascontiguousarray(array.astype(array.dtype.newbyteorder("<"), copy=False)).tobytes())


def write_scan(path, grid, voxels):
    """@param voxels  array of the grid's shape, of a type in TYPES"""
    _write(path, _head(grid, TYPES[voxels.dtype.name], None, []), [voxels])


def write_segmentation(path, grid, labels):
    """Writes a .seg.nrrd. @param labels  Labels on that grid"""
    fields = []
    for n, segment in enumerate(labels.segments):
        fields += [(f"Segment{n}_ID", segment.id), (f"Segment{n}_Name", segment.name),
                   (f"Segment{n}_Color", " ".join(f"{part:.6f}" for part in segment.colour)),
                   (f"Segment{n}_LabelValue", str(segment.label)), (f"Segment{n}_Layer", str(segment.layer)),
                   (f"Segment{n}_Extent", " ".join(f"0 {count - 1}" for count in grid.dims))]
    layers = len(labels.layers)
    _write(path, _head(grid, "uint16", layers if layers > 1 else None, fields), labels.layers)
