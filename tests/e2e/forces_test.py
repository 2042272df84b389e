"""A force method's arrows over a section: for every method, in every plane, and what is said when it cannot be."""

import re
import xml.etree.ElementTree as ElementTree

import cli

METHODS = ["trilinear", "b-spline", "gaussian-sphere", "smooth-sphere", "stored-normals"]
SVG = "{http://www.w3.org/2000/svg}"


class Picture:
    """A picture that parsed as XML."""

    def __init__(self, path):
        self.root = ElementTree.parse(path).getroot()
        self.text = [element.text for element in self.root.iter(f"{SVG}text")]
        self.arrows = [e for e in self.root.iter(f"{SVG}path") if e.get("class").startswith("arrow")]

    def says(self, part):
        return any(part in text for text in self.text)


class Forces(cli.KneeTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        # by another method than the proxy nothing yields
        cls.new_scene(cls.labels, "--tissue", "layers")

    def draw(self, *arguments):
        return Picture(super().draw("forces", "forces.svg", *arguments))

    def test_every_method_is_drawn_on_the_knee(self):
        # between the cartilages of femur and tibia
        for method in METHODS:
            with self.subTest(method):
                picture = self.draw("knee-phantom:spacing=1", "--method", method, "--plane", "coronal", "--at", "20,0,0",
                                    "--size", "8")
                self.assertGreater(len(picture.arrows), 300)
                for part in (method, "F_full", "coronal section, centre 20.0, 0.0, 0.0 mm (LPS)", "Side: LEFT",
                             "femoral_cartilage", "not for clinical use"):
                    self.assertTrue(picture.says(part), part)
                # nothing is loaded from anywhere
                content = re.sub(r"base64,[^\"]+", "", (self.folder / "forces.svg").read_text())
                self.assertEqual(re.findall(r"(?:href|src|url)\W+(\w+)", content), ["forces", "data"])

    def test_letters_of_every_plane(self):
        for plane, letters in (("axial", "RLAP"), ("coronal", "RLSI"), ("sagittal", "APSI")):
            with self.subTest(plane):
                picture = self.draw(self.scene, "--plane", plane)
                shown = [e.text for e in picture.root.iter(f"{SVG}text") if e.get("class") == "letter"]
                self.assertEqual(sorted(shown), sorted(letters))

    def test_the_scenes_own_method_and_a_place_to_look_are_the_defaults(self):
        scene = self.scene.with_name("smooth.toml")
        scene.write_text(self.scene.read_text() + '\n[force]\nmethod = "smooth-sphere"\n')
        picture = self.draw(scene)
        self.assertTrue(picture.says("smooth-sphere"))
        self.assertTrue(picture.says("axial section"))
        self.assertGreater(len(picture.arrows), 30)
        self.assertTrue(self.draw(scene, "--method", "trilinear").says("trilinear"))

    def test_the_same_command_makes_the_same_picture(self):
        pictures = []
        for name in ("a.svg", "b.svg"):
            self.succeed("forces", self.scene, "--at=-20.5,0,1e0", "--arrows", "1", "-o", self.folder / name)
            pictures.append((self.folder / name).read_bytes())
        self.assertEqual(*pictures)
        self.assertIn(b"centre -20.5, 0.0, 1.0 mm", pictures[0])

    def test_neither_title_nor_path_is_in_it(self):
        scene = self.scene.with_name("CANARY.toml")
        scene.write_text(self.scene_without_title("CANARY"))
        self.succeed("scene", "check", scene)
        self.draw(scene)
        content = (self.folder / "forces.svg").read_text()
        self.assertNotIn("CANARY", content)
        self.assertNotIn(str(self.scene.parent), content)

    def test_what_cannot_be_drawn(self):
        self.check_what_cannot_be_drawn("forces", ".svg", [
            (cli.USAGE, ["--at", "1,2,nan"], "nan is not a number"),
            (cli.BAD_INPUT, ["--size", "100", "--arrows", "0.1"], "--arrows: 1000 x 1000 arrows"),
            (cli.USAGE, ["--method", "magic"], "trilinear"),
            (cli.USAGE, ["--plane", "oblique"], "axial")])

    def test_outputs_that_cannot_be_written(self):
        self.check_outputs_that_cannot_be_written("forces", ".svg", ".png")


if __name__ == "__main__":
    cli.share_prepared_models()
    cli.main()
