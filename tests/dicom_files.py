"""DICOM files that tests make: data elements in explicit little endian, and structure sets."""

import struct

STRUCTURE_SET = "1.2.840.10008.5.1.4.1.1.481.3"


def element(group, number, kind, value):
    """A data element. A sequence's value is its items, each a list of what element() takes."""
    if kind == "SQ":
        items = [b"".join(element(*one) for one in item) for item in value]
        value = b"".join(struct.pack("<HHI", 0xfffe, 0xe000, len(item)) + item for item in items)
    value = value.encode() if isinstance(value, str) else value
    value += (b"\0" if kind in ("UI", "OW") else b" ") * (len(value) % 2)
    length = struct.pack("<HI", 0, len(value)) if kind in ("OW", "SQ", "UN") else struct.pack("<H", len(value))
    return struct.pack("<HH", group, number) + kind.encode() + length + value


def write_file(path, storage, instance, data):
    """A file of one object. @param data  what element() takes, in the order of the tags"""
    meta = element(2, 2, "UI", storage) + element(2, 3, "UI", instance) + element(2, 0x10, "UI", "1.2.840.10008.1.2.1")
    path.write_bytes(b"\0" * 128 + b"DICM" + element(2, 0, "UL", struct.pack("<I", len(meta))) + meta
                     + b"".join(element(*one) for one in data))


def write_structure_set(path, structures, series, frame_of_reference="1.2.3.5"):
    """An RTSTRUCT.

    @param structures  (name, [(z, [(x, y), ...]), ...]): planar contours in mm, LPS
    @param series  of the images that they were drawn on
    """
    rois, contours, observations = [], [], []
    for number, (name, outlines) in enumerate(structures, 1):
        rois.append([(0x3006, 0x22, "IS", str(number)), (0x3006, 0x26, "LO", name)])
        drawn = [[(0x3006, 0x42, "CS", "CLOSED_PLANAR"), (0x3006, 0x46, "IS", str(len(points))),
                  (0x3006, 0x50, "DS", "\\".join(f"{x:.4f}\\{y:.4f}\\{z:.4f}" for x, y in points))] for z, points in outlines]
        contours.append([(0x3006, 0x2a, "IS", "255\\51\\0"), (0x3006, 0x40, "SQ", drawn), (0x3006, 0x84, "IS", str(number))])
        observations.append([(0x3006, 0x84, "IS", str(number))])
    of_series = [[(0x3006, 0x14, "SQ", [[(0x20, 0x0e, "UI", series)]])]]
    write_file(path, STRUCTURE_SET, "1.2.3.500.1", [
        (8, 0x16, "UI", STRUCTURE_SET), (8, 0x18, "UI", "1.2.3.500.1"), (8, 0x60, "CS", "RTSTRUCT"),
        (0x20, 0x0e, "UI", "1.2.3.500"),
        (0x3006, 0x10, "SQ", [[(0x20, 0x52, "UI", frame_of_reference), (0x3006, 0x12, "SQ", of_series)]]),
        (0x3006, 0x20, "SQ", rois), (0x3006, 0x39, "SQ", contours), (0x3006, 0x80, "SQ", observations)])
