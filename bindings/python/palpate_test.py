#!/usr/bin/env python3
"""The Python package over libpalpate.so: what it makes, that it fails by exceptions alone, and that a run has one hash in every language.

    PALPATE_LIBRARY=libpalpate.so PALPATE=palpate palpate_test.py
"""

import gc
import importlib
import inspect
import math
import os
import pathlib
import random
import re
import resource
import signal
import subprocess
import sys
import tempfile
import threading
import time
import typing
import unittest

sys.dont_write_bytecode = True
HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parents[1] / "tests")]

try:
    import numpy as np
except ImportError:
    print("no NumPy for this Python")
    sys.exit(77)

import shared_cache

shared_cache.share_prepared_models(os.environ["PALPATE"])

import palpate as pp
from palpate import _library as c

SCENE = "palpation-block:spacing=2"
SCRIPT = '[[step]]\napproach = "plate"\n[[step]]\npress = 0.5\n[[step]]\nleave = true\n'
NAN = math.nan
ABOVE = [9.5, 9.5, 16.0]  # over the middle of block()


def block(**arguments):
    """A block of bone, 12 x 12 x 8 mm, its top at k = 13.5."""
    labels = np.zeros((20, 20, 20), np.uint8)
    labels[4:16, 4:16, 6:14] = 1
    return pp.Model(labels, **{"tissues": {"bone": {"labels": 1}}, **arguments})


def press(ticks=1000, to=12.5):
    """Tips that come down onto the block, and rest."""
    way = np.minimum(np.arange(ticks) / 600, 1)
    return np.stack([np.full(ticks, 9.5), np.full(ticks, 9.5), 16.5 + (to - 16.5) * way], axis=1)


