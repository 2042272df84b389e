"""palpate register and palpate pivot: what somebody with a tracker types, and what they say of files that do not do."""

import json
import math
import os
import random

import cli


def rotated(axis, angle):
    """A rotation's matrix, by Rodrigues."""
    n = math.sqrt(sum(a * a for a in axis))
    x, y, z = (a / n for a in axis)
    c, s = math.cos(angle), math.sin(angle)
    return [[c + x * x * (1 - c), x * y * (1 - c) - z * s, x * z * (1 - c) + y * s],
            [y * x * (1 - c) + z * s, c + y * y * (1 - c), y * z * (1 - c) - x * s],
            [z * x * (1 - c) - y * s, z * y * (1 - c) + x * s, c + z * z * (1 - c)]]


def times(matrix, v):
    return [sum(a * b for a, b in zip(row, v)) for row in matrix]


POINTS = {"medial": (30, -10, 5), "lateral": (-32, -8, 2), "tuberosity": (4, -38, -60), "patella": (0, -52, 20), "fibula": (-38, 22, -40)}
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
        self.fail_clearly(cli.BAD_INPUT, "register", scan, self.lines("two.csv", dict(list(POINTS.items())[:2])), says="three pairs")
        self.fail_clearly(cli.BAD_INPUT, "register", scan, self.lines("other.csv", {"a": (1, 2, 3)}), says="with other names")
        mirrored = {name: [-p[0], p[1], p[2]] for name, p in POINTS.items()}
        self.fail_clearly(cli.BAD_INPUT, "register", scan, self.lines("mirrored.csv", mirrored), says="mirror images")
        some = self.lines("some.csv", {name: (*p, 0.5) if name == "fibula" else p for name, p in POINTS.items()})
        self.fail_clearly(cli.BAD_INPUT, "register", scan, some, says="of only 1 of 5 points")
        self.fail_clearly(cli.BAD_INPUT, "register", scan, os.path.join(self.folder, "missing.csv"), says="missing.csv")
        self.fail_clearly(cli.USAGE, "register", scan, scan, "--surface", "knee-phantom", says="--touched")
        self.fail_clearly(cli.USAGE, "register", scan, scan, "-o", scan, says="scan.csv")

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
        self.fail_clearly(cli.BAD_INPUT, "pivot", poses, says="hardly turned")

    def test_traced_places_go_onto_the_bone_and_nowhere_else(self):
        """tests/navigation says how well: here what is typed and told."""
        scan = self.lines("scan.csv", POINTS)
        seen = self.lines("seen.csv", {name: tracked(p) for name, p in POINTS.items()})
        nowhere = self.lines("nowhere.csv", {str(n): (31 * n % 90, 17 * n % 70, 53 * n % 80) for n in range(20)})
        surface = ("--surface", "knee-phantom:spacing=1.5", "--structure", "tibia")
        self.fail_clearly(cli.BAD_INPUT, "register", scan, seen, *surface, "--touched", nowhere, says="do not fit the surface")
        self.fail_clearly(cli.USAGE, "register", scan, seen, *surface[:3], "tibbia", "--touched", nowhere, says='did you mean "tibia"?')


if __name__ == "__main__":
    cli.share_what_is_prepared()
    cli.main()
