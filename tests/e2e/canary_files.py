"""Volumes and surfaces that carry a patient's name in every place a writer may put one, and the search for it in other files."""

import gzip
import pathlib
import re
import struct
import subprocess
import sys
import zlib

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import dicom_files
from volume_files import nifti1, nifti_extension

CANARY = "DOE^CANARY"


def nrrd_with_canary(path, dims, voxels):
    """A label map as NRRD with the canary in every place a writer might put a name."""
    sizes = " ".join(map(str, dims))
    header = (f"NRRD0005\n# {CANARY} made this\ntype: uchar\ndimension: 3\nspace: left-posterior-superior\n"
              f"sizes: {sizes}\nspace directions: (1,0,0) (0,1,0) (0,0,1)\nkinds: domain domain domain\n"
              f"encoding: gzip\nspace origin: (0,0,0)\ncontent: {CANARY}\n"
              f"PatientName:={CANARY}\nDICOM.PatientID:={CANARY}\n"
              "Segment0_ID:=Segment_1\nSegment0_Name:=ball\nSegment0_Color:=0.9 0.8 0.7\nSegment0_LabelValue:=1\n"
              f"Segment0_Layer:=0\nSegment0_Tags:=Note:{CANARY}|\n\n")
    path.write_bytes(header.encode() + gzip.compress(voxels))


def nifti_with_canary(path, dims, values):
    """A scan as NIfTI-1 with the canary in its description, intent, auxiliary file and an extension."""
    text = CANARY.encode()
    data = nifti1(dims, values, code="h", datatype=4, sform=((-1, 0, 0, 0), (0, -1, 0, 0), (0, 0, 1, 0)), slope=1,
                  extension=nifti_extension(6, text, 32), text=text)
    path.write_bytes(gzip.compress(data))


def dicom_with_canary(path, n, k, values):
    """A CT slice, with the canary wherever a person or free text stands."""
    def whole(value):
        return struct.pack("<H", value)
    storage = "1.2.840.10008.5.1.4.1.1.2"
    data = [(8, 0x08, "CS", "ORIGINAL\\PRIMARY\\AXIAL"), (8, 0x16, "UI", storage), (8, 0x18, "UI", f"1.2.3.{k}"),
            (8, 0x20, "DA", "19570411"), (8, 0x50, "SH", CANARY), (8, 0x60, "CS", "CT"), (8, 0x80, "LO", CANARY),
            (8, 0x1030, "LO", CANARY), (8, 0x103e, "LO", CANARY), (16, 0x10, "PN", CANARY), (16, 0x20, "LO", CANARY),
            (16, 0x30, "DA", "19570411"), (32, 0x0d, "UI", "1.2.3.19570411"), (32, 0x0e, "UI", "1.2.3.19570411.1"),
            (32, 0x10, "SH", CANARY), (32, 0x32, "DS", f"0\\0\\{k}"), (32, 0x37, "DS", "1\\0\\0\\0\\1\\0"),
            (32, 0x4000, "LT", CANARY), (40, 0x02, "US", whole(1)), (40, 0x04, "CS", "MONOCHROME2"),
            (40, 0x10, "US", whole(n)), (40, 0x11, "US", whole(n)), (40, 0x30, "DS", "1\\1"),
            (40, 0x100, "US", whole(16)), (40, 0x101, "US", whole(16)), (40, 0x102, "US", whole(15)),
            (40, 0x103, "US", whole(0)), (0x29, 0x10, "LO", CANARY), (0x29, 0x1001, "LO", CANARY),
            (0x7fe0, 0x10, "OW", values)]
    dicom_files.write_file(path, storage, f"1.2.3.{k}", data)


def stl_with_canary(path, triangles):
    lines = ["solid " + CANARY]
    for triangle in triangles:
        lines += ["facet normal 0 0 0", "outer loop", *(f"vertex {x} {y} {z}" for x, y, z in triangle), "endloop", "endfacet"]
    path.write_text("\n".join(lines + ["endsolid " + CANARY]) + "\n")


def obj_with_canary(path, triangles):
    lines = [f"# {CANARY}", f"o {CANARY}"] + [f"v {x} {y} {z}" for t in triangles for x, y, z in t]
    path.write_text("\n".join(lines + [f"f {3 * n + 1} {3 * n + 2} {3 * n + 3}" for n in range(len(triangles))]) + "\n")


def ply_with_canary(path, triangles):
    head = (f"ply\nformat ascii 1.0\ncomment {CANARY}\nelement vertex {3 * len(triangles)}\nproperty float x\nproperty float y\n"
            f"property float z\nelement face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n")
    path.write_text(head + "".join(f"{x} {y} {z}\n" for t in triangles for x, y, z in t)
                    + "".join(f"3 {3 * n} {3 * n + 1} {3 * n + 2}\n" for n in range(len(triangles))))


def vtk_with_canary(path, triangles):
    path.write_text(f"# vtk DataFile Version 3.0\n{CANARY}\nASCII\nDATASET POLYDATA\nPOINTS {3 * len(triangles)} float\n"
                    + "".join(f"{x} {y} {z}\n" for t in triangles for x, y, z in t)
                    + f"POLYGONS {len(triangles)} {4 * len(triangles)}\n"
                    + "".join(f"3 {3 * n} {3 * n + 1} {3 * n + 2}\n" for n in range(len(triangles))))


def vtp_with_canary(path, triangles):
    def array(kind, name, values, more=""):
        return f'<DataArray type="{kind}" Name="{name}"{more} format="ascii">{" ".join(map(str, values))}</DataArray>'
    points = [x for t in triangles for p in t for x in p]
    path.write_text('<?xml version="1.0"?>\n<!-- ' + CANARY + ' -->\n<VTKFile type="PolyData" version="0.1" byte_order="LittleEndian"><PolyData>'
                    f'<Piece NumberOfPoints="{3 * len(triangles)}" NumberOfPolys="{len(triangles)}"><Points>'
                    + array("Float32", "Points", points, ' NumberOfComponents="3"') + "</Points><Polys>"
                    + array("Int32", "connectivity", range(3 * len(triangles)))
                    + array("Int32", "offsets", range(3, 3 * len(triangles) + 1, 3)) + "</Polys></Piece></PolyData></VTKFile>\n")


def everything_in_bytes(data):
    """Bytes, and what is compressed in them: streams of zlib or gzip anywhere."""
    found = [data]
    for start in [m.start() for m in re.finditer(rb"\x78[\x01\x5e\x9c\xda]|\x1f\x8b\x08", data)]:
        try:
            found.append(zlib.decompressobj(47).decompress(data[start:], 1 << 26))
        except zlib.error:
            pass
    return found


def everything_in(path):
    """A file's bytes, and what is compressed in them, HDF5 by its tools."""
    found = everything_in_bytes(path.read_bytes())
    if path.suffix == ".h5":
        found.append(subprocess.run(["h5dump", str(path)], capture_output=True, check=True).stdout)
    return found
