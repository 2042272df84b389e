"""Viewers of palpate explore: they change settings and tissues, lead the pointer, edit the plan and teach a lesson."""

import json
import re
import select
import signal
import time
import urllib.request

import cli
from live_session import KneeSessionTest, Viewer

CONTACT, STALE, INSIDE = 16, 512, 1 << 17


class ExploreViewers(KneeSessionTest):
    def test_viewers_change_what_is_felt_and_it_replays(self):
        recording = self.folder / "run.h5"
        # by a direct method, deeper than its force explains, the hand may give its step up: it begins again
        process, viewer, _ = self.viewed(*self.explore("--port", "0", "--repeat", "-o", recording))
        scene = json.loads(viewer.get("api/scene"))
        femur = next(s for s in scene["structures"] if s["name"] == "femur")
        self.assertEqual(scene["device"]["name"], "premium-1.5 (simulated)")
        self.assertEqual(scene["device"]["input"], "script")
        self.assertIn("proxy", scene["methods"])
        _, stiffness, label, _ = viewer.wait_for_pose(lambda force, *_: force > 0.5)
        self.assertEqual(label, femur["label"])
        self.assertAlmostEqual(stiffness, 1.5, places=6)

        answer = viewer.ask(type="tissue", tissue=femur["tissue"], stiffness_N_per_mm=1.1, static_friction=0.4)
        self.assertEqual(answer["type"], "done", answer)
        viewer.wait_for_pose(lambda force, stiffness, *_: abs(stiffness - 1.1) < 1e-6)
        # all or none, in the words of the scene
        for request, where, what in (
                ({"type": "tissue", "tissue": femur["tissue"], "static_friction": 0.5, "stiffness_N_per_mm": 21},
                 "stiffness_N_per_mm", "stiffness = 21 is outside 0.001 ... 20 N/mm"),
                ({"type": "set", "friction": False, "max_force_N": 100}, "max_force_N", "outside"),
                ({"type": "set", "friction": False, "method": "telepathy"}, "method", "no force method")):
            answer = viewer.ask(**request)
            self.assertEqual((answer["type"], answer.get("where")), ("refused", where), answer)
            self.assertIn(what, answer["what"])
        answer = viewer.ask(type="set", viscosity=False, rotation_wxyz=[0.9998, 0, 0, 0.02], max_force_N=1.2)
        self.assertEqual(answer["type"], "done", answer)
        while viewer.state.get("max_force_N") != 1.2:
            viewer.next()
        self.assertEqual(viewer.state["tissues"][femur["tissue"]]["static_friction"], 0.4)
        self.assertTrue(viewer.state["friction"])
        self.assertFalse(viewer.state["viscosity"])
        self.assertEqual(viewer.state["model_version"], 2)
        self.assertTrue(viewer.state["recording"])
        self.assertEqual(viewer.ask(type="pointer", take=True)["type"], "refused")
        self.assertEqual(viewer.ask(type="stop")["type"], "done")
        viewer.wait_for_pose(lambda force, *_: force == 0)
        while not viewer.state.get("stop"):
            viewer.next()
        answer = viewer.ask(type="rearm", stop=viewer.state["stop"] + 1)
        self.assertEqual((answer["type"], answer.get("where")), ("refused", "stop"), answer)
        # the hand leaves what it touched first
        for _ in range(100):
            answer = viewer.ask(type="rearm", stop=viewer.state["stop"])
            if answer["type"] == "done":
                break
            self.assertIn("is in contact", answer["what"])
            time.sleep(0.1)
        self.assertEqual(answer["type"], "done", answer)
        # it comes back and presses as before, for as long as a press takes to settle
        settled = 0

        def presses(force, *_):
            nonlocal settled
            settled = settled + 1 if force > 0.6 else 0
            return settled == 90

        viewer.wait_for_pose(presses)

        # a direct method, whose fields are made anew first
        self.assertEqual(viewer.ask(type="set", method="b-spline")["type"], "done")
        while viewer.state["method"] != "b-spline":
            viewer.next()
        self.assertEqual(viewer.state["model_version"], 3)
        _, stiffness, *_ = viewer.wait_for_pose(lambda force, *_: force > 0.3)
        self.assertAlmostEqual(stiffness, 1.1, places=6)
        answer = viewer.ask(type="tissue", tissue=femur["tissue"], stiffness_N_per_mm=1.0)
        self.assertEqual((answer["type"], answer.get("where")), ("refused", "stiffness_N_per_mm"), answer)

        process.send_signal(signal.SIGINT)
        out, error = process.communicate(timeout=300)
        self.assertEqual(process.returncode, cli.OK, error)
        self.assert_replays(recording, out, self.scene)

    @cli.long
    def test_a_plan_that_was_not_saved_is_told_when_the_session_is_interrupted(self):
        plan = self.folder / "plan.toml"
        text = '# for Monday\ntitle = "p"\n[[trajectory]]\nname = "way"\nentry = [0, 0, 0]\ntarget = [0, 0, 9]\n# of no use\n'
        for saves in (False, True):
            plan.write_text(text)
            process, viewer, _ = self.viewed("explore", self.scene, "--device", "pointer", "--port", "0", "--plan", plan)
            self.assertEqual(viewer.ask(type="plan", version=1, trajectory=0, name="other")["type"], "done")
            if saves:
                self.assertEqual(viewer.ask(type="plan", version=2, save=True)["type"], "done")
            process.send_signal(signal.SIGINT)
            _, error = process.communicate(timeout=300)
            self.assertEqual(process.returncode, cli.OK, error)
            self.assertEqual("plan.toml: changes to the plan made in the page were not saved and are lost" in error, not saves, error)
            if saves:
                self.assertRegex(plan.read_text(), r'(?s)^# for Monday\ntitle = "p"\n.*name = "other"')
            else:
                self.assertEqual(plan.read_text(), text)

    @cli.long
    def test_a_teacher_ends_the_session_and_a_learner_s_run_is_his_own(self):
        tokens, records = self.folder / "tokens", self.folder / "records.db"
        lines = cli.run("token", "--role", "teacher").stdout + cli.run("token", "--role", "learner", "--learner", "L042").stdout
        tokens.write_text(lines)
        tokens.chmod(0o600)
        (_, teacher), (_, learner, _) = (line.split() for line in lines.splitlines())
        process, _, told = self.viewed("explore", self.scene, "--device", "pointer", "--port", "0", "--token-file", tokens, "--records", records,
                                       "--task", "hold-steady")
        address = re.search(r"open (http://\S+)$", told, re.M).group(1)

        def get(token):
            opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
            with opener.open(urllib.request.Request(address + "api/curves", headers={"Authorization": f"Bearer {token}"}), timeout=300) as answer:
                return answer.read().decode()

        pupil, leader = Viewer(address, learner), Viewer(address, teacher)
        self.addCleanup(pupil.close)
        self.addCleanup(leader.close)
        self.assertEqual(pupil.ask(type="pointer", take=True)["type"], "done")
        begun = pupil.ask(type="task", begin="hold-steady")
        self.assertEqual(begun["type"], "done", begun)
        refused = pupil.ask(type="set", max_force_N=0.5)
        self.assertEqual(refused["where"], "role")
        self.assertIn("only a viewer with control or a teacher", refused["what"])
        time.sleep(0.3)
        self.assertEqual(pupil.ask(type="task", end=True)["type"], "done")
        # curves are of whoever asks
        until = time.monotonic() + 60
        while "L042" not in get(learner):
            self.assertLess(time.monotonic(), until)
        # whom the teacher chooses; a run during which nobody held the tip is no learner's, and not saved
        until = time.monotonic() + 60
        while leader.ask(type="lesson", learner="L007")["type"] != "done" or leader.ask(type="task", begin="hold-steady")["type"] != "done":
            self.assertLess(time.monotonic(), until)
        self.assertEqual(pupil.ask(type="task", end=True)["where"], "learner")
        time.sleep(0.3)
        self.assertEqual(leader.ask(type="lesson", end=True)["type"], "done")
        out, error = process.communicate(timeout=300)
        self.assertEqual(process.returncode, cli.OK, error)
        self.assertIn("run 2", out)
        rows = cli.run("records", "list", "--records", records, "--json").stdout.splitlines()
        self.assertEqual([json.loads(row)["learner"] for row in rows], ["L042"])

    @cli.long
    def test_a_pointer_feels_and_rests_when_its_page_is_gone(self):
        recording = self.folder / "run.h5"
        process, viewer, _ = self.viewed("explore", self.scene, "--device", "pointer", "--port", "0", "-o", recording)
        self.assertEqual(json.loads(viewer.get("api/scene"))["device"]["input"], "pointer")
        self.assertEqual(viewer.ask(type="pointer", take=True)["type"], "done")
        # from the front, into the middle of the knee: held at the surface
        deep_mm = -70

        def press(force, _stiffness, _label, flags):
            nonlocal deep_mm
            # poses that waited while this process had no processor are answered by one step
            if select.select([viewer.socket], [], [], 0)[0]:
                return False
            # after a longer pause it came back inside, and feels nothing until it has left
            if flags & INSIDE:
                deep_mm = -70
            # the first step that touches may end too shallow to press: deeper then, but gently
            elif force <= 0.1:
                deep_mm += 0.02 if flags & CONTACT else 0.5
            viewer.send({"type": "tip", "patient_mm": [0, deep_mm, 0]})
            return flags & CONTACT and force > 0.1

        _, _, label, _ = viewer.wait_for_pose(press)
        self.assertNotEqual(label, 0)
        # it says nothing more: no force, and the session goes on
        viewer.wait_for_pose(lambda force, _stiffness, _label, flags: force == 0 and flags & STALE)
        viewer.wait_for_pose(press)
        process.send_signal(signal.SIGINT)
        out, error = process.communicate(timeout=300)
        self.assertEqual(process.returncode, cli.OK, error)
        self.assertEqual(len(cli.contact_figures(out)), 1, out)
        # nothing was wrong with a hand
        self.assertRegex(out, r"force changed in ticks: .*at rest \d+")
        self.assertNotIn("stale", out)
        self.assert_replays(recording, out, self.scene)


if __name__ == "__main__":
    cli.share_prepared_models()
    cli.main()