class Models(unittest.TestCase):
    def test_it_tells_what_it_was_made_of(self):
        turned = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
        model = block(spacing=(1, 2, 3), origin=(4, 5, 6), direction=turned, title="a block", names={1: "cube"},
                      tissues={"bone": pp.Tissue(labels=(1,), stiffness=2, friction=0.3)}, tools=[pp.Tool(radius=1)])
        self.assertEqual((model.title, model.version, model.shape, model.method), ("a block", 1, (20, 20, 20), "proxy"))
        self.assertEqual(model.structures, [pp.Structure(1, "cube", "bone", (200, 200, 200))])
        self.assertEqual(model.tissues["bone"], pp.Tissue(labels=(1,), stiffness=2, friction=0.3, static_friction=0.3))
        np.testing.assert_array_equal(model.direction, turned)
        np.testing.assert_array_equal(model.points([1, 1, 1]), [4 + 2, 5 + 1, 6 - 3])
        self.assertEqual(model.labels()[9, 9, 9], 1)
        with self.assertRaises(pp.Unavailable):
            model.scan()

    def test_any_type_and_memory_order_gives_the_same_model(self):
        expected = block().hash
        labels = block().labels()
        for array in (labels.astype(np.int64), np.ascontiguousarray(labels), np.asfortranarray(labels.astype(np.uint8)),
                      np.ascontiguousarray(labels[::-1])[::-1], np.repeat(labels, 2, axis=1)[:, ::2]):
            self.assertEqual(pp.Model(array, tissues={"bone": {"labels": 1}}).hash, expected)

    def test_labels_go_in_without_a_dense_copy(self):
        # np.full writes every page, which np.zeros leaves to the first access: these are in memory before
        labels = np.full((500, 500, 200), 0, np.uint16)
        labels[240:260, 240:260, 90:110] = 1
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        pp.Model(labels, tissues={"bone": {"labels": 1}}, method="trilinear")
        grown_MB = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
        self.assertLess(grown_MB, labels.nbytes / 1e6 / 2)

    def test_versions_change_stiffness_and_cut(self):
        model = block()
        softer = model.with_(stiffness={"bone": 0.5}, friction={"bone": 0.4})
        self.assertEqual((softer.version, softer.tissues["bone"].stiffness), (2, 0.5))
        self.assertEqual((model.version, model.tissues["bone"].stiffness), (1, 1.0))
        hollow = softer.cut([[9.5, 9.5, 14], [9.5, 9.5, 12]], radius=3)
        self.assertLess((hollow.labels() == 1).sum(), (model.labels() == 1).sum())
        with self.assertRaisesRegex(pp.BadInput, "known are: bone"):
            model.with_(stiffness={"nothing": 1})

    def test_tissues_on_each_other_change_together(self):
        scene = pp.load(SCENE)
        changed = scene.with_(stiffness={"plate": 0.03, "soft tissue": 0.02, "nodule": 0.025})
        self.assertEqual([changed.tissues[name].stiffness for name in ("plate", "soft tissue", "nodule")], [0.03, 0.02, 0.025])
        with self.assertRaises(pp.BadInput):
            scene.with_(stiffness={"plate": 1000})

    def test_fields_are_sampled(self):
        model = block()
        points = np.array([[[9.5, 9.5, 18]], [[9.5, 9.5, 12.5]]])
        values, slopes = model.sample(points)
        self.assertEqual((values.shape, slopes.shape), ((2, 1), (2, 1, 3)))
        self.assertGreater(values[0, 0], 1)
        self.assertAlmostEqual(values[1, 0], -1.2, delta=0.1)
        np.testing.assert_allclose(slopes[1, 0], [0, 0, 1], atol=1e-2)
        for method in pp.METHODS:
            self.assertGreater(abs(model.sample(points, method)[0][1, 0]), 0, method)

    def test_sections_and_pictures_are_arrays(self):
        model = block()
        labels = model.section_labels(size=20, pixels=20)
        self.assertEqual((labels == 1).sum(), 12 * 12)
        self.assertEqual((model.section_labels("coronal", size=20, pixels=20) == 1).sum(), 12 * 8)
        image = model.section(size=20, pixels=20)
        self.assertEqual((image.shape, image.dtype), ((20, 20, 3), np.uint8))
        self.assertGreater(int(image[10, 10, 0]), int(image[0, 0, 0]))
        for view in ("anterior", "posterior", "left", "right", "superior", "inferior"):
            image, depth = model.picture(view, size=20, pixels=20)
            self.assertAlmostEqual(float(depth[10, 10]), -4 if view in ("superior", "inferior") else -6, delta=1)
            self.assertTrue(np.isinf(depth[0, 0]))
        for wrong in (lambda: model.section("oblique"), lambda: model.section(size=0), lambda: model.section(pixels=0),
                      lambda: model.section(((1, 0, 0), (1, 0, 0))), lambda: model.picture(at=(0, NAN, 0))):
            with self.assertRaises(pp.BadInput):
                wrong()

    def test_a_scan_is_seen_and_not_copied(self):
        model = pp.load(SCENE)
        scan = model.scan()
        self.assertEqual(scan.shape, model.shape)
        self.assertFalse(scan.flags.writeable)
        self.assertFalse(scan.flags.owndata)
        again = model.scan()
        self.assertEqual(scan.ctypes.data, again.ctypes.data)
        value = float(scan[3, 3, 3])
        del model, again
        gc.collect()
        self.assertEqual(float(scan[3, 3, 3]), value, "the array keeps its model")


