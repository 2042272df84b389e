"""The founding work's structures on a real, hand-segmented left knee."""

import os
import re

import cli
from knee_phantom_test import STRUCTURES


class KneeAtlas(cli.PalpateTest):
    def setUp(self):
        super().setUp()
        cli.need("knee_spl/seg.nrrd")

    def test_every_bone_and_cartilage_is_held_within_the_limit(self):
        recording = self.folder / "atlas.h5"
        done = self.succeed("simulate", "knee-atlas", "-o", recording)
        held = cli.contact_figures(done.stdout)
        for structure in STRUCTURES:
            self.assertGreaterEqual(held[structure][0], 0.5, f"{structure}: {held}")
        largest, limit = map(float, re.search(r"largest force ([\d.]+) N of ([\d.]+) N", done.stdout).groups())
        self.assertLessEqual(largest, limit)
        again = self.succeed("replay", recording)
        self.assertIn("identical", again.stdout)
        self.assertEqual(cli.run_hash(again.stdout), cli.run_hash(done.stdout))

        report = self.folder / "atlas.html"
        self.succeed("report", recording, "-o", report)
        page = report.read_text()
        self.assertIn("LEFT", page)
        # what the recording was made from is nowhere in it
        for folder in os.environ["PALPATE_DATA"].split(":"):
            self.assertNotIn(folder, page)


if __name__ == "__main__":
    cli.share_prepared_models()
    cli.main()
