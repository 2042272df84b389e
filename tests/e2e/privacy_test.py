"""A patient's name in a path, in NRRD keys or in NIfTI's text leaves it nowhere but on the terminal."""

import gzip
import math
import os
import re
import struct
import subprocess
import zlib

import cli
import dicom_files

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
    extension = struct.pack("<ii", 32, 6) + text.ljust(24, b"\0")
    header = bytearray(348)
    struct.pack_into("<i", header, 0, 348)
    struct.pack_into("<8h", header, 40, 3, *dims, 1, 1, 1, 1)
    struct.pack_into("<hh", header, 70, 4, 16)
    struct.pack_into("<8f", header, 76, 1, 1, 1, 1, 0, 0, 0, 0)
    struct.pack_into("<f", header, 108, 352 + len(extension))
    struct.pack_into("<f", header, 112, 1)
    header[148:148 + len(text)] = text
    header[228:228 + len(text)] = text
    header[328:328 + len(text)] = text
    struct.pack_into("<hh", header, 252, 0, 1)
    for row, values4 in enumerate([(-1, 0, 0, 0), (0, -1, 0, 0), (0, 0, 1, 0)]):
        struct.pack_into("<4f", header, 280 + 16 * row, *values4)
    header[344:348] = b"n+1\0"
    path.write_bytes(gzip.compress(bytes(header) + b"\1\0\0\0" + extension + values))


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


