"""palpate register and palpate pivot: what somebody with a tracker types, and what they say of files that do not do."""

import json
import math
import os
import random

import cli
from poses import POINTS, rotated, times

TURN, SHIFT = rotated((1, 2, 3), 0.7), (100.0, -50.0, 900.0)


def tracked(p):
    return [a + b for a, b in zip(times(TURN, p), SHIFT)]


class Navigation(cli.PalpateTest):
    def lines(self, name, points):
        file = os.path.join(self.folder, name)
        with open(file, "w", encoding="utf-8") as out:
            for label, p in points.items():
                out.write(",".join([label, *(f"{a:.6f}" for a in p)]) + "\n")
        return file

    def test_registers_by_points_in_any_order_and_says_how_wrong_it_may_be(self):
        scan = self.lines("scan.csv", POINTS)
        seen = self.lines("seen.csv", {name: tracked(POINTS[name]) for name in reversed(POINTS)})
        out = os.path.join(self.folder, "out.json")
        done = self.succeed("register", scan, seen, "--fle", "0.5", "--target", "0,0,0", "--target=0,-200,0", "-o", out)
        with open(out, encoding="utf-8") as text:
            found = json.load(text)
        self.assertLess(found["by_points"]["fre_mm"], 1e-4)
        rows = found["patient_from_tracker"]
        for name, p in POINTS.items():
            at = [sum(a * b for a, b in zip(row, [*tracked(p), 1])) for row in rows[:3]]
            self.assertLess(math.dist(at, p), 1e-3, name)
        near, far = (target["tre_rms_mm"] for target in found["by_points"]["targets"])
        self.assertGreater(far, 2 * near)
        self.assertIn("does not predict the error elsewhere", done.stdout)
        # what was computed from itself says nothing of its error
        done = self.succeed("register", scan, seen)
        self.assertIn("computed from each other", done.stderr)
        self.assertNotIn("TRE", done.stdout)

    def test_what_a_new_user_gets_wrong(self):
        scan = self.lines("scan.csv", POINTS)
        self.expect_error(cli.BAD_INPUT, "register", scan, self.lines("two.csv", dict(list(POINTS.items())[:2])), message="three pairs")
        self.expect_error(cli.BAD_INPUT, "register", scan, self.lines("other.csv", {"a": (1, 2, 3)}), message="with other names")
        mirrored = {name: [-p[0], p[1], p[2]] for name, p in POINTS.items()}
        self.expect_error(cli.BAD_INPUT, "register", scan, self.lines("mirrored.csv", mirrored), message="mirror images")
        some = self.lines("some.csv", {name: (*p, 0.5) if name == "fibula" else p for name, p in POINTS.items()})
        self.expect_error(cli.BAD_INPUT, "register", scan, some, message="of only 1 of 5 points")
        self.expect_error(cli.BAD_INPUT, "register", scan, os.path.join(self.folder, "missing.csv"), message="missing.csv")
        self.expect_error(cli.USAGE, "register", scan, scan, "--surface", "knee-phantom", message="--touched")
        self.expect_error(cli.USAGE, "register", scan, scan, "-o", scan, message="scan.csv")

    def test_a_tip_from_poses_of_which_some_are_wrong(self):
        random.seed(7)
        poses = os.path.join(self.folder, "poses.csv")
        tip, pivot = (-17.8, 1.1, -156.9), (146.9, -63.0, -1042.1)

        def write(swing, wrong=0):
            with open(poses, "w", encoding="utf-8") as out:
                for n in range(120):
                    turn = rotated([random.gauss(0, 1) for _ in range(3)], random.gauss(0, swing))
                    at = [a - b for a, b in zip(pivot, times(turn, tip))]
                    if n < wrong:
                        at[0] += 20
                    out.write(" ".join(f"{a:.9f}" for row, p in zip(turn, at) for a in [*row, p]) + "\n")

        write(0.5, wrong=12)
        out = os.path.join(self.folder, "tip.json")
        self.assertIn("12 of 120 poses", self.succeed("pivot", poses, "-o", out).stdout)
        with open(out, encoding="utf-8") as text:
            found = json.load(text)
        self.assertLess(math.dist(found["tip_mm"], tip), 1e-3)
        self.assertEqual(found["left_out"], list(range(1, 13)))
        write(0.01)
        self.expect_error(cli.BAD_INPUT, "pivot", poses, message="hardly turned")

    def test_traced_places_go_onto_the_bone_and_nowhere_else(self):
        """tests/navigation says how well: here what is typed and told."""
        scan = self.lines("scan.csv", POINTS)
        seen = self.lines("seen.csv", {name: tracked(p) for name, p in POINTS.items()})
        nowhere = self.lines("nowhere.csv", {str(n): (31 * n % 90, 17 * n % 70, 53 * n % 80) for n in range(20)})
        surface = ("--surface", "knee-phantom:spacing=1.5", "--structure", "tibia")
        self.expect_error(cli.BAD_INPUT, "register", scan, seen, *surface, "--touched", nowhere, message="do not fit the surface")
        self.expect_error(cli.USAGE, "register", scan, seen, *surface[:3], "tibbia", "--touched", nowhere, message='did you mean "tibia"?')


if __name__ == "__main__":
    cli.share_prepared_models()
    cli.main()