class Sessions(unittest.TestCase):
    def test_ticks_one_by_one_are_the_run(self):
        model = block()
        one, many = pp.Session(model), pp.Session(model)
        tips = press()
        records = many.run(tips)
        for tip in tips:
            force, torque = one.tick(tip)
        self.assertEqual(one.hash, many.hash)
        self.assertAlmostEqual(force[2], one.record()["depth_mm"], places=3)
        self.assertEqual(torque.shape, (3,))
        np.testing.assert_array_equal(records["tick"], np.arange(len(tips)))
        np.testing.assert_array_equal(records["tip_patient_mm"][-1], tips[-1])
        one.reset()
        one.run(tips)
        self.assertEqual(one.hash, many.hash)

    def test_views_of_the_buffers_give_the_same_ticks(self):
        model = block()
        for devices in (1, 2):
            copied, viewed = pp.Session(model, devices=devices), pp.Session(model, devices=devices)
            tip, force = viewed.tip, viewed.force
            self.assertEqual((viewed.orientation.shape[-1], viewed.torque.shape), (4, tip.shape))
            for at in press(700):
                at = at if devices == 1 else np.stack([at, at + [3, 0, 0]])
                expected, torque = copied.tick(at)
                tip[:] = at
                viewed.advance()
                np.testing.assert_array_equal(force, expected)
            self.assertEqual(viewed.hash, copied.hash)
            self.assertGreater(np.linalg.norm(force), 1)
            np.testing.assert_array_equal(viewed.torque, torque)
            with self.assertRaises(pp.BadInput):
                viewed.advance(NAN)
            self.assertEqual(viewed.hash, copied.hash)

    def test_frames_are_the_same_touch(self):
        model = block()
        in_patient, in_world = pp.Session(model), pp.Session(model, frame="world")
        to_world = model.world_patient
        tips = press()
        records = in_patient.run(tips)
        turn = [math.sqrt(0.5), -math.sqrt(0.5), 0, 0]  # Patient to World: a quarter about x
        for tip in tips:
            force, _ = in_world.tick(to_world[:3, :3] @ tip + to_world[:3, 3], turn)
        np.testing.assert_allclose(force, records["force_world_N"][-1], atol=1e-9)

    def test_two_devices(self):
        session = pp.Session(block(), devices=2)
        tips = np.stack([press(), press() + (0.5, 0, 20)], axis=1)
        records = session.run(tips)
        self.assertEqual(records.shape, (1000, 2))
        self.assertGreater(np.linalg.norm(records["force_world_N"][-1, 0]), 1)
        self.assertEqual(np.linalg.norm(records["force_world_N"][-1, 1]), 0)
        force, _ = session.tick(tips[-1])
        self.assertEqual(force.shape, (2, 3))

    def test_a_later_version_is_felt(self):
        session = pp.Session(block())
        session.run(press())
        session.model = session.model.with_(stiffness={"bone": 0.5})
        record = session.run(np.repeat(press()[-1:], 300, axis=0))[-1]
        self.assertAlmostEqual(np.linalg.norm(record["force_world_N"]), 0.5 * record["depth_mm"], places=3)
        with self.assertRaisesRegex(pp.BadInput, "another model"):
            session.model = block()

    def test_a_duration_that_is_none_changes_nothing(self):
        session = pp.Session(block())
        session.run(press())
        before = session.hash
        for dt in (-1, NAN, math.inf):
            with self.assertRaises(pp.BadInput):
                session.tick(press()[-1], dt=dt)
        self.assertEqual(session.hash, before)

    def test_a_loop_ticks_by_itself(self):
        tips = press(1200)
        with pp.Loop(block()) as loop:
            record, deadline, n = loop.snapshot(), time.monotonic() + 60, 0
            while np.linalg.norm(record["force_world_N"]) < 0.7 and time.monotonic() < deadline:
                loop.post(tips[min(n, len(tips) - 1)])
                n += 5
                time.sleep(0.005)
                record = loop.snapshot()
            self.assertGreaterEqual(np.linalg.norm(record["force_world_N"]), 0.7)
            with self.assertRaises(pp.BadInput):
                loop.post([0, NAN, 0])
            self.assertTrue(loop.health()["running"])
        self.assertFalse(loop.health()["running"])


