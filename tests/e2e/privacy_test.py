"""A patient's name in a path, in NRRD keys or in NIfTI's text leaves it nowhere but on the terminal."""

import gzip
import os
import re
import struct
import subprocess
import zlib

import cli

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


def everything_in(path):
    """A file's bytes, and what lies compressed in them: streams of zlib or gzip anywhere, HDF5 by its tools."""
    data = path.read_bytes()
    found = [data]
    for start in [m.start() for m in re.finditer(rb"\x78[\x01\x5e\x9c\xda]|\x1f\x8b\x08", data)]:
        try:
            found.append(zlib.decompressobj(47).decompress(data[start:], 1 << 26))
        except zlib.error:
            pass
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
        nifti_with_canary(scan, (n, n, n), b"".join(struct.pack("<h", 100 * v + 7) for v in ball))
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
        scene.write_text(scene.read_text().replace("felt = false", "felt = true"))
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

        outputs = [p for folder in (out, home) for p in folder.rglob("*") if p.is_file()]
        self.assertGreaterEqual(len(outputs), 5)
        self.assertTrue(any(path.suffix == ".kept" for path in outputs))
        for path in outputs:
            self.assertNotIn(CANARY, path.name)
            for content in everything_in(path):
                self.assertNotIn(CANARY.encode(), content, path.name)
                self.assertNotIn(b"CANARY", content, path.name)

    def test_the_search_itself_finds_what_is_hidden(self):
        # a search that finds nothing anywhere would prove nothing
        hidden = self.folder / "hidden.bin"
        hidden.write_bytes(b"....." + zlib.compress(CANARY.encode() * 3))
        self.assertTrue(any(CANARY.encode() in content for content in everything_in(hidden)))


if __name__ == "__main__":
    cli.main()
