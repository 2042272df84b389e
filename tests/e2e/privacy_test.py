"""A patient's name in a path, in NRRD keys or in NIfTI text appears in no output file."""

import os
import re
import struct
import zlib

import cli
from canary_files import (CANARY, dicom_with_canary, everything_in, nifti_with_canary, nrrd_with_canary, obj_with_canary,
                          ply_with_canary, stl_with_canary, vtk_with_canary, vtp_with_canary)
from volume_files import ball, sphere

class Privacy(cli.PalpateTest):
    def test_no_output_carries_the_name(self):
        n = 40
        labelled = ball((n, n, n), 10)
        named = self.folder / CANARY
        named.mkdir()
        labels, scan = named / f"{CANARY}.seg.nrrd", named / f"{CANARY}.nii.gz"
        nrrd_with_canary(labels, (n, n, n), labelled)
        nifti_with_canary(scan, (n, n, n), b"".join(struct.pack("<h", 100 * v + x * 7919 % 31) for x, v in enumerate(labelled)))
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
            values = [1000 if (i - 20) ** 2 + (j - 20) ** 2 + (k - 20) ** 2 < 150 else 7 for j in range(n) for i in range(n)]
            dicom_with_canary(series / f"{CANARY}{k}", n, k, struct.pack(f"<{n * n}H", *values))
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
            done = self.expect_error(cli.BAD_INPUT, verb, series, env=environment)
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
        labelled = ball((n, n, n), 10)
        out, home, named = (self.folder / name for name in ("out", "home", f"{CANARY}_1957"))
        for folder in (out, home, named, named / "surfaces"):
            folder.mkdir()
        triangles = sphere((20, 20, 20), 10, around=24)
        surfaces = []
        for write, ending in ((stl_with_canary, "stl"), (obj_with_canary, "obj"), (ply_with_canary, "ply"), (vtk_with_canary, "vtk"), (vtp_with_canary, "vtp")):
            surfaces.append(named / f"{CANARY}.{ending}")
            write(surfaces[-1], triangles)
            write(named / "surfaces" / f"{CANARY}_{ending}.{ending}", triangles)
        stl_with_canary(named / "surfaces" / f"{CANARY}_femur_left.stl", sphere((32, 32, 32), 5, around=24))
        mask, tidy = named / "doe_canary.nii.gz", named / f"{CANARY}_Femur-left_19570411.nii.gz"
        for path in (mask, tidy):
            nifti_with_canary(path, (n, n, n), b"".join(struct.pack("<h", v) for v in labelled))
        scan = named / f"{CANARY}_scan.nii.gz"
        nifti_with_canary(scan, (n, n, n), b"".join(struct.pack("<h", 100 * v + x * 7919 % 31) for x, v in enumerate(labelled)))
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
