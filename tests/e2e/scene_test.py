"""Scenes written from files, and what is said about them."""

import re

import cli
from volume_files import grid, write_nrrd

SIZES = (12, 12, 12)


def block(i, j, k):
    return int(3 <= i < 9 and 3 <= j < 9 and 3 <= k < 9)


class SceneTest(cli.PalpateTest):
    def labels(self, name="labels.nrrd", spacing=(1, 1, 1), x=0, geometry=None):
        return write_nrrd(self.folder / name, SIZES, block, geometry=geometry or grid(spacing, (x, 0, 0)))

    def scan(self, name="scan.nrrd", x=0):
        return write_nrrd(self.folder / name, SIZES, lambda i, j, k: (i * 37 + j * 101 + k * 53) % 251,
                          geometry=grid(origin=(x, 0, 0)))

    def felt_scene(self, **data):
        scene = self.folder / "felt.toml"
        lines = "".join(f'{key} = "{file.name}"\n' for key, file in data.items())
        scene.write_text(f'[data]\n{lines}[[tissue]]\nname = "block"\nlabels = [1]\n')
        return scene

    def test_a_study_and_its_segmentation(self):
        study, other = cli.need("dicom_seg/ct-3slice"), cli.need("dicom_seg/24x38x3/image")
        segmentation, scene = cli.need("dicom_seg/liver.dcm"), self.folder / "scene.toml"
        said = self.succeed("scene", "new", study, segmentation, "-o", scene).stderr
        self.assertIn("liver.dcm was made on volume 1 (series 1: CT, axial, 512 x 512 x 3", said)
        self.assertIn("scan_volume = 1", scene.read_text())
        self.succeed("scene", "check", scene)
        self.expect_error(cli.BAD_INPUT, "scene", "new", other, segmentation, message="a different frame of reference")
        # one folder with both
        whole = self.folder / "whole"
        whole.mkdir()
        for file in [*study.iterdir(), segmentation]:
            (whole / file.name).symlink_to(file)
        said = self.succeed("scene", "new", whole, "--force", "-o", scene, "--follow-links").stderr
        self.assertIn("was made on volume 1", said)
        self.assertIn('labels = "whole/liver.dcm"', scene.read_text())
        self.succeed("scene", "new", "--scan", whole, "--force", "-o", scene, "--follow-links")
        self.assertNotIn("labels =", scene.read_text())
        # to a first touch
        script = self.folder / "touch.toml"
        script.write_text('[[step]]\napproach = "Liver"\n')
        said = self.succeed("simulate", study, segmentation, "-s", script)
        self.assertRegex(said.stdout, "line 1 touched Liver")

    def test_new_replaces_no_data(self):
        labels = self.labels()
        table = self.folder / "names.ctbl"
        table.write_text("1 femur 200 200 200 255\n")
        link = self.folder / "link.toml"
        link.symlink_to(labels.name)
        before = labels.read_bytes(), table.read_bytes()
        for output in (labels, link, table, f"{self.folder}/./labels.nrrd"):
            for force in ([], ["--force"]):
                with self.subTest(output=output, force=force):
                    self.expect_error(cli.USAGE, "scene", "new", labels, "--names", table, "-o", output, *force,
                                      message="would replace an input")
                    self.assertEqual((labels.read_bytes(), table.read_bytes()), before)

    def test_new_replaces_a_scene_only_when_told_to(self):
        labels, scene = self.labels(), self.folder / "scene.toml"
        scene.write_text("# a day's work\n")
        self.expect_error(cli.USAGE, "scene", "new", labels, "-o", scene, message="--force")
        self.assertEqual(scene.read_text(), "# a day's work\n")
        self.succeed("scene", "new", labels, "-o", scene, "--force")
        self.assertIn("[[tissue]]", scene.read_text())

    def test_volumes_that_do_not_overlap(self):
        labels, scan, scene = self.labels(), self.scan(x=500), self.folder / "scene.toml"
        self.expect_error(cli.BAD_INPUT, "scene", "new", scan, labels, "-o", scene, message="only 0.0 % of the labelled")
        self.assertFalse(scene.exists())
        self.expect_error(cli.BAD_INPUT, "scene", "check", self.felt_scene(scan=scan, labels=labels),
                          message="felt.toml:3: the labels do not seem to belong to the scan")
        self.succeed("scene", "check", self.felt_scene(scan=self.scan(x=5), labels=labels))

    def test_organs_are_embedded(self):
        scan, labels = self.scan(), self.labels()
        scene = self.folder / "embedded.toml"
        self.succeed("scene", "new", scan, labels, "--embed", "-o", scene)
        text = scene.read_text()
        self.assertIn("# unlabelled tissue between the structures", text)
        self.assertRegex(text, r"embedding = true\n(.*\n)*air_below = ")
        self.assertRegex(self.succeed("scene", "check", scene).stdout, r"embedding +yes .* embedding")
        self.assertNotIn("air_below", self.succeed("scene", "new", labels, "--embed").stdout)
        self.expect_error(cli.USAGE, "scene", "new", "--scan", scan, "--embed", message="no structures to embed")

    def test_one_file_twice_and_labels_for_a_scan(self):
        labels = self.labels()
        self.expect_error(cli.USAGE, "scene", "new", labels, labels, message="and as the label map")
        more = self.labels("more.nrrd")
        self.expect_error(cli.BAD_INPUT, "scene", "new", labels, more, message="two label maps")
        for arguments in (["--scan", labels], ["--scan", labels, "--labels", more]):
            self.assertIn("looks like a label map", self.succeed("scene", "new", *arguments).stderr)
        self.assertNotIn("looks like", self.succeed("scene", "new", self.scan(), labels).stderr)

    def test_a_data_file_that_is_missing(self):
        labels = self.labels()
        scene = self.felt_scene(labels=labels)
        labels.unlink()
        for verb in (["scene", "check"], ["simulate"]):
            self.expect_error(cli.BAD_INPUT, *verb, scene, message="felt.toml:2: no such file")

    def test_sigma_follows_the_voxels(self):
        labels, scene = self.labels(spacing=(0.5, 0.5, 2.51)), self.folder / "scene.toml"
        self.succeed("scene", "new", labels, "-o", scene)
        self.assertRegex(scene.read_text(), r"(?m)^sigma = 2\.6 ")
        self.assertNotIn("sigma", self.succeed("scene", "check", scene).stderr)
        for sigma, warned in (("0", True), ("2.4", True), ("2.51", False)):
            felt = re.sub(r"(?m)^sigma = \S+", f"sigma = {sigma}", scene.read_text())
            felt = felt.replace("[preparation]\nmethod = \"union-gaussian\"", "[preparation]")
            felt = felt.replace("[preparation]", "[preparation]\nmethod = \"union-gaussian\"")
            scene.write_text(felt.replace("touchable = false", "touchable = true"))
            self.assertEqual("less than the voxel size" in self.succeed("scene", "check", scene).stderr, warned, sigma)

    def test_check_prints_the_most_force(self):
        scene = self.felt_scene(labels=self.labels())
        scene.write_text(scene.read_text() + "stiffness = 0.8\n[preparation]\n")
        for settings, max_N in (("ramp_width = 6\n", 0.8 * 6), ("method = \"union-gaussian\"\nsigma = 2\n", 0.8 * 2 * 2.5066)):
            scene.write_text(scene.read_text().split("[preparation]\n")[0] + "[preparation]\n" + settings)
            row = re.search(r"(?m)^block +yes +0\.8 +(\S+)", self.succeed("scene", "check", scene).stdout)
            self.assertAlmostEqual(float(row.group(1)), max_N, delta=0.01)

    def test_check_looks_for_no_go_regions_as_a_session_does(self):
        scene = self.felt_scene(labels=self.labels())
        felt = scene.read_text()
        scene.write_text(felt + '\n[[no_go]]\nname = "nerve"\nstructures = ["blok"]\n')
        for verb in (("scene", "check"), ("simulate",)):
            self.expect_error(cli.BAD_INPUT, *verb, scene, message='no-go region "nerve" has the label "blok"')
        scene.write_text(felt + '\n[[no_go]]\nname = "nerve"\nstructures = [1]\nkeep_away = 3\n')
        self.assertRegex(self.succeed("scene", "check", scene).stdout, r"(?m)^no-go +nerve, keep away 3 mm, 2 N/mm$")

    def test_sides(self):
        def said(scene):
            return re.search(r"(?m)^side +(.*)$", self.succeed("scene", "check", scene).stdout).group(1)

        silent = self.labels("silent.nrrd", geometry="spacings: 1 1 1\n")
        self.assertIn("sides are unknown", self.succeed("scene", "new", silent).stderr)
        scene = self.felt_scene(labels=silent)
        self.assertIn("sides are unknown", self.succeed("scene", "check", scene).stderr)
        self.assertEqual(said(scene), "unknown")

        labels, scene = self.labels(), self.folder / "scene.toml"
        self.assertNotIn("sides", self.succeed("scene", "new", labels).stderr)
        for side in ("left", "right", "both"):
            self.succeed("scene", "new", labels, "--side", side, "-o", scene, "--force")
            self.assertEqual(said(scene), side)
        self.succeed("scene", "new", labels, "-o", scene, "--force")
        self.assertRegex(said(scene), "^unknown; set side")
        write_nrrd(labels, SIZES, lambda i, j, k: block(i, j, k) * (1 + (i > 6)))
        labels.with_suffix(".ctbl").write_text("1 tibia 1 1 1 255\n2 fibula 1 1 1 255\n")
        self.succeed("scene", "new", labels, "-o", scene, "--force")
        self.assertIn("from the fibula", said(scene))

    def test_modalities(self):
        labels = self.labels()
        self.assertIn('modality = "mr"\n', self.succeed("scene", "new", labels, "--modality", "mr").stdout)
        self.assertNotIn("modality", self.succeed("scene", "new", labels).stdout)
        self.expect_error(cli.USAGE, "scene", "new", labels, "--modality", "photo", message="{ct,mr}")

    def test_tissue_that_yields(self):
        labels, scene = self.labels(), self.folder / "scene.toml"
        (self.folder / "names.ctbl").write_text("1 thigh_muscle 1 1 1 255\n")
        self.assertNotIn("yielding", self.succeed("scene", "new", labels, "--tissue", "layers").stdout)
        self.assertIn('law = "elastic"', self.succeed("scene", "new", labels).stdout)
        self.expect_error(cli.USAGE, "scene", "new", labels, "--tissue", "jelly", message="{layers,elastic,neo-hookean,exponential,chainmail}")
        self.assertNotIn("yields", self.succeed("scene", "new", labels, "--tissue", "elastic", "-o", scene).stderr)
        said = self.succeed("scene", "check", scene)
        self.assertRegex(said.stdout, r"(?m)^tissue +elastic$")
        self.assertRegex(said.stdout, r"(?m)^muscle +yes +0\.052 +14 +0\.45 ")
        self.assertNotRegex(said.stderr, "nothing|yields")
        written = scene.read_text()

        def warned(lines, law="elastic"):
            text = re.sub(r'(?m)^preset = "muscle".*$', 'preset = "muscle"\n' + lines, written)
            scene.write_text(text.replace('"elastic"', f'"{law}"'))
            return "the stiffness of muscle has no effect" in self.succeed("scene", "check", scene).stderr

        self.assertTrue(warned("stiffness = 0.04"))
        self.assertTrue(warned("stiffness = 0.04", "neo-hookean"))
        self.assertFalse(warned("stiffness = 0.04", "layers"))
        self.assertFalse(warned("stiffness = 0.04\nyoungs_modulus = 9"))
        self.assertFalse(warned("youngs_modulus = 9"))
        scene.write_text(written.replace('preset = "muscle"', "") + '[limits]\n')
        said = self.succeed("scene", "check", scene)
        self.assertIn("no tissue in this scene yields", said.stderr)
        self.assertRegex(said.stdout, r"(?m)^muscle +yes +1 +rigid ")

    def test_usage_line(self):
        self.assertIn("scene new [OPTIONS] [SCAN] LABELS\n", self.succeed("scene", "new", "--help").stdout)


if __name__ == "__main__":
    cli.share_prepared_models()
    cli.main()
