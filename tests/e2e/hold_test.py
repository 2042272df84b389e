"""A tip held still by a simulated hand: what is printed and drawn, and what is said when it cannot be."""

import json
import re
import xml.etree.ElementTree as ElementTree

import cli

SVG = "{http://www.w3.org/2000/svg}"

# the founding fault: bones of one union, smoothed wider than their gap
UNION = """
[data]
labels = "{labels}"

[[tissue]]
name = "bone"
labels = ["femur", "tibia", "femoral_cartilage", "lateral_tibial_cartilage", "medial_tibial_cartilage"]

[preparation]
method = "union-gaussian"
sigma = 1.5
"""
GAP = "20,0,0"  # between the cartilages of femur and tibia


class Hold(cli.KneeTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.scene.write_text(UNION.format(labels=cls.labels))

    def figures(self, *arguments):
        return json.loads(self.succeed("hold", self.scene, *arguments, "--json").stdout)

    def test_the_table_has_a_row_for_each_method(self):
        done = self.succeed("hold", self.scene, "--at", GAP, "--method", "trilinear", "--method", "proxy")
        rows = re.findall(r"^(\S+) +[\d.]+ +[\d.]+ +[\d.]+ +[\d.]+ +-?[\d.]+  \S.*$", done.stdout, re.MULTILINE)
        self.assertEqual(rows, ["trilinear", "proxy"])
        self.assertIn("at 20.0, 0.0, 0.0 mm (LPS); premium-1.5, light-grip; 1000 Hz, 1 ms of delay", done.stdout)
        self.assertIn("within two encoder steps, 60 um", done.stdout)

    def test_figures_for_programs(self):
        figures = self.figures("--at", GAP, "--device", "touch", "--hand", "firm-grip", "--rate", "2000",
                               "--delay", "0.5", "--from", "20,1,0", "--method", "proxy")
        self.assertEqual([figures[key] for key in ("device", "hand", "rate_Hz", "delay_ms", "from_mm", "at_mm")],
                         ["touch", "firm-grip", 2000, 0.5, [20, 1, 0], [20, 0, 0]])
        self.assertEqual(figures["quiet_within_um"], 110)
        proxy = figures["methods"]["proxy"]
        self.assertEqual(sorted(proxy), ["dominant_Hz", "energy_out_mJ", "force_N", "inside", "peak_to_peak_um",
                                         "quiet", "rms_um", "wedged"])
        self.assertTrue(proxy["quiet"])

    def test_stiffness_is_a_fraction_of_the_recommended_one(self):
        own, half, whole = (self.figures("--at", "0,0,200", *more)["stiffness_N_per_mm"]
                            for more in ((), ("--stiffness", "0.5"), ("--stiffness", "1")))
        self.assertEqual(own, 1)
        self.assertAlmostEqual(whole, 0.71, delta=0.02)
        self.assertAlmostEqual(half, whole / 2, places=6)

    def test_a_voxel_is_a_place(self):
        there = self.figures("--voxel", "5,6,7")["at_mm"]
        moved = self.figures("--voxel", "6,6,7")["at_mm"]
        self.assertAlmostEqual(sum((a - b) ** 2 for a, b in zip(there, moved)), 1.5 ** 2, places=6)

    def test_the_picture_stands_alone(self):
        file = self.folder / "hold.svg"
        done = self.succeed("hold", self.scene, "--at", GAP, "--method", "trilinear", "--method", "proxy",
                            "-o", file)
        self.assertEqual(done.stderr, f"picture: {file}\n")
        root = ElementTree.parse(file).getroot()
        words = [element.text for element in root.iter(f"{SVG}text")]
        for part in ("trilinear", "proxy", "two encoder steps", "not for clinical use", "2 s"):
            self.assertTrue(any(part in text for text in words), part)
        ways = [e for e in root.iter(f"{SVG}path") if e.get("class") == "way"]
        self.assertEqual(len(ways), 2)
        content = file.read_text()
        self.assertEqual(re.findall(r"(?:href|src|url)\W", content), [])
        self.assertNotIn(str(self.labels.parent), content)

    def test_what_cannot_be_held(self):
        for code, arguments, says in (
                (cli.USAGE, [], "--at or --voxel"),
                (cli.USAGE, ["--at", GAP, "--voxel", "1,2,3"], "--at or --voxel"),
                (cli.BAD_INPUT, ["--voxel", "1,2,99999"], "--voxel: the volume has"),
                (cli.USAGE, ["--at", "1,2,nan"], "nan is not a number"),
                (cli.USAGE, ["--at", GAP, "--method", "magic"], "trilinear"),
                (cli.USAGE, ["--at", GAP, "--device", "magic"], "premium-1.5"),
                (cli.USAGE, ["--at", GAP, "--rate", "1"], "number between"),
                (cli.USAGE, ["--at", GAP, "--delay", "50"], "number between"),
                (cli.USAGE, ["--at", GAP, "-o", "f.png"], "ends in .svg")):
            with self.subTest(arguments):
                self.expect_error(code, "hold", self.scene, *arguments, message=says)
        self.expect_error(cli.BAD_INPUT, "hold", self.folder / "missing.toml", "--at", GAP, message="missing")
        self.expect_error(cli.OUTPUT, "hold", self.scene, "--at", GAP, "-o", self.folder / "missing" / "f.svg",
                          message="missing")


if __name__ == "__main__":
    cli.share_prepared_models()
    cli.main()
