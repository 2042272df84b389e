"""Scripted trainees at a generated temporal bone: each kind of beginner is told by what it does badly. One patient, whose runs take a
minute of processor time each; trainees.py does more."""

import pathlib

import cli
import trainees


class Mastoidectomy(cli.PalpateTest):
    def test_a_beginner_at_the_mastoid_is_told_from_an_expert(self):
        task, patient = "cortical-mastoidectomy", "temporal-bone:seed=1,spacing=0.6"
        runs = [trainees.recording_of(task, kind, 1, pathlib.Path(self.folder), patient) for kind in ("expert", *trainees.KINDS)]
        expert, heavy, shaky, incomplete = trainees.scores_of(task, runs)
        self.assertEqual((expert["steps_done"], expert["protected_removed"], expert["hidden_time"]), (1, 0, 0))
        self.assertGreater(expert["bone_left of sigmoid_sinus"], 0.3)
        self.assertGreater(expert["burr_distance of facial_nerve"], heavy["burr_distance of facial_nerve"] + 1)
        self.assertGreater(heavy["force_near of facial_nerve"], expert["force_near of facial_nerve"] + 0.3)
        self.assertLess(shaky["smoothness"], expert["smoothness"] - 1)
        self.assertGreater(incomplete["hidden_time"], 0.5)
        self.assertLess(incomplete["removed_in_plan"], 0.6 * expert["removed_in_plan"])


if __name__ == "__main__":
    cli.share_prepared_models()
    cli.main()
