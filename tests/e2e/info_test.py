"""`palpate info` on every NRRD, NIfTI and MetaImage file of the shared data."""

import json

import cli

# dims, spacing, labels as the data's own README gives them; handedness from the headers' directions, and the
# voxels of some labels counted with numpy (NRRD) and nibabel (NIfTI)
KNOWN = {
    "knee_spl/seg.nrrd": ([512, 512, 119], [0.277, 0.277, 1.0], False, 49,
                          {3: 1531, 75: 1154, 95: 1838595, 96: 1190900, 97: 137996, 98: 205343}),
    "knee_dess/SAG_3D_DESS_RIGHT_bones_cart_men_fib-label.nrrd":
        ([384, 384, 160], [0.365, 0.365, 0.7], True, 10, {1: 127311, 3: 19862, 5: 1532154, 10: 25228}),
    "torso_ct/example_ct_sm.nii.gz": ([122, 101, 30], [3, 3, 3], True, None, {}),
    "torso_ct/example_seg.nii.gz": ([122, 101, 30], [3, 3, 3], True, 41,
                                    {1: 9452, 5: 38634, 7: 644, 110: 64, 117: 2100}),
}
ENDINGS = (".nrrd", ".nhdr", ".nii", ".nii.gz", ".mha", ".mhd")


class Info(cli.PalpateTest):
    def info(self, path, *options):
        return json.loads(self.succeed("info", path, "--json", *options).stdout)

    def test_known_files(self):
        for name, (dims, spacing, right_handed, labels, voxels) in KNOWN.items():
            with self.subTest(name):
                info = self.info(cli.need(name))
                self.assertEqual(info["dims"], dims)
                for got, expected in zip(info["spacing_mm"], spacing):
                    self.assertAlmostEqual(got, expected, delta=0.0006)
                self.assertEqual(info["right_handed"], right_handed)
                if labels is None:
                    self.assertEqual(info["kind"], "scan")
                else:
                    self.assertEqual(len(info["labels"]), labels)
                    counted = {label["id"]: label["voxels"] for label in info["labels"]}
                    self.assertEqual({label: counted[label] for label in voxels}, voxels)

    def test_peculiarities_of_the_atlas_are_reported(self):
        text = self.succeed("info", cli.need("knee_spl/seg.nrrd")).stdout
        self.assertIn("tibia", text)
        self.assertRegex(text, r"without a name.*: 3 \(1531\)")
        self.assertRegex(text, r"slices hold no label: 0, 118")
        tibia = next(row for row in text.splitlines() if " tibia " in row)
        self.assertIn("22", tibia.split())

    def test_edge_connected_sheets_are_reported(self):
        # a wall one voxel thick across the volume, that goes on beside itself half way
        edge = 12
        voxels = bytes(i == (5 if j < 6 else 6) for _ in range(edge) for j in range(edge) for i in range(edge))
        head = f"NRRD0004\ntype: uint8\ndimension: 3\nsizes: {edge} {edge} {edge}\nencoding: raw\n\n"
        path = self.folder / "wall.nrrd"
        path.write_bytes(head.encode() + voxels)
        leaky = self.info(path, "--labels")["leaky"]
        self.assertEqual([(leak["id"], leak["places"]) for leak in leaky], [(1, edge - 5)])
        self.assertIn("leaky: ", self.succeed("info", "--labels", path).stdout)
        prepared = self.succeed("prepare", path, "-o", self.folder / "field.nrrd")
        self.assertIn("leaky: ", prepared.stderr)
        self.assertEqual(self.info(cli.need("knee_dess/SAG_3D_DESS_RIGHT_bones_cart_men_fib-label.nrrd"))["leaky"], [])

    @cli.long
    def test_every_file_is_right_or_one_clear_error(self):
        root = cli.need("edge").parent
        files = sorted(p for p in root.rglob("*") if p.is_file() and p.name.endswith(ENDINGS))
        self.assertGreater(len(files), 30)
        refused = []
        for path in files:
            with self.subTest(path.relative_to(root)):
                done = cli.run("info", path, "--json")
                if done.returncode != cli.OK:
                    self.expect_error(cli.BAD_INPUT, "info", path)
                    refused.append(path.name)
                    continue
                self.assert_sane(json.loads(done.stdout))
        # what cannot be a volume, or is cut short, is refused; the rest is not
        self.assertIn("not-nifti.nii", refused)
        self.assertIn("abdomen_ct_TRUNCATED_gzip.nrrd", refused)
        self.assertLessEqual(len(refused), 8, refused)

    def assert_sane(self, info):
        """Of any readable volume: it has an extent, and not the same value everywhere, as unread voxels have."""
        self.assertEqual(len(info["dims"]), 3)
        for count, spacing in zip(info["dims"], info["spacing_mm"]):
            self.assertGreater(count, 0)
            self.assertGreater(spacing, 0.01)
            self.assertLess(spacing, 100)
        low, high = info["range"]
        self.assertGreater(high, low)
        if info["kind"] == "labels":
            self.assertGreater(sum(label["voxels"] for label in info["labels"]), 0)

    def test_one_volume_in_many_encodings_is_one_volume(self):
        folder = cli.need("edge/nrrd_pynrrd/BallBinary30x30x30.nrrd").parent
        read = {}
        for path in sorted(p for p in folder.glob("BallBinary30x30x30*") if p.name.endswith(ENDINGS)):
            done = cli.run("info", path, "--json")
            if done.returncode == cli.OK:
                info = json.loads(done.stdout)
                read[path.name] = (info["range"], [(label["id"], label["voxels"]) for label in info["labels"]])
        self.assertGreaterEqual(len(read), 8)
        self.assertEqual(len({str(content) for content in read.values()}), 1, read)
        big, little = (self.info(cli.need(f"edge/nifti/{order}.nii.gz"))["range"] for order in ("big", "little"))
        self.assertEqual(big, little)

    def test_names_of_any_script_fit_the_table(self):
        # forty columns, and up to four bytes a column
        names = ["腓骨" * 20, "𝒻ibula" * 8, "os"]
        voxels = bytes(range(4)) * 2
        path = self.folder / "named.seg.nrrd"
        fields = "".join(f"Segment{n}_Name:={name}\nSegment{n}_LabelValue:={n + 1}\nSegment{n}_ID:=s{n}\n"
                         f"Segment{n}_Layer:=0\n" for n, name in enumerate(names))
        path.write_bytes(("NRRD0005\ntype: uchar\ndimension: 3\nspace: left-posterior-superior\nsizes: 2 2 2\n"
                          "space directions: (1,0,0) (0,1,0) (0,0,1)\nencoding: raw\nspace origin: (0,0,0)\n"
                          f"{fields}\n").encode() + voxels)
        table = self.succeed("info", path).stdout.partition("3 labels\n")[2]
        head, *rows = table.splitlines()[:4]
        self.assertEqual(len(rows), 3)
        for row in rows:
            self.assertEqual(len(row), len(head), row)
            self.assertRegex(row, r" 2 +2\.0  [-0-9 ]+ [0-9]$")

    def test_a_cut_short_file_says_how_far_it_goes(self):
        path = cli.need("edge/nrrd_truncated/abdomen_ct_TRUNCATED_gzip.nrrd")
        self.expect_error(cli.BAD_INPUT, "info", path, message="52 of 113")


if __name__ == "__main__":
    cli.share_prepared_models()
    cli.main()
