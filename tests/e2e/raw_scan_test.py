"""A CT without segmentation, touched directly by threshold."""

import cli


class RawScan(cli.PalpateTest):
    def test_bone_of_a_raw_ct_is_felt_by_threshold(self):
        scan = cli.need("torso_ct/example_ct_sm.nii.gz")
        scene = self.folder / "scene.toml"
        scene.write_text(f'title = "raw CT"\n[data]\nscan = "{scan}"\n'
                         '[[tissue]]\nname = "bone"\nthreshold = [150.0, 300.0]\nstiffness = 1.2\n'
                         '[preparation]\nsigma = 2.0\n')
        script = self.folder / "press.toml"
        script.write_text('[[step]]\napproach = "bone"\n[[step]]\npress = 0.8\n[[step]]\nhold = 0.6\n'
                          '[[step]]\nleave = true\n')
        recording = self.folder / "run.h5"
        done = self.succeed("simulate", scene, "--script", script, "-o", recording)
        self.assertGreaterEqual(cli.contact_figures(done.stdout)["bone"][0], 0.5, done.stdout)
        self.assertIn("identical", self.succeed("replay", recording, scene).stdout)
        self.succeed("report", recording, scene, "-o", self.folder / "run.html")

    def test_scene_new_suggests_a_threshold(self):
        scan = cli.need("torso_ct/example_ct_sm.nii.gz")
        scene = self.folder / "scene.toml"
        self.succeed("scene", "new", "--scan", scan, "-o", scene)
        self.assertIn("threshold", scene.read_text())
        self.succeed("scene", "check", scene)


if __name__ == "__main__":
    cli.share_prepared_models()
    cli.main()
