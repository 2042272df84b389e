"""Twenty generated temporal bones, each drilled by an expert and three kinds of beginner (trainees.py)."""

import pathlib

import cli
import trainees

TASK = "cortical-mastoidectomy"


class Mastoidectomy(cli.PalpateTest):
    def test_each_kind_of_beginner_is_told_in_twenty_patients(self):
        areas, values = trainees.areas_of(TASK, 20, pathlib.Path(self.folder), 2)
        self.assertEqual(trainees.faults_of(TASK, areas), [])
        for seed, score in enumerate(values["expert"]):
            self.assertEqual(score["steps_done"], 1, seed)
            self.assertEqual(score["protected_removed"], 0, seed)


if __name__ == "__main__":
    cli.main()
