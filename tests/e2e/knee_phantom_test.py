"""The demo's steps on the generated knee: load by name, simulate, record, replay, report."""

import re

import cli

STRUCTURES = ["femur", "tibia", "fibula", "patella", "femoral_cartilage", "lateral_tibial_cartilage",
              "medial_tibial_cartilage", "patellar_cartilage"]


class KneePhantom(cli.PalpateTest):
    def coarse_scene(self):
        knee, scene = self.folder / "knee", self.folder / "scene.toml"
        self.succeed("data", "fetch", "knee-phantom", "-o", knee, "--voxel", cli.KNEE_MM)
        files = sorted(knee.glob("*.seg.nrrd"))
        self.assertEqual(len(files), 1)
        self.succeed("scene", "new", files[0], "-o", scene)
        return scene

    def test_a_phantom_with_parameters_is_a_data_set(self):
        recording, picture = self.folder / "odd.h5", self.folder / "odd.png"
        name = f"knee-phantom:spacing={cli.KNEE_MM},side=right,lesion=6,missing=patellar_cartilage"
        done = self.succeed("simulate", name, "-o", recording)
        self.assertNotIn("patellar_cartilage", cli.contact_figures(done.stdout))
        self.assertIn("femur", cli.contact_figures(done.stdout))
        # the recording tells which it was, parameters included
        again = self.succeed("replay", recording)
        self.assertEqual(cli.run_hash(again.stdout), cli.run_hash(done.stdout))
        self.succeed("replay", recording, f"knee-phantom:missing=patellar_cartilage,lesion=6,side=right,spacing={cli.KNEE_MM}0")
        # the same run a second time is the same run
        second = self.succeed("simulate", name)
        self.assertEqual(cli.run_hash(second.stdout), cli.run_hash(done.stdout))
        self.succeed("section", name, "--pixels", "320", "-o", picture)
        self.assertTrue(picture.exists())

        wrong = cli.run("simulate", "knee-phantom:sde=right")
        self.assertEqual(wrong.returncode, 1)
        self.assertIn("no key `sde`", wrong.stderr)
        self.assertIn("side: left or right", wrong.stderr)
        for key in ["lesion-in", "temporal", "thickness", "gland"]:
            self.assertIn(f"| `{key}` |", self.succeed("data", "keys").stdout)

    @cli.long
    def test_a_burr_takes_bone_away_and_what_is_left_is_written(self):
        scene, script, recording, left = (self.folder / name for name in ("scene.toml", "mill.toml", "run.h5", "left.seg.nrrd"))
        self.coarse_scene()
        with open(scene, "a") as file:
            file.write('\n[tool]\nkind = "burr"\ndiameter = 4\nspindle = [1, 0, 0]\n')
        script.write_text("[[step]]\napproach = 'femur'\n[[step]]\nmotor = true\n[[step]]\npress = 1.0\n[[step]]\nhold = 1.5\n"
                          "[[step]]\nmotor = false\n[[step]]\nleave = true\n")
        done = self.succeed("simulate", scene, "--script", script, "-o", recording)
        removed = float(re.search(r"removed ([\d.]+) mm3 of femur", done.stdout).group(1))
        # as much as the motor's power takes in that time, whatever the voxels: 200 mm3 and more
        self.assertGreater(removed, 50)
        self.assertEqual(cli.run_hash(self.succeed("replay", recording, scene).stdout), cli.run_hash(done.stdout))
        self.assertEqual(self.succeed("export", recording, scene, "-o", left).stdout, f"removed {removed:.1f} mm3 of femur\n")
        # and the report tells the same, with how deep: below the femur's surface, which it has to prepare
        page = self.folder / "run.html"
        self.succeed("report", recording, scene, "-o", page)
        row = re.search(r'What was removed.*?</svg>femur</th><td>([\d.]+)</td><td>[\d.]+</td><td>[\d.]+</td><td>[\d.]+</td><td>([\d.]+)</td>',
                        page.read_text(), re.DOTALL)
        self.assertAlmostEqual(float(row.group(1)), removed, delta=max(0.06, 0.006 * removed))
        self.assertGreater(float(row.group(2)), 0.1)
        # whole voxels, which are coarse: the femur has less of them, and nothing else
        before, after = (dict(re.findall(r"^ *\d+ +(\w+) +(\d+) ", self.succeed("info", file).stdout, re.MULTILINE))
                         for file in (next((self.folder / "knee").glob("*.seg.nrrd")), left))
        self.assertEqual({name for name in before if before[name] != after[name]}, {"femur"})
        self.assertLess(int(after["femur"]), int(before["femur"]))

        # what is protected is cut and that is said, or kept
        for protection, said in [("alarm", r"ALARM: [\d.]+ mm3 removed from femur, which is protected"),
                                 ("keep", r"nearest distance to femur: 0\.\d\d mm; nothing was removed from it")]:
            spared = self.folder / f"{protection}.toml"
            spared.write_text(scene.read_text().replace('preset = "bone"', f'preset = "bone"\nprotection = "{protection}"', 1))
            done = self.succeed("simulate", spared, "--script", script)
            self.assertRegex(done.stdout, said)
            self.assertEqual(bool(re.search(r"removed [\d.]+ mm3|mm3 removed", done.stdout)), protection == "alarm")
            self.assertIn("the burr was never near tibia", done.stdout)

    @cli.long
    def test_each_phantom_is_felt_by_its_own_scene(self):
        for name, structures in [("shell-phantom:spacing=1.2", ["shell"]),
                                 ("skull-phantom:spacing=2.2,temporal=4", ["skull", "brain"]),
                                 ("gland-phantom:spacing=1.2", ["gland", "mandible"])]:
            held = cli.contact_figures(self.succeed("simulate", name).stdout)
            for structure in structures:
                self.assertGreaterEqual(held[structure][0], 0.5, structure)

    @cli.long
    def test_every_bone_and_cartilage_is_held_recorded_replayed_and_reported(self):
        recording, report = self.folder / "run.h5", self.folder / "run.html"
        # by its name it is finer: for the sanitizers tests/builds/sanitized_equals_release runs and replays that
        source = [self.coarse_scene()] if cli.SANITIZED else []
        done = self.succeed("simulate", *(source or ["knee-phantom"]), "-o", recording, "--report", report)
        held = cli.contact_figures(done.stdout)
        for structure in STRUCTURES:
            self.assertIn(structure, held)
            self.assertGreaterEqual(held[structure][0], 0.5, structure)
        largest, limit = map(float, re.search(r"largest force ([\d.]+) N of ([\d.]+) N", done.stdout).groups())
        self.assertLessEqual(largest, limit)
        self.assertEqual(limit, 1.4, "the simulated device's continuous rating")
        self.assertIn("0 not finite", done.stdout)

        again = self.succeed("replay", recording, *source)
        self.assertIn("identical", again.stdout)
        self.assertEqual(cli.run_hash(again.stdout), cli.run_hash(done.stdout))
        page = report.read_text()
        for text in ["not for clinical use", "imulated hand", "LEFT", cli.run_hash(done.stdout), *STRUCTURES]:
            self.assertIn(text, page)
        self.assertIsNone(re.search(r"""(?:src|href)\s*=\s*["']?https?:""", page), "no network")

    def test_a_changed_scene_is_another_model(self):
        recording, scene = self.folder / "run.h5", self.coarse_scene()
        script = self.folder / "press.toml"
        script.write_text('[[step]]\napproach = "femur"\n[[step]]\npress = 0.8\n[[step]]\nleave = true\n')
        self.succeed("simulate", scene, "--script", script, "-o", recording)
        self.assertIn("identical", self.succeed("replay", recording, scene).stdout)
        self.expect_error(cli.USAGE, "replay", recording, message="SCENE")
        text = scene.read_text()
        scene.write_text(re.sub(r"(?m)^sigma = .*$", "sigma = 1.25", text) if re.search(r"(?m)^sigma", text)
                         else text + "\n[preparation]\nsigma = 1.25\n")
        self.expect_error(cli.BAD_INPUT, "replay", recording, scene, message="a different scene")


if __name__ == "__main__":
    cli.share_prepared_models()
    cli.main()
