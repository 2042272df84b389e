"""Viewers of a session receive neither a patient's name nor the names of files."""

import json
import re
import struct
import time

import cli
from canary_files import CANARY, everything_in, nifti_with_canary, nrrd_with_canary
from live_session import SessionTest, Viewer, http_get
from volume_files import ball


class ViewerPrivacy(SessionTest):
    def test_viewers_receive_no_file_name(self):
        # every name carries a word of its own; where which of them may stand, the manual says
        folder = self.folder / "CANARYFOLDER"
        plans = folder / "CANARYPLANS"
        plans.mkdir(parents=True)
        labels, scan = folder / "CANARYLABELS.seg.nrrd", folder / "CANARYSCAN.nii.gz"
        scene, task, plan = folder / "CANARYSCENE.toml", folder / "CANARYTASK.toml", plans / "CANARYPLAN.toml"
        tokens, records, recording = folder / "CANARYTOKENS", folder / "CANARYRECORDS.db", folder / "CANARYRECORDING.h5"
        n = 40
        labelled = ball((n, n, n), 10)
        nrrd_with_canary(labels, (n, n, n), labelled)
        nifti_with_canary(scan, (n, n, n), b"".join(struct.pack("<h", 100 * v + 7) for v in labelled))
        self.succeed("scene", "new", "--scan", scan, "--labels", labels, "-o", scene)
        scene.write_text(scene.read_text().replace("touchable = false", "touchable = true"))
        task.write_text('title = "Hold"\nbriefing = "Press."\nend = "recording"\n[[region]]\nname = "all"\nstructures = ["ball"]\n'
                        '[[step]]\nname = "hold"\nregion = "all"\nforce = [0.2, 20]\nseconds = 1\n[[metric]]\nname = "time"\n')
        roles = {role: self.succeed("token", "--role", role, *more).stdout for role, more in
                 {"view": (), "control": (), "teacher": (), "learner": ("--learner", "CANARYLEARNER")}.items()}
        tokens.write_text("".join(roles.values()))
        tokens.chmod(0o600)
        before = {path for path in self.folder.rglob("*") if path.is_file()}
        process, control, _ = self.viewed("explore", scene, "--device", "pointer", "--port", "0", "--token-file", tokens, "--records", records,
                                          "--task", task, "--plan", plan, "-o", recording, token=roles["control"].split()[1])
        viewers = {"control": control}
        for role in ("view", "learner", "teacher"):
            viewers[role] = Viewer(control.address, roles[role].split()[1])
            self.addCleanup(viewers[role].close)
        self.assertEqual(control.ask(type="plan", version=1, trajectory=0, name="way", entry_mm=[0, 0, 0], target_mm=[0, 0, 9])["type"], "done")
        # the plan's folder is gone, and a file has its name
        plans.rename(folder / "CANARYGONE")
        plans.write_text("in the way")
        refused = control.ask(type="plan", version=2, save=True)
        self.assertEqual((refused["type"], refused["where"]), ("refused", ""), refused)
        self.assertIn("a file, not a folder", refused["what"])
        offered = json.loads(http_get(control.address, "api/scene", roles["control"].split()[1])[1])["tasks"]
        self.assertEqual([one["name"] for one in offered], ["task"])
        answers = []
        for role, viewer in viewers.items():
            for request in ({"type": "set", "method": "b-spline"}, {"type": "set", "method": "none"}, {"type": "set", "law": "none"}, {"type": "set", "max_force_N": 99},
                            {"type": "set", "motor": True}, {"type": "set", "paused": False}, {"type": "tissue", "tissue": 9, "static_friction": 0.1},
                            {"type": "tissue", "tissue": 0, "stiffness_N_per_mm": 1e9}, {"type": "undo"}, {"type": "redo"}, {"type": "stop"},
                            {"type": "rearm", "stop": 99}, {"type": "rearm", "stop": 1, "code": "000000"}, {"type": "pointer", "take": True}, {"type": "task", "begin": "CANARYLESS"},
                            {"type": "task", "begin": "task"}, {"type": "task", "end": True}, {"type": "task", "end": True}, {"type": "play", "at_s": 1},
                            {"type": "lesson", "task": "none"}, {"type": "lesson", "learner": "CANARYLEARNER"}, {"type": "lesson", "names": True},
                            {"type": "plan", "version": 2, "save": True}, {"type": "plan", "version": 1, "save": True}, {"type": "plan", "version": 2, "trajectory": 7, "remove": True},
                            {"type": "plan", "version": 2, "back_to": 77}, {"type": "nothing"}, {"type": "set", "no_such_key": 1}, {"type": "pointer", "take": False}):
                answers.append(viewer.ask(**request))
        # the ball's fields are made, and the run is kept, in their own time
        viewers["teacher"].ask(type="task", begin="task")
        viewers["teacher"].ask(type="task", end=True)
        until = time.monotonic() + 2
        while time.monotonic() < until:
            for viewer in viewers.values():
                viewer.next()
        self.assertGreater(sum(answer["type"] == "refused" for answer in answers), 40)
        wire = [bytes(viewer.wire) for viewer in viewers.values()]
        hash_of = json.loads(http_get(control.address, "api/scene", roles["view"].split()[1])[1])["volume"]["hash"]
        for line in [*roles.values(), "x no-token-at-all-of-ours"]:
            for path in ("", "api/scene", "api/curves", f"api/labels/{hash_of}", f"api/scan/{hash_of}", "api/scan/none", "api/nothing", "../CANARYLESS"):
                wire += http_get(control.address, path, line.split()[1])
        # the session ends with the lesson, after the answer
        self.assertEqual(viewers["teacher"].ask(type="lesson", end=True)["type"], "done")
        out, error = process.communicate(timeout=300)
        wire.append(bytes(viewers["teacher"].wire))
        self.assertTrue(any(b"CANARYLEARNER" in data for data in wire), "the teacher is told whose the runs are")
        for data in wire:
            # what viewers sent is said by no answer but a learner's pseudonym
            self.assertNotIn(b"CANARY", data.replace(b"CANARYLEARNER", b""))
        # of what the session wrote, the records alone hold a name: the learner's pseudonym
        made = {path for path in self.folder.rglob("*") if path.is_file()} - before
        self.assertLessEqual({records, recording}, made)
        for path in made - {folder / "CANARYPLANS"}:
            for content in everything_in(path):
                # h5dump says which file it dumps
                content = content.replace(str(path).encode(), b"")
                self.assertNotIn(b"CANARY", content.replace(b"CANARYLEARNER", b"") if path.name.startswith(records.name) else content, path.name)

    def test_viewers_receive_no_patient_name(self):
        named = self.folder / CANARY
        named.mkdir()
        n = 40
        labelled = ball((n, n, n), 10)
        nrrd_with_canary(named / "labels.seg.nrrd", (n, n, n), labelled)
        nifti_with_canary(named / "scan.nii.gz", (n, n, n), b"".join(struct.pack("<h", 100 * v + 7) for v in labelled))
        scene = named / "scene.toml"
        self.succeed("scene", "new", "--scan", named / "scan.nii.gz", "--labels", named / "labels.seg.nrrd", "-o", scene)
        text = re.sub(r"(?m)^title = .*$", "", scene.read_text().replace("touchable = false", "touchable = true"))
        scene.write_text(f'title = "{CANARY}"\n{text}')
        _, viewer, told = self.viewed("explore", scene, "--port", "0")
        described = viewer.get("api/scene")
        hash_ = json.loads(described)["volume"]["hash"]
        self.assertEqual([s["name"] for s in json.loads(described)["structures"]], ["ball"])
        viewer.ask(type="set", max_force_N=1000)
        poses = [viewer.next()[1] for _ in range(20)]
        volumes = [viewer.get(f"api/volume/{kind}/{hash_}") for kind in ("labels", "scan")]
        seen = [described, *volumes, told.encode(), *viewer.texts, *(pose for pose in poses if isinstance(pose, bytes))]
        self.assertGreater(viewer.poses, 0)
        for what in seen:
            self.assertNotIn(b"CANARY", what)


if __name__ == "__main__":
    cli.share_prepared_models()
    cli.main()