def sphere(centre, radius, around=24):
    """Triangles of a sphere, counter-clockwise seen from outside."""
    def point(u, v):
        turn, fall = 2 * math.pi * (u % around) / around, math.pi * v / (around // 2)
        ring = 0 if v in (0, around // 2) else radius * math.sin(fall)
        return tuple(c + d for c, d in zip(centre, (ring * math.cos(turn), ring * math.sin(turn), radius * math.cos(fall))))

    def faces(u, v):
        a, b, c, d = point(u, v), point(u + 1, v), point(u, v + 1), point(u + 1, v + 1)
        return ((a, c, d), (a, d, b))
    return [triangle for v in range(around // 2) for u in range(around) for triangle in faces(u, v)]


def stl(path, triangles):
    lines = ["solid " + CANARY]
    for triangle in triangles:
        lines += ["facet normal 0 0 0", "outer loop", *(f"vertex {x} {y} {z}" for x, y, z in triangle), "endloop", "endfacet"]
    path.write_text("\n".join(lines + ["endsolid " + CANARY]) + "\n")


def obj(path, triangles):
    lines = [f"# {CANARY}", f"o {CANARY}"] + [f"v {x} {y} {z}" for t in triangles for x, y, z in t]
    path.write_text("\n".join(lines + [f"f {3 * n + 1} {3 * n + 2} {3 * n + 3}" for n in range(len(triangles))]) + "\n")


def ply(path, triangles):
    head = (f"ply\nformat ascii 1.0\ncomment {CANARY}\nelement vertex {3 * len(triangles)}\nproperty float x\nproperty float y\n"
            f"property float z\nelement face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n")
    path.write_text(head + "".join(f"{x} {y} {z}\n" for t in triangles for x, y, z in t)
                    + "".join(f"3 {3 * n} {3 * n + 1} {3 * n + 2}\n" for n in range(len(triangles))))


def vtk(path, triangles):
    path.write_text(f"# vtk DataFile Version 3.0\n{CANARY}\nASCII\nDATASET POLYDATA\nPOINTS {3 * len(triangles)} float\n"
                    + "".join(f"{x} {y} {z}\n" for t in triangles for x, y, z in t)
                    + f"POLYGONS {len(triangles)} {4 * len(triangles)}\n"
                    + "".join(f"3 {3 * n} {3 * n + 1} {3 * n + 2}\n" for n in range(len(triangles))))


def vtp(path, triangles):
    def array(kind, name, values, more=""):
        return f'<DataArray type="{kind}" Name="{name}"{more} format="ascii">{" ".join(map(str, values))}</DataArray>'
    points = [x for t in triangles for p in t for x in p]
    path.write_text('<?xml version="1.0"?>\n<!-- ' + CANARY + ' -->\n<VTKFile type="PolyData" version="0.1" byte_order="LittleEndian"><PolyData>'
                    f'<Piece NumberOfPoints="{3 * len(triangles)}" NumberOfPolys="{len(triangles)}"><Points>'
                    + array("Float32", "Points", points, ' NumberOfComponents="3"') + "</Points><Polys>"
                    + array("Int32", "connectivity", range(3 * len(triangles)))
                    + array("Int32", "offsets", range(3, 3 * len(triangles) + 1, 3)) + "</Polys></Piece></PolyData></VTKFile>\n")


def everything_in_bytes(data):
    """Bytes, and what lies compressed in them: streams of zlib or gzip anywhere."""
    found = [data]
    for start in [m.start() for m in re.finditer(rb"\x78[\x01\x5e\x9c\xda]|\x1f\x8b\x08", data)]:
        try:
            found.append(zlib.decompressobj(47).decompress(data[start:], 1 << 26))
        except zlib.error:
            pass
    return found


def everything_in(path):
    """A file's bytes, and what lies compressed in them, HDF5 by its tools."""
    found = everything_in_bytes(path.read_bytes())
    if path.suffix == ".h5":
        found.append(subprocess.run(["h5dump", str(path)], capture_output=True, check=True).stdout)
    return found


class Privacy(cli.PalpateTest):
    def test_no_output_carries_the_name(self):
        n = 40
        ball = bytes(1 if (i - 20) ** 2 + (j - 20) ** 2 + (k - 20) ** 2 < 100 else 0
                     for k in range(n) for j in range(n) for i in range(n))
        named = self.folder / CANARY
        named.mkdir()
        labels, scan = named / f"{CANARY}.seg.nrrd", named / f"{CANARY}.nii.gz"
        nrrd_with_canary(labels, (n, n, n), ball)
        nifti_with_canary(scan, (n, n, n), b"".join(struct.pack("<h", 100 * v + x * 7919 % 31) for x, v in enumerate(ball)))
        scene = named / "scene.toml"
        out = self.folder / "out"
        out.mkdir()
        home = self.folder / "home"
        home.mkdir()
        environment = dict(os.environ, HOME=str(home), XDG_DATA_HOME=str(home / "data"),
                           XDG_CACHE_HOME=str(home / "cache"), TMPDIR=str(home))
        # what is prepared is kept there
        del environment["PALPATE_CACHE"]
        # the scene file lies beside the data and names it: it is the user's, not an output that travels
        self.succeed("scene", "new", scan, labels, "-o", scene, env=environment)
        scene.write_text(scene.read_text().replace("touchable = false", "touchable = true"))
        script = named / f"{CANARY}.toml"
        script.write_text(f'# for {CANARY}\n[[step]]\napproach = "ball"\n[[step]]\npress = 0.5\n'
                          '[[step]]\nhold = 0.6\n[[step]]\nleave = true\n')
        self.succeed("info", labels, env=environment)
        self.succeed("prepare", labels, "-o", out / "field.nrrd", env=environment)
        self.succeed("prepare", scene, "-o", out / "field.nii.gz", env=environment)
        self.succeed("simulate", scene, "--script", script, "-o", out / "run.h5", env=environment)
        self.succeed("report", out / "run.h5", scene, "-o", out / "run.html", env=environment)
        self.succeed("replay", out / "run.h5", scene, env=environment)
        self.succeed("forces", scene, "-o", out / "forces.svg", env=environment)
        self.succeed("section", scene, "-o", out / "section.png", env=environment)
        self.succeed("lint", scene, "--page", out / "lint.html", "--json", out / "lint.json", "--fix", out / "mended.seg.nrrd",
                     env=environment)

        outputs = [p for folder in (out, home) for p in folder.rglob("*") if p.is_file()]
        self.assertGreaterEqual(len(outputs), 5)
        self.assertTrue(any(path.suffix == ".kept" for path in outputs))
        for path in outputs:
            self.assertNotIn(CANARY, path.name)
            for content in everything_in(path):
                self.assertNotIn(CANARY.encode(), content, path.name)
                self.assertNotIn(b"CANARY", content, path.name)

    def test_dicom_says_nothing_of_the_patient(self):
        n = 40
        series, out, home = (self.folder / name for name in ("series", "out", "home"))
        for folder in (series, out, home):
            folder.mkdir()
        for k in range(n):
            ball = [1000 if (i - 20) ** 2 + (j - 20) ** 2 + (k - 20) ** 2 < 150 else 7 for j in range(n) for i in range(n)]
            dicom_with_canary(series / f"{CANARY}{k}", n, k, struct.pack(f"<{n * n}H", *ball))
        environment = dict(os.environ, HOME=str(home), XDG_DATA_HOME=str(home / "data"),
                           XDG_CACHE_HOME=str(home / "cache"), TMPDIR=str(home))
        del environment["PALPATE_CACHE"]
        said = []
        for arguments in (("info", series), ("info", series, "--json"), ("info", series, "--volume", 1),
                          ("scene", "new", "--scan", series, "--volume", 1, "-o", out / "scene.toml"),
                          ("section", series, "-o", out / "section.png"),
                          ("section", series, "-o", out / "section.dcm"),
                          ("render", series, "-o", out / "render.png"),
                          ("info", series, "--identifiers"), ("info", series, "--identifiers", "--json"),
                          ("simulate", out / "scene.toml", "-o", out / "run.h5", "--report", out / "run.html"),
                          ("simulate", series, "-o", out / "alone.h5"),
                          ("export", out / "alone.h5", series, "-o", out / "left.dcm"),
                          ("export", out / "alone.h5", series, "-o", out / "left.seg.nrrd"),
                          ("export", out / "alone.h5", "-o", out / "path.csv")):
            done = self.succeed(*arguments, env=environment)
            said.append(done.stdout + done.stderr)
        self.assertIn("CT, axial, 40 x 40 x 40, 1 x 1 x 1 mm", said[0])
        self.assertIn("scan_volume = 1", (out / "scene.toml").read_text())
        (series / f"{CANARY}7").unlink()
        for verb in ("info", "simulate"):
            done = self.fail_clearly(cli.BAD_INPUT, verb, series, env=environment)
            self.assertIn("a slice is missing between slice 7 of 39, at 6.00 mm", done.stdout + done.stderr)
            said.append(done.stdout + done.stderr)
        outputs = [p for folder in (out, home) for p in folder.rglob("*") if p.is_file()]
        self.assertGreaterEqual(len(outputs), 5)
        for text in said + [content.decode("latin-1") for path in outputs for content in everything_in(path)]:
            for secret in ("CANARY", "19570411"):
                self.assertNotIn(secret, text)

    @cli.long
    def test_a_structure_is_not_called_after_a_patient(self):
        # masks and surfaces are called after their files: of the names of these only what is anatomy may come through
        n = 40
        ball = bytes(1 if (i - 20) ** 2 + (j - 20) ** 2 + (k - 20) ** 2 < 100 else 0
                     for k in range(n) for j in range(n) for i in range(n))
        out, home, named = (self.folder / name for name in ("out", "home", f"{CANARY}_1957"))
        for folder in (out, home, named, named / "surfaces"):
            folder.mkdir()
        triangles = sphere((20, 20, 20), 10)
        surfaces = []
        for write, ending in ((stl, "stl"), (obj, "obj"), (ply, "ply"), (vtk, "vtk"), (vtp, "vtp")):
            surfaces.append(named / f"{CANARY}.{ending}")
            write(surfaces[-1], triangles)
            write(named / "surfaces" / f"{CANARY}_{ending}.{ending}", triangles)
        stl(named / "surfaces" / f"{CANARY}_femur_left.stl", sphere((32, 32, 32), 5))
        mask, tidy = named / "doe_canary.nii.gz", named / f"{CANARY}_Femur-left_19570411.nii.gz"
        for path in (mask, tidy):
            nifti_with_canary(path, (n, n, n), b"".join(struct.pack("<h", v) for v in ball))
        scan = named / f"{CANARY}_scan.nii.gz"
        nifti_with_canary(scan, (n, n, n), b"".join(struct.pack("<h", 100 * v + x * 7919 % 31) for x, v in enumerate(ball)))
        environment = dict(os.environ, HOME=str(home), XDG_DATA_HOME=str(home / "data"),
                           XDG_CACHE_HOME=str(home / "cache"), TMPDIR=str(home))
        del environment["PALPATE_CACHE"]
        script = named / "script.toml"
        for number, labels in enumerate([*surfaces, named / "surfaces", mask, tidy]):
            scene = named / "scene.toml"
            placed = () if labels in (mask, tidy) else ("--mesh-space", "lps")
            done = self.succeed("scene", "new", scan, labels, *placed, "--force", "-o", scene, env=environment)
            self.assertIn("known anatomical word", done.stderr)
            # the scene names its data, and nothing else of the patient
            told = [line for line in scene.read_text().splitlines() if not re.match(r"(scan|labels|#)", line)]
            self.assertNotIn("canary", "\n".join(told).lower())
            scene.write_text(scene.read_text().replace("\ntouchable = false", '\ntouchable = true\npreset = "bone"'))
            structure = "femur_left" if labels.is_dir() else "Femur-left" if labels == tidy else None
            approach = structure or "#1"
            script.write_text(f'[[step]]\napproach = "{approach}"\n[[step]]\npress = 0.5\n[[step]]\nleave = true\n')
            self.succeed("simulate", scene, "--script", script, "-o", out / f"{number}.h5", "--report",
                         out / f"{number}.html", env=environment)
            if labels not in (surfaces[0], mask):
                continue
            self.succeed("section", scene, "-o", out / f"{number}.png", env=environment)
            self.succeed("render", scene, "-o", out / f"{number}.render.png", env=environment)
            self.succeed("export", out / f"{number}.h5", scene, "-o", out / f"{number}.seg.nrrd", env=environment)
            self.succeed("export", labels, "-o", out / f"{number}.dcm", env=environment)
            self.succeed("prepare", scene, "-o", out / f"{number}.nrrd", env=environment)
            # a table names it what the user wants
            table = named / "names.tsv"
            table.write_text("value\tname\n1\tmy own\n")
            self.assertIn("my own", self.succeed("info", labels, "--names", table, env=environment).stdout)
            table.unlink()
        outputs = [p for folder in (out, home) for p in folder.rglob("*") if p.is_file()]
        self.assertGreaterEqual(len(outputs), 26)
        for path in outputs:
            for content in everything_in(path):
                for secret in (b"canary", b"1957"):
                    # digits of a float or of a DICOM UID are no date
                    if secret == b"1957" and path.suffix in (".h5", ".html", ".dcm"):
                        secret = b"19570411"
                    self.assertNotIn(secret, content.lower(), path.name)

    def test_the_search_itself_finds_what_is_hidden(self):
        # a search that finds nothing anywhere would prove nothing
        hidden = self.folder / "hidden.bin"
        hidden.write_bytes(b"....." + zlib.compress(CANARY.encode() * 3))
        self.assertTrue(any(CANARY.encode() in content for content in everything_in(hidden)))


if __name__ == "__main__":
    cli.spawn_only()
    cli.main()
