"""`palpate info` on every NRRD, NIfTI and MetaImage file of the shared data."""

import json

import cli

# dims, spacing, handedness, labels; as the data's own README gives them
KNOWN = {
    "knee_spl/seg.nrrd": ([512, 512, 119], [0.277, 0.277, 1.0], False, 49),
    "knee_dess/SAG_3D_DESS_RIGHT_bones_cart_men_fib-label.nrrd": ([384, 384, 160], [0.365, 0.365, 0.7], None, 10),
    "torso_ct/example_ct_sm.nii.gz": ([122, 101, 30], [3, 3, 3], None, None),
    "torso_ct/example_seg.nii.gz": ([122, 101, 30], [3, 3, 3], None, 41),
}
ENDINGS = (".nrrd", ".nhdr", ".nii", ".nii.gz", ".mha", ".mhd")


class Info(cli.PalpateTest):
    def info(self, path, *options):
        return json.loads(self.succeed("info", path, "--json", *options).stdout)

    def test_known_files(self):
        for name, (dims, spacing, right_handed, labels) in KNOWN.items():
            with self.subTest(name):
                info = self.info(cli.need(name))
                self.assertEqual(info["dims"], dims)
                for got, expected in zip(info["spacing_mm"], spacing):
                    self.assertAlmostEqual(got, expected, delta=0.0006)
                if right_handed is not None:
                    self.assertEqual(info["right_handed"], right_handed)
                if labels is None:
                    self.assertEqual(info["kind"], "scan")
                else:
                    self.assertEqual(len(info["labels"]), labels)

    def test_what_is_odd_about_the_atlas_is_said(self):
        text = self.succeed("info", cli.need("knee_spl/seg.nrrd")).stdout
        self.assertIn("tibia", text)
        self.assertRegex(text, r"without a name.*: 3 \(1531\)")
        self.assertRegex(text, r"slices hold no label: 0, 118")
        tibia = next(row for row in text.splitlines() if " tibia " in row)
        self.assertIn("22", tibia.split())

    def test_every_file_is_right_or_one_clear_error(self):
        root = cli.need("edge").parent
        files = sorted(p for p in root.rglob("*") if p.is_file() and p.name.endswith(ENDINGS))
        self.assertGreater(len(files), 30)
        refused = []
        for path in files:
            with self.subTest(path.relative_to(root)):
                done = cli.run("info", path)
                if done.returncode != cli.OK:
                    self.fail_clearly(cli.BAD_INPUT, "info", path)
                    refused.append(path.name)
        # what cannot be a volume, or is cut short, is refused; the rest is not
        self.assertIn("not-nifti.nii", refused)
        self.assertIn("abdomen_ct_TRUNCATED_gzip.nrrd", refused)
        self.assertLessEqual(len(refused), 8, refused)

    def test_a_cut_short_file_says_how_far_it_goes(self):
        path = cli.need("edge/nrrd_truncated/abdomen_ct_TRUNCATED_gzip.nrrd")
        self.fail_clearly(cli.BAD_INPUT, "info", path, says="52 of 113")


if __name__ == "__main__":
    cli.main()
