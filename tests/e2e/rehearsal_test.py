"""palpate plan: a hole is planned by Slicer's markups, milled by the simulated hand, and held against the plan."""

import html
import json
import math
import re

import cli

MILL = ("[[step]]\napproach = 'femur'\nspeed = 200.0\n[[step]]\nmotor = true\n[[step]]\npress = 1.0\n[[step]]\nhold = 0.5\n"
        "[[step]]\nmotor = false\n[[step]]\nleave = true\n")
COLUMNS = ("flags", "near_label", "near_mm", "no_go", "no_go_depth_mm", "no_go_N", "proxy_patient_mm", "normal_patient", "label")
ROUGH = 'title = "Rough"\n[[trajectory]]\nname = "t"\nentry = [0, 0, 0]\ntarget = [0, 0, 5]\nenters = ["femur"]\n'


class Rehearsal(cli.PalpateTest):
    def write(self, name, text):
        file = self.folder / name
        file.write_text(text, encoding="utf-8")
        return file

    def markups(self, kind, points, axes="RAS"):
        flip = -1 if axes == "RAS" else 1
        return json.dumps({"markups": [{"type": kind, "coordinateSystem": axes, "coordinateUnits": "mm", "controlPoints": [
            {"label": name, "position": [flip * x, flip * y, z], "positionStatus": "defined"} for name, (x, y, z) in points]}]})

    def compare(self, run, plan, scene, status=cli.OK):
        out = self.folder / "done.json"
        done = cli.run("plan", "compare", run, "--plan", plan, "--scene", scene, "--json", out)
        self.assertEqual(done.returncode, status, done.stderr)
        return json.loads(out.read_text()), done.stdout

    def test_a_hole_is_planned_milled_compared_and_reported(self):
        scene = self.folder / "scene.toml"
        self.succeed("data", "fetch", "knee-phantom", "-o", self.folder / "knee", "--voxel", cli.KNEE_MM)
        self.succeed("scene", "new", next((self.folder / "knee").glob("*.seg.nrrd")), "-o", scene, "--tissue", "layers")
        with open(scene, "a", encoding="utf-8") as file:
            file.write('\n[tool]\nkind = "burr"\ndiameter = 4\nspindle = [1, 0, 0]\n')
        run = self.folder / "run.h5"
        done = self.succeed("simulate", scene, "--script", self.write("mill.toml", MILL), "-o", run)
        removed = float(re.search(r"removed ([\d.]+) mm3 of femur", done.stdout).group(1))

        # where the hand went in, by a plan that only names the bone
        rough, _ = self.compare(run, self.write("rough.toml", ROUGH), scene)
        made = rough["trajectories"][0]
        self.assertEqual(made["entry_made"], "passed")
        entry, deepest = made["entry"]["at_mm"], made["nearest"]["at_mm"]
        self.assertGreater(math.dist(entry, deepest), 1)

        # the same way as a line of Slicer's, 3 mm beside along x, and so is a pair of points
        aside = [[x + 3, y, z] for x, y, z in (entry, deepest)]
        plan = self.folder / "plan.toml"
        for text in (self.markups("Line", [("Hole-1", aside[0]), ("Hole-2", aside[1])]),
                     self.markups("Fiducial", [("Target", aside[1]), ("Entry", aside[0])], "LPS")):
            plan.unlink(missing_ok=True)
            self.succeed("plan", "from-markups", self.write("hole.mrk.json", text), "-o", plan, "--title", "Hole & more")
            figures, _ = self.compare(run, plan, scene)
            # without `enters` the nearest place: across the trajectory
            self.assertEqual(figures["trajectories"][0]["entry_made"], "nearest")
            self.assertLess(figures["trajectories"][0]["entry_error_mm"]["value"], 3.001)

        planned = plan.read_text(encoding="utf-8").replace("[[trajectory]]\n", '[[trajectory]]\nenters = ["femur"]\nentry_within = 2\ntarget_within = 5\n', 1)
        name = re.search(r'name = "(.*)"', planned).group(1)
        planned += (f'[[region]]\nname = "hole"\nshape = "cylinder"\ntrajectory = "{name}"\nradius = 3\nfrom = -3\n'
                    '[[keep_away]]\nstructures = ["tibia"]\ndistance = 1\n[[keep_away]]\nstructures = ["femur"]\ndistance = 0.5\n')
        plan.write_text(planned, encoding="utf-8")
        figures, text = self.compare(run, plan, scene, cli.LIMIT)
        trajectory = figures["trajectories"][0]
        self.assertAlmostEqual(trajectory["entry_error_mm"]["value"], 3, delta=1e-6)
        self.assertFalse(trajectory["entry_error_mm"]["kept"])
        self.assertLessEqual(trajectory["target_error_mm"]["value"], 3.001)
        self.assertTrue(trajectory["target_error_mm"]["kept"])
        self.assertIn("NOT KEPT", text)

        # in, outside and left add up, and are what the burr took
        femur = next(volume for volume in figures["volumes"] if volume["name"] == "femur")
        self.assertAlmostEqual(femur["removed_mm3"] + femur["outside_mm3"], removed, delta=0.051)
        self.assertGreater(femur["removed_mm3"], 0.1)
        self.assertGreater(femur["outside_mm3"], 0.1)
        self.assertAlmostEqual(femur["planned_mm3"] - femur["removed_mm3"], femur["left_mm3"], delta=1e-6)
        # it milled the femur, and came near nothing else that is to be spared
        nearest = {structure["name"]: structure for structure in figures["structures"]}
        self.assertLess(nearest["femur"]["nearest_mm"], 0)
        self.assertTrue(nearest["tibia"]["kept"])
        self.assertEqual({breach["name"] for breach in figures["breaches"]}, {"femur"})
        self.assertEqual(min(filter(lambda mm: mm is not None, nearest["femur"]["over_time_mm"])) < 0, True)

        # the page tells the same figures
        page = self.folder / "run.html"
        self.succeed("report", run, scene, "--plan", plan, "-o", page)
        part = re.search(r"<h2 id=\"plan-title\">.*?</section>", page.read_text(encoding="utf-8"), re.DOTALL).group(0)
        self.assertIn("Hole &amp; more", part)
        rows = {}
        for row in re.findall(r"<tr>(<th scope=\"row\">.*?)</tr>", part):
            cells = [html.unescape(re.sub("<[^>]*>", "", cell)) for cell in re.findall(r"<t[hd].*?>(.*?)</t[hd]>", row)]
            rows.setdefault(cells[0].strip(), []).append(cells[1:])
        for row, figure in (("Entry error mm", "entry_error_mm"), ("Target error mm", "target_error_mm"),
                            ("Angle degrees", "angle_deg"), ("Depth error mm", "depth_error_mm")):
            self.assertAlmostEqual(float(rows[row][0][0]), trajectory[figure]["value"], delta=0.0051)
        for value, key in zip(rows["femur"][0], ("planned_mm3", "removed_mm3", "left_mm3", "outside_mm3")):
            self.assertAlmostEqual(float(value), femur[key], delta=0.051)
        for structure, figure in nearest.items():
            values = [row for row in rows[structure] if len(row) == 5]
            self.assertAlmostEqual(float(values[0][0]), figure["nearest_mm"], delta=0.0051)
        self.assertIn('class="planned"', part)

        shown = self.succeed("plan", "show", plan, "--scene", scene).stdout
        self.assertRegex(shown, r"passes through +.*femur [\d.]+ mm")
        self.assertIn("keep away", shown)

        # nothing is written where something is wrong
        before = plan.read_bytes()
        self.expect_error(cli.BAD_INPUT, "plan", "from-markups", self.write("c.mrk.json", self.markups("Curve", [("C-1", entry)])),
                          "-o", self.folder / "none.toml", message="a Curve")
        self.expect_error(cli.BAD_INPUT, "plan", "from-markups", self.folder / "hole.mrk.json", "--title", "",
                          "-o", self.folder / "none.toml", message="title is empty")
        self.assertFalse((self.folder / "none.toml").exists())
        self.expect_error(cli.BAD_INPUT, "plan", "compare", run, "--scene", scene, "--json", self.folder / "none.json",
                          "--plan", self.write("w.toml", planned.replace('"tibia"', '"tibja"')), message='did you mean "tibia"?')
        self.assertFalse((self.folder / "none.json").exists())
        self.expect_error(cli.BAD_INPUT, "plan", "compare", run, "--scene", scene, "--plan", plan, "--device", 2, message="no device 2")
        self.expect_error(cli.USAGE, "plan", "compare", run, "--scene", scene, "--plan", plan, "--json", plan, message="plan.toml")
        self.expect_error(cli.USAGE, "report", run, scene, "--device", 1, message="--plan")
        self.assertEqual(plan.read_bytes(), before)


