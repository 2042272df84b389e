"""Pictures as slices, and whether scan and labels belong together: from the files to the first touch."""

import cli
from volume_files import ball, grid, nifti1, png, write_nrrd

SIZES = (40, 36, 30)  # columns, rows, slices
RADIUS = 12


class ScanAndLabelAlignment(cli.PalpateTest):
    def setUp(self):
        super().setUp()
        self.ball = ball(SIZES, RADIUS)
        self.noise = bytes((200 if inside else 20) + (n * 7919 >> 3) % 31 for n, inside in enumerate(self.ball))

    def write_stacks(self):
        """A folder of grey slices and one of colours, whose names sort otherwise as texts than as numbers."""
        scan, labels = self.folder / "grey", self.folder / "colours"
        width, area = SIZES[0], SIZES[0] * SIZES[1]
        for folder, values, colour in ((scan, self.noise, False), (labels, self.ball, True)):
            folder.mkdir()
            for k in range(SIZES[2]):
                slice_ = values[k * area:(k + 1) * area]
                rows = [slice_[j * width:(j + 1) * width] for j in range(SIZES[1])]
                if colour:
                    rows = [b"".join(b"\xfa\x0a\x00" if value else b"\0\0\0" for value in row) for row in rows]
                (folder / f"s{k + 1}.png").write_bytes(png(width, SIZES[1], rows, colour))
        (self.folder / "names.ctbl").write_text("5 femur 250 10 0 255\n")
        return scan, labels

    def test_stacks_of_pictures_are_felt(self):
        scan, labels = self.write_stacks()
        self.expect_error(cli.BAD_INPUT, "info", scan, message="--spacing X,Y,Z")
        said = self.succeed("info", scan, "--spacing", "1,1,1.5")
        self.assertIn("40 x 36 x 30", said.stdout)
        self.assertIn("1 x 1 x 1.5 mm", said.stdout)
        scene = self.folder / "scene.toml"
        done = self.succeed("scene", "new", scan, labels, "--names", self.folder / "names.ctbl", "--spacing", "1,1,1.5",
                            "-o", scene)
        self.assertIn("100.0 % of the labelled voxels lie inside the scan", done.stdout + done.stderr)
        self.assertIn("image_spacing = [1, 1, 1.5]", scene.read_text())
        self.assertIn('"femur"', scene.read_text())
        # the scene says the spacing from here on
        self.assertIn("a valid scene", self.succeed("scene", "check", scene).stdout)
        self.succeed("section", scene, "-o", self.folder / "section.png")
        script = self.folder / "touch.toml"
        script.write_text(cli.TOUCH)
        self.succeed("simulate", scene, "--script", script, "-o", self.folder / "run.h5")

    def test_labels_elsewhere_are_refused_unless_the_scan_is_cropped(self):
        scan = write_nrrd(self.folder / "scan.nrrd", SIZES, self.noise)
        labels = write_nrrd(self.folder / "femur.nrrd", SIZES, self.ball, geometry=grid(origin=(20, 0, 0)))
        self.expect_error(cli.BAD_INPUT, "scene", "new", scan, labels, message="--cropped-scan")
        scene = self.folder / "scene.toml"
        done = self.succeed("scene", "new", scan, labels, "--cropped-scan", "-o", scene)
        self.assertIn("% of the labelled voxels lie inside the scan", done.stdout + done.stderr)
        self.assertIn("cropped_scan = true", scene.read_text())
        self.assertIn("only", self.succeed("scene", "check", scene).stderr)
        # and refused again where the scene does not say it
        scene.write_text(scene.read_text().replace("cropped_scan = true\n", ""))
        self.expect_error(cli.BAD_INPUT, "scene", "check", scene, message="cropped_scan = true")
        self.expect_error(cli.BAD_INPUT, "simulate", scene, "-o", self.folder / "run.h5", message="--cropped-scan")

    def test_a_mirror_between_two_forms_is_said_also_in_the_report(self):
        labels = self.folder / "femur.nii"
        labels.write_bytes(nifti1(SIZES, self.ball, q_handedness=-1))
        self.assertIn("differ by a mirror", self.succeed("info", labels).stderr)
        self.assertNotIn("mirror", self.succeed("info", labels, "--form", "q").stderr)
        scene, recording, report = (self.folder / name for name in ("scene.toml", "run.h5", "run.html"))
        self.succeed("scene", "new", labels, "-o", scene)
        script = self.folder / "touch.toml"
        script.write_text(cli.TOUCH)
        self.succeed("simulate", scene, "--script", script, "-o", recording)
        self.succeed("report", recording, scene, "-o", report)
        self.assertIn("a qform and an sform that differ by a mirror", report.read_text())
        self.succeed("scene", "new", labels, "--form", "s", "-o", scene, "--force")
        self.assertIn('nifti_form = "s"', scene.read_text())
        self.assertNotIn("mirror", self.succeed("scene", "check", scene).stderr)


if __name__ == "__main__":
    cli.share_prepared_models()
    cli.main()