class Runs(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory(prefix="palpate-python-")
        cls.addClassCleanup(folder.cleanup)
        cls.folder = pathlib.Path(folder.name)
        (cls.folder / "press.toml").write_text(SCRIPT, encoding="utf-8")
        cls.scene = pp.load(SCENE)
        cls.run_of_text = pp.simulate(cls.scene, SCRIPT, seed=7, recording=cls.folder / "run.h5")

    def test_one_run_has_one_hash_here_and_on_the_command_line(self):
        done = subprocess.run([os.environ["PALPATE"], "-q", "simulate", SCENE, "--script", "press.toml", "--seed", "7"], cwd=self.folder,
                              stdout=subprocess.PIPE, text=True, check=True)
        self.assertEqual(re.search(r"run hash (\w+)", done.stdout)[1], f"{self.run_of_text.hash:016x}")
        self.assertEqual(pp.simulate(SCENE, self.folder / "press.toml", seed=7).hash, self.run_of_text.hash)

    def test_ctrl_c_cancels_a_long_call_and_nothing_else(self):
        scene = pp.load(SCENE)
        # minutes of ticks
        script = '[[step]]\napproach = "plate"\n[[step]]\npress = 0.5\n' + '[[step]]\nhold = 60\n' * 20
        threading.Timer(0.5, signal.pthread_kill, [threading.main_thread().ident, signal.SIGINT]).start()
        begun = time.monotonic()
        with self.assertRaises(KeyboardInterrupt):
            pp.simulate(scene, script)
        self.assertLess(time.monotonic() - begun, 20)
        self.assertGreater(len(pp.simulate(scene, SCRIPT, seed=1).records), 0)

    def test_force_against_depth(self):
        depth, force = self.run_of_text.press("plate")
        self.assertGreater(len(depth), 50)
        self.assertEqual(len(depth), len(force))
        self.assertAlmostEqual(force[-1], self.run_of_text.max_force, places=6)
        softer = pp.simulate(self.scene, SCRIPT, seed=7, stiffness={"plate": 0.3})
        self.assertNotEqual(softer.hash, self.run_of_text.hash)
        self.assertGreater(softer.press("plate")[0].max(), 2 * depth.max())
        self.assertEqual(len(self.run_of_text.press("nodule")[0]), 0)
        with self.assertRaisesRegex(pp.BadInput, "known are"):
            self.run_of_text.press("spleen")

    def test_a_recording_holds_the_run(self):
        recording = pp.read(self.folder / "run.h5")
        self.assertEqual((recording.hash, recording.ticks), (self.run_of_text.hash, len(self.run_of_text.records)))
        self.assertEqual((recording.model_hash, recording.data_set), (self.scene.hash, SCENE))
        self.assertTrue(recording.complete)
        part = recording.records(first=100, count=50)
        np.testing.assert_array_equal(part, self.run_of_text.records[100:150])
        with self.assertRaises(pp.BadInput):
            recording.records(first=recording.ticks, count=1)
        with self.assertRaises(pp.Error):
            pp.read(self.folder / "press.toml")

    def test_a_frame_where_pandas_is(self):
        try:
            import pandas
        except ImportError:
            with self.assertRaises(ImportError):
                self.run_of_text.frame()
            return
        frame = pp.read(self.folder / "run.h5").frame()
        self.assertIsInstance(frame, pandas.DataFrame)
        self.assertIn("force_world_N_x", frame.columns)


class Environments(unittest.TestCase):
    """Gymnasium's reset() and step(), without Gymnasium."""

    def test_it_begins_above_the_middle(self):
        model = block()
        seen, _ = pp.Env(model, clearance=2).reset(seed=1)
        self.assertAlmostEqual(float(model.sample(seen["tip"])[0]), 2, delta=0.3)
        self.assertFalse(seen["force"].any())

    @staticmethod
    def press_to(newtons):
        def reward(seen):
            error = abs(np.linalg.norm(seen["force"]) - newtons)
            return -error, error < 0.05
        return reward

    @staticmethod
    def poses(tips):
        return np.concatenate([tips, np.broadcast_to([1.0, 0, 0, 0], (*tips.shape[:-1], 4))], axis=-1)

    def episode(self, env, seed, step=0.1, most=200):
        """Everything that an environment returns while it presses downwards."""
        seen, _ = env.reset(seed=seed)
        tip, told = seen["tip"].copy(), [seen["tip"], seen["force"]]
        for _ in range(most):
            tip = tip - [0, 0, step]
            seen, reward, terminated, truncated, _ = env.step(self.poses(tip))
            told += [seen["tip"], seen["force"], np.array(reward)]
            if np.any(terminated) or np.any(truncated):
                break
        return seen, terminated, np.concatenate([np.ravel(value) for value in told])

    def test_it_presses_to_a_force_and_says_which_structure_bears_it(self):
        env = pp.Env(block(), start=ABOVE, reward=self.press_to(1.0))
        seen, terminated, _ = self.episode(env, 1)
        self.assertIs(terminated, True)
        self.assertAlmostEqual(float(np.linalg.norm(seen["force"])), 1.0, delta=0.06)
        self.assertEqual(env.structures, ["bone"])
        # the contact's normal force is that on the hand, on a flat face
        self.assertAlmostEqual(seen["force_by_structure"][0], seen["force"][2], delta=0.05)
        # 1 N/mm by default: as deep as the force
        self.assertAlmostEqual(seen["indentation"][2], -1.0, delta=0.1)
        for name, box in env.observation_space.items():
            self.assertTrue(box.contains(seen[name]), name)

    def test_a_force_on_the_hand_rests_where_the_contact_bears_it(self):
        env = pp.Env(block(), start=ABOVE, action="wrench", seconds=3)
        env.reset(seed=1)
        for _ in range(150):
            seen, _, _, truncated, _ = env.step([0, 0, -0.8])
        self.assertIs(truncated, True)
        self.assertAlmostEqual(seen["force"][2], 0.8, delta=0.02)
        self.assertLess(np.linalg.norm(seen["velocity"]), 1)

    def test_equal_seeds_give_equal_episodes_however_many_threads(self):
        def make(threads):
            return pp.Env(block(), envs=3, threads=threads, seconds=1, patch=8, start=lambda rng, _: [9.5, 9.5, 17 + rng.uniform(0, 1)],
                          randomise=lambda rng, model: model.with_(stiffness={"bone": rng.uniform(0.5, 1.5)}))
        _, _, first = self.episode(make(1), 7)
        _, _, again = self.episode(make(2), 7)
        _, _, other = self.episode(make(1), 8)
        np.testing.assert_array_equal(first, again)
        self.assertFalse(np.array_equal(first, other))

    def test_an_environment_whose_episode_has_ended_begins_another(self):
        env = pp.Env(block(), envs=2, seconds=0.1)
        seen, _ = env.reset(seed=1)
        ended = [env.step(self.poses(seen["tip"]))[3].tolist() for _ in range(5)]
        self.assertEqual(ended, [[False, False]] * 4 + [[True, True]])
        _, _, _, truncated, info = env.step(self.poses(seen["tip"] - [0, 0, 5]))
        self.assertTrue(info["begun"].all())
        self.assertFalse(truncated.any())

    def test_patients_differ(self):
        env = pp.Env([block(), block(tissues={"bone": {"labels": 1, "stiffness": 0.3}})], envs=2, max_force=10)
        seen, _ = env.reset(seed=1)
        seen, *_ = env.step(self.poses(np.array([[9.5, 9.5, 13.0], [9.5, 9.5, 13.0]])))
        ratio = seen["force"][0, 2] / seen["force"][1, 2]
        self.assertGreater(ratio, 2)

    def test_episodes_are_what_robomimic_reads(self):
        try:
            import h5py
        except ImportError:
            self.skipTest("no h5py for this Python")
        with tempfile.TemporaryDirectory() as folder:
            file = pathlib.Path(folder) / "demos.hdf5"
            with pp.Episodes(pp.Env(block(), start=ABOVE, reward=self.press_to(1.0), seconds=20), file) as episodes:
                for seed in (1, 2):
                    self.episode(episodes, seed)
            with h5py.File(file) as stored:
                data = stored["data"]
                self.assertEqual(sorted(data), ["demo_0", "demo_1"])
                self.assertEqual(data.attrs["total"], sum(demo.attrs["num_samples"] for demo in data.values()))
                demo, count = data["demo_0"], data["demo_0"].attrs["num_samples"]
                self.assertEqual(demo["actions"].shape, (count, 7))
                self.assertEqual(demo["dones"][:].tolist(), [0] * (count - 1) + [1])
                np.testing.assert_array_equal(demo["obs/force"][1:], demo["next_obs/force"][:-1])
                self.assertGreater(demo["rewards"][-1], -0.05)
                np.testing.assert_array_equal(demo["next_obs/force"][:], data["demo_1/next_obs/force"][:])

    def test_invalid_actions_are_errors(self):
        env = pp.Env(block())
        with self.assertRaises(pp.Usage):
            env.step(self.poses(np.zeros(3)))
        env.reset(seed=1)
        for action in (np.zeros(3), np.full(7, NAN), np.zeros(7)):
            with self.assertRaises(pp.BadInput):
                env.step(action)
        for wrong in ({"action": "spoon"}, {"control_rate": 300}, {"envs": 0}, {"seconds": NAN}, {"start": [1, NAN, 2]}):
            with self.assertRaises(pp.BadInput):
                pp.Env(block(), **wrong).reset(seed=1)


class Verification(unittest.TestCase):
    def setUp(self):
        os.environ["PALPATE_PROGRAM"] = os.environ["PALPATE"]
        self.addCleanup(os.environ.pop, "PALPATE_PROGRAM")

    def test_figures_and_whether_their_limits_are_kept(self):
        figures = pp.verify("latency", seconds=0.05, rate=1000, scene=SCENE)
        self.assertIn(figures["kept"], (True, False))
        self.assertGreater(len(figures), 1)

    def test_errors_state_a_reason(self):
        with self.assertRaisesRegex(pp.BadInput, "spoon"):
            pp.verify("spoon")
        os.environ["PALPATE_PROGRAM"] = "/no/such/program"
        with self.assertRaisesRegex(pp.Unavailable, "PALPATE_PROGRAM"):
            pp.verify("contact")


class TwoLibraries(unittest.TestCase):
    def test_another_build_in_the_same_process_is_independent(self):
        with tempfile.TemporaryDirectory() as folder:
            # stripped, so that it is not the same file
            other = pathlib.Path(folder, "libpalpate.so.1")
            subprocess.run(["strip", "-o", other, c._find()], check=True)
            mine = {name: module for name, module in sys.modules.items() if name.split(".")[0] == "palpate"}
            library = os.environ["PALPATE_LIBRARY"]
            try:
                for name in mine:
                    del sys.modules[name]
                os.environ["PALPATE_LIBRARY"] = str(other)
                second = importlib.import_module("palpate")
            finally:
                os.environ["PALPATE_LIBRARY"] = library
                for name in [name for name in sys.modules if name.split(".")[0] == "palpate"]:
                    del sys.modules[name]
                sys.modules.update(mine)
            loaded = pathlib.Path("/proc/self/maps").read_text(encoding="utf-8")
            self.assertIn(str(other), loaded)
            self.assertIn(os.path.realpath(library), loaded)
            labels = block().labels()
            sessions = [package.Session(package.Model(labels, tissues={"bone": {"labels": 1}})) for package in (pp, second)]
            for tip in press(700):
                forces = [session.tick(tip)[0] for session in sessions]
                np.testing.assert_array_equal(*forces)
            self.assertEqual(sessions[0].hash, sessions[1].hash)
            self.assertGreater(forces[0][2], 1)
            # an error of one is not that of the other
            for package, session, dt in zip((pp, second), sessions, (-1.0, NAN)):
                with self.assertRaises(package.BadInput):
                    session.advance(dt)
            self.assertIn(b"-1", pp._library.lib.plp_last_error())
            self.assertIn(b"nan", second._library.lib.plp_last_error())


class Hostile(unittest.TestCase):
    def test_what_is_no_argument_is_an_exception(self):
        wrong = [
            lambda: pp.Model(np.zeros((2, 2)), tissues={}),
            lambda: pp.Model(np.zeros((2, 2, 2)), tissues={}),
            lambda: pp.Model(np.zeros((0, 2, 2), int), tissues={}),
            lambda: block(spacing=0), lambda: block(spacing=NAN), lambda: block(spacing=(1, 2)), lambda: block(direction=np.zeros((3, 3))),
            lambda: block(origin=(math.inf, 0, 0)), lambda: block(tissues={"bone": {"labels": 0}}),
            lambda: block(tissues={"bone": {"labels": 70000}}), lambda: block(tissues={"bone": {"labels": 1, "stiffness": NAN}}),
            lambda: block(tissues={"bone": {"labels": 1, "stiffness": -1}}), lambda: block(tissues={"a": {"labels": 1}, "b": {"labels": 1}}),
            lambda: block(tools=[pp.Tool(radius=-1)]), lambda: block(tools=[pp.Tool(points=[[NAN, 0, 0]])]),
            lambda: block(tools=[pp.Tool()] * 5), lambda: block(method="touch"),
            lambda: pp.Session(block(), devices=9), lambda: pp.Session(block(), frame="room"),
            lambda: pp.Session(block(), method="b-spline"), lambda: pp.Session(block(), max_force=NAN),
            lambda: block().cut([0, 0], 1), lambda: block().cut([0, 0, 0], NAN), lambda: block().sample([1, 2]),
            lambda: pp.load("no such scene"), lambda: pp.load(""), lambda: pp.read("nowhere.h5"),
            lambda: pp.simulate(block(), "[[step]]\npress = 'hard'\n"), lambda: pp.simulate(block(), seed=-1),
            lambda: pp.simulate(block(), rate=1), lambda: pp.Loop(block(), rate=1),
        ]
        for n, call in enumerate(wrong):
            with self.subTest(n):
                with self.assertRaises(pp.Error) as caught:
                    call()
                self.assertTrue(str(caught.exception))

    def test_random_numbers_never_end_the_interpreter(self):
        chance = random.Random(20261121)
        values = [0, -1, 1, NAN, math.inf, -math.inf, 1e300, 1e-300, 65536]
        for _ in range(150):
            pick = lambda usual: chance.choice(values) if chance.random() < 0.15 else usual
            try:
                model = block(spacing=[pick(1) for _ in range(3)], max_force=pick(3),
                              tissues={"bone": {"labels": 1, "stiffness": pick(1), "friction": pick(0.1)}},
                              tools=[pp.Tool(radius=pick(1), points=[[pick(0), 0, 0]])])
                session = pp.Session(model, max_force=abs(pick(3)))
                tips = press(100)
                tips[chance.randrange(100)] = pick(0)
                records = session.run(tips, dt=pick(1e-3))
            except (pp.Error, OverflowError):
                continue
            self.assertTrue(np.isfinite(records["force_world_N"]).all())

    def test_public_names_have_docstrings(self):
        for name in pp.__all__:
            thing = getattr(pp, name)
            if name == "METHODS":
                continue
            self.assertTrue(inspect.getdoc(thing), name)
            members = [m for m in vars(thing).items() if not m[0].startswith("_")] if inspect.isclass(thing) else []
            for member, value in members:
                function = value.fget if isinstance(value, property) else getattr(value, "__func__", value)
                if not inspect.isfunction(function):
                    continue
                self.assertTrue(function.__doc__, f"{name}.{member}")
                self.assertIn("return", typing.get_type_hints(function), f"{name}.{member}")


if __name__ == "__main__":
    unittest.main()