class PlanInThePage(cli.PalpateTest):
    """What `--plan` of explore and replay refuses, before anything is loaded or served for long."""

    def test_a_plan_that_cannot_be_shown_is_refused(self):
        plan = self.folder / "plan.toml"
        plan.write_text('title = "p"\n[[trajectory]]\nname = "t"\nentry = [0, 0, 0]\ntarget = [0, 0, 9]\nenters = ["femurr"]\n', encoding="utf-8")
        knee = f"knee-phantom:spacing={cli.KNEE_MM}"
        self.expect_error(cli.USAGE, "explore", knee, "--no-viewer", "--plan", plan, message="--no-viewer serves no page")
        self.expect_error(cli.BAD_INPUT, "explore", knee, "--plan", plan, "--port", 0, message='did you mean "femur"?')
        self.expect_error(cli.OUTPUT, "explore", knee, "--plan", self.folder / "nowhere" / "plan.toml", "--port", 0, message="nowhere")
        self.expect_error(cli.USAGE, "replay", "run.h5", "--plan", plan, message="--view")
        self.expect_error(cli.USAGE, "explore", knee, "--plan", plan, "-o", plan, "--port", 0, message="plan.toml")
        self.assertIn("femurr", plan.read_text(encoding="utf-8"))


class KeptAway(cli.PalpateTest):
    """[distances] and [[no_go]] in a session: told, pushed, recorded, and replayed to the hash."""

    @cli.long
    def test_a_region_where_a_structure_is_touched_pushes_as_well(self):
        scene, script, run = (self.folder / name for name in ("scene.toml", "touch.toml", "run.h5"))
        self.succeed("data", "fetch", "knee-phantom", "-o", self.folder / "knee", "--voxel", cli.KNEE_MM)
        self.succeed("scene", "new", next((self.folder / "knee").glob("*.seg.nrrd")), "-o", scene)
        script.write_text(cli.TOUCH, encoding="utf-8")
        self.succeed("simulate", scene, "--script", script, "-o", run)
        free = cli.device_columns(run, *COLUMNS)
        self.assertFalse(any(label for told in free["near_label"] for label in told))
        self.assertFalse(any(free["no_go"]))
        last = max(tick for tick, label in enumerate(free["label"]) if label != 0)
        place, normal, label = free["proxy_patient_mm"][last], free["normal_patient"][last], free["label"][last]

        # a plane where it was touched, which pushes from 2 mm before it on
        with open(scene, "a", encoding="utf-8") as file:
            file.write(f'\n[distances]\nstructures = "all"\nreach = 10\n\n[[no_go]]\nname = "here"\npoint = {place}\n'
                       f'outward = {normal}\nkeep_away = 2\nstiffness = 0.1\n')
        self.succeed("simulate", scene, "--script", script, "-o", run)
        kept = cli.device_columns(run, *COLUMNS)
        ticks = range(len(kept["label"]))
        pushed = [region == 1 for region in kept["no_go"]]
        self.assertTrue(any(pushed))
        self.assertEqual([flags & (1 << 22) != 0 for flags in kept["flags"]], pushed)
        # before contact the region alone is felt, by its stiffness
        alone = [tick for tick in ticks[1:-1] if pushed[tick] and 0.5 < kept["no_go_depth_mm"][tick] < 1.9 and
                 not any(kept["label"][tick - 1:tick + 2])]
        self.assertTrue(alone)
        for tick in alone:
            self.assertTrue(math.isclose(kept["no_go_N"][tick], 0.1 * kept["no_go_depth_mm"][tick], rel_tol=1e-6), tick)
        # what is touched is near, and the nearest comes first
        for tick in ticks:
            if kept["label"][tick] == label:
                self.assertIn(label, kept["near_label"][tick])
            told = [mm for near, mm in zip(kept["near_label"][tick], kept["near_mm"][tick]) if near != 0]
            self.assertEqual(told, sorted(told), tick)
            self.assertFalse(any(kept["near_label"][tick][len(told):]), tick)
        self.assertIn("identical", self.succeed("replay", run, scene).stdout)


if __name__ == "__main__":
    cli.share_prepared_models()
    cli.main()
