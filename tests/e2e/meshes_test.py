"""Surfaces as segmentations: a file or a folder of them becomes labels on the scan, and is felt."""

import json
import math

import cli
from volume_files import grid, sphere, write_nrrd, write_obj, write_stl

SIZES, SPACING, ORIGIN = (60, 56, 48), (1.0, 1.0, 1.25), (-90.0, 30.0, -40.0)


def in_ras(triangles, unit=1.0):
    return [tuple((-x / unit, -y / unit, z / unit) for x, y, z in triangle) for triangle in triangles]


class Meshes(cli.PalpateTest):
    def setUp(self):
        super().setUp()
        # the scan: nothing but its grid counts
        self.scan = write_nrrd(self.folder / "scan.nrrd", SIZES, bytes(n % 251 for n in range(math.prod(SIZES))), geometry=grid(SPACING, ORIGIN))
        self.middle = tuple(o + 0.5 * s * (n - 1) for o, s, n in zip(ORIGIN, SPACING, SIZES))

    def test_a_folder_in_ras_metres_is_proven_by_the_scan_and_felt(self):
        surfaces = self.folder / "surfaces"
        surfaces.mkdir()
        bone, cartilage = sphere(self.middle, 12), sphere((self.middle[0], self.middle[1], self.middle[2] + 9), 8)
        write_stl(surfaces / "femur.stl", in_ras(bone, 1000))
        write_obj(surfaces / "femoral_cartilage.obj", in_ras(cartilage, 1000))
        (surfaces / "notes.txt").write_text("of somebody")
        scene = self.folder / "scene.toml"
        done = self.succeed("scene", "new", self.scan, surfaces, "-o", scene)
        self.assertIn("is read as RAS in m: so 100 % of its points lie in the scan, as LPS 0 %", done.stderr)
        self.assertIn("1 other file in it is no surface", done.stderr)
        self.assertIn("overlap in", done.stderr)
        self.assertIn('"femur"', scene.read_text())
        self.assertIn('"femoral_cartilage"', scene.read_text())
        picture = self.folder / "section.png"
        self.succeed("section", scene, "-o", picture)
        self.assertGreater(picture.stat().st_size, 1000)
        said = self.succeed("simulate", self.scan, surfaces, "-o", self.folder / "run.h5")
        self.assertIn("2 structures felt", said.stdout + said.stderr)
        # the sizes are the spheres'
        info = json.loads(self.succeed("info", surfaces, "--json").stdout)
        volumes = {label["name"]: label["volume_mm3"] for label in info["labels"]}
        # nobody says that these are metres: 12 mm are 0.012
        self.assertAlmostEqual(volumes["femur"] * 1e9 / (4 / 3 * math.pi * 12 ** 3), 1, delta=0.01)

    def test_what_cannot_be_known_is_asked_for(self):
        centred = self.folder / "centred.nrrd"
        centred.write_bytes(self.scan.read_bytes().replace(b"(-90.0,30.0,-40.0)", b"(-30.0,-28.0,-30.0)"))
        femur = self.folder / "femur.stl"
        write_stl(femur, sphere((3, 4, 5), 12))
        self.expect_error(cli.BAD_INPUT, "scene", "new", centred, femur, message="--mesh-space")
        scene = self.folder / "scene.toml"
        done = self.succeed("scene", "new", centred, femur, "--mesh-space", "ras", "-o", scene)
        self.assertIn("RAS (as requested)", done.stderr)
        # the scene keeps it
        self.assertIn('mesh_space = "ras"', scene.read_text())
        self.assertIn("a valid scene", self.succeed("scene", "check", scene).stdout)
        # 3D Slicer says it
        write_stl(femur, sphere((3, 4, 5), 12), b"3D Slicer output. SPACE=LPS")
        self.assertIn("LPS (as stated in the file)", self.succeed("scene", "new", centred, femur).stderr)
        # alone: on a grid of its own, without sides
        write_stl(femur, sphere((3, 4, 5), 12))
        done = self.succeed("info", femur)
        self.assertIn("sides are unknown", done.stdout + done.stderr)
        self.assertIn("femur", done.stdout)
        # made elsewhere
        write_stl(femur, sphere((300, 400, 500), 12))
        self.expect_error(cli.BAD_INPUT, "scene", "new", centred, femur, message="does not lie in the scan")

    def test_a_surface_with_a_hole_has_an_inside(self):
        whole = sphere(self.middle, 14)
        holed = [t for t in whole if t[0][0] - self.middle[0] < 11.5]
        self.assertLess(len(holed), len(whole))
        femur = self.folder / "femur.stl"
        write_stl(femur, holed)
        done = self.succeed("scene", "new", self.scan, femur)
        self.assertIn("is not closed everywhere", done.stderr)
        self.assertIn("edges", done.stderr)

    def test_damage_is_one_error(self):
        femur = self.folder / "femur.stl"
        write_stl(femur, sphere(self.middle, 12))
        femur.write_bytes(femur.read_bytes()[:-100])
        self.expect_error(cli.BAD_INPUT, "info", femur, message="it ends after")
        self.expect_error(cli.BAD_INPUT, "section", self.scan.rename(self.folder / "s.stl"), "-o", self.folder / "x.png")


if __name__ == "__main__":
    cli.share_prepared_models()
    cli.main()
