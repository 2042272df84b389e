"""The module of 3D Slicer, in front of a stand-in for Slicer: a segmentation goes to palpate and back, a cut comes into the scene,
lines become a plan."""

import itertools
import json
import os
import pathlib
import re
import struct
import sys
import threading
import time
import unittest
import xml.etree.ElementTree

import cli

try:
    import numpy as np
except ImportError:
    cli.missing("NumPy for this Python")

import slicer_stub
import tick_stream

MODULE = pathlib.Path(__file__).resolve().parents[2] / "slicer/Palpate"
sys.path[:0] = [str(MODULE), str(MODULE / "Testing/Python")]
STUB = slicer_stub.install()

from PalpateLib import nrrd, openigtlink, program, scene
from PalpateLib.errors import PalpateError
from PalpateLib.grid import Grid
from PalpateLib.labels import Labels, Removal
from PalpateLib.logic import SceneSession
from PalpateSelfTest import PalpateSelfTest, oblique_grid, two_blocks  # noqa: F401: unittest finds the first one here

os.environ["PATH"] = f"{pathlib.Path(cli.PALPATE).parent}:{os.environ['PATH']}"
LPS = np.diag([-1.0, -1.0, 1.0])
MILL = ("[[step]]\napproach = 'femur'\nspeed = 200.0\n[[step]]\nmotor = true\n[[step]]\npress = 1.0\n[[step]]\nhold = 1.0\n"
        "[[step]]\nmotor = false\n[[step]]\nleave = true\n")
PATIENCE_S = 120


def until(happened, what):
    end = time.monotonic() + PATIENCE_S
    while not happened():
        if time.monotonic() > end:
            raise AssertionError(what)
        time.sleep(0.005)


class SlicerTest(cli.PalpateTest):
    def setUp(self):
        super().setUp()
        STUB.Clear(0)

    def session(self):
        session = SceneSession()
        self.addCleanup(session.stop)
        return session

    def joined(self, started):
        """A session of its own that has joined a started one, and has its labels."""
        session = self.session()
        session.attach("127.0.0.1", started._session.port)
        until(lambda: session.poll() and session.segmentation, "no labels come")
        return session

    def test_a_segmentation_goes_to_palpate_and_back(self):
        volume, segmentation, grid, voxels = two_blocks()
        # a label that LBMETA cannot name
        identifier = segmentation.AddEmptySegment("Own", "patella", (0.1, 0.2, 0.3))
        segmentation.GetSegment(identifier).SetTag(scene.LABEL_TAG, "300")
        voxels[2, 3:9, 3:9] = 300
        segmentation.GetSegment(identifier).mask = (voxels == 300).astype(np.uint8)
        first = self.session()
        first.start(volume, segmentation)
        self.assertRegex(first.page, r"^http://127\.0\.0\.1:\d+/$")
        there = self.joined(first)
        names = {"femur": 3, "tibia": 7, "label 300": 300}
        labels = there._labels
        self.assertEqual({segment.name: segment.label for segment in labels.segments}, names)
        self.assertTrue((labels.layers[0] == voxels).all())
        # the message has 32-bit positions
        self.assertTrue(labels.grid.is_same(grid, 1e-4))

        # and once more, from what came
        second = self.session()
        second.start(there._volume, there.segmentation)
        again = self.joined(second)._labels
        self.assertEqual({segment.name: segment.label for segment in again.segments}, names)
        self.assertTrue((again.layers[0] == voxels).all())
        self.assertTrue(again.grid.is_same(grid, 2e-4))

    def test_files_have_the_geometry_and_the_names_exactly(self):
        rng = np.random.default_rng(5)
        for flip in (1, -1):
            turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
            grid = Grid((5, 4, 3), turn * [0.5, 1.25, flip * 3], rng.normal(size=3) * 100)
            a = rng.random(grid.shape) < 0.5
            b = ~a & (rng.random(grid.shape) < 0.8)
            labels = Labels.from_masks(grid, [("A", "Gallbladder ä", (1, 0, 0), 9, a), ("B", "b", (0, 1, 0), None, b),
                                              ("C", "over both", (0, 0, 1), 9, np.ones(grid.shape, bool))])
            self.assertEqual([(segment.label, segment.layer) for segment in labels.segments], [(9, 0), (1, 0), (2, 1)])
            file = self.folder / "labels.seg.nrrd"
            nrrd.write_segmentation(file, grid, labels)
            info = json.loads(self.succeed("info", file, "--json").stdout)
            self.assertEqual(info["dims"], [5, 4, 3])
            np.testing.assert_allclose(info["origin_lps_mm"], LPS @ grid.first_mm, rtol=1e-12)
            np.testing.assert_allclose(np.array(info["direction_rows"]) * info["spacing_mm"], LPS @ grid.steps_mm, atol=1e-12)
            self.assertEqual(info["layers"], 2)
            self.assertEqual({(s["id"], s["name"]) for s in info["labels"]}, {(9, "Gallbladder ä"), (1, "b"), (2, "over both")})

    def test_a_cut_comes_into_every_segment_and_an_undone_one_leaves(self):
        grid = Grid((3, 2, 2), np.eye(3), [0, 0, 0])
        whole, part = np.ones(grid.shape, bool), np.zeros(grid.shape, bool)
        part[0, 0] = True
        removal = Removal(Labels.from_masks(grid, [("A", "organ", (1, 1, 1), 1, whole), ("B", "tumour", (1, 1, 1), 2, part)]))
        served = np.ones(grid.shape, np.uint16)
        served[0, 0] = 2
        self.assertEqual(removal.update(served), [])
        cut = served.copy()
        cut[0, 0, 1] = cut[1, 1, 2] = 0
        masks = {segment.name: mask for segment, mask in removal.update(cut)}
        self.assertTrue((masks["organ"] == (cut != 0)).all())
        self.assertTrue((masks["tumour"] == (part & (cut != 0))).all())
        self.assertEqual(removal.removed_voxels, 2)
        cut[0, 0, 1] = 2
        self.assertEqual(sorted(segment.name for segment, _ in removal.update(cut)), ["organ", "tumour"])
        self.assertEqual(removal.removed_voxels, 1)

    @cli.long
    def test_a_burr_cuts_the_segmentation_where_the_probe_is(self):
        volume, segmentation, grid, voxels = two_blocks()
        script = self.folder / "mill.toml"
        script.write_text(MILL)
        session = self.session()
        session.start(volume, segmentation, device="simulated", burr_mm=4, arguments=["--script", script])
        changed = set()

        def ended():
            try:
                changed.update(session.poll())
            except PalpateError:
                return True
            return False
        until(ended, "the script does not end")
        self.assertIn("femur", changed)
        masks = {segment.name: segment.mask != 0 for segment in segmentation.segments.values()}
        removed = (voxels != 0) & ~masks["femur"] & ~masks["tibia"]
        self.assertEqual(int(removed.sum()), session.removed_voxels)
        self.assertGreater(session.removed_voxels, 3)
        self.assertFalse((masks["femur"] & (voxels != 3)).any())
        # where the probe was: within the burr's radius, and what it pressed in
        indices = np.argwhere(removed)[:, ::-1]
        centres = indices @ grid.steps_mm.T + grid.first_mm
        tips = np.array(STUB.tips)
        nearest = np.sqrt(((centres[:, None] - tips[None]) ** 2).sum(axis=2).min(axis=1))
        self.assertLess(nearest.max(), 2 + 1.5)
        # the decorations, and slices that follow
        self.assertIs(STUB.GetFirstNodeByName(scene.PROBE_MODEL).parent, STUB.GetFirstNodeByName(scene.PROBE))
        self.assertEqual(STUB.GetFirstNodeByName(scene.ARROW).GetDisplayNode().width, 5)
        self.assertGreater(len(STUB.jumps), 10)
        session.stop()
        self.assertFalse(session.is_active)
        # only what Slicer had before is left
        self.assertEqual([node.GetName() for node in STUB.nodes], ["Blocks labels", "Blocks", "Scan"])

    @cli.long
    def test_a_cut_is_soon_in_the_segmentation(self):
        """Prints the time from a cut's message to a viewer until the segmentation lacks the voxel."""
        made = self.folder / "knee"
        voxel_mm = os.environ.get("PALPATE_TEST_VOXEL_MM", "1.5")
        self.succeed("data", "fetch", "knee-phantom", "-o", made, "--voxel", voxel_mm)
        labels_file = next(made.glob("*.seg.nrrd"))
        scan_file = next(path for path in made.glob("*.n*") if "seg" not in path.name)
        scene_file, script = self.folder / "scene.toml", self.folder / "mill.toml"
        self.succeed("scene", "new", scan_file, labels_file, "-o", scene_file)
        with open(scene_file, "a", encoding="utf-8") as file:
            file.write('\n[tool]\nkind = "burr"\ndiameter = 4.0\n')
        script.write_text(MILL.replace("hold = 1.0", "hold = 0.8") * 3)
        started = program.Session(cli.PALPATE, [scene_file, "--port", "0", "--script", script])
        self.addCleanup(started.end)
        session = self.session()
        session.attach("127.0.0.1", started.port)
        until(lambda: session.poll() and session.segmentation, "no labels come")
        grid, before = session._labels.grid, session._labels.occupied()
        # time at which each voxel is cut, and at which it is missing here; kji
        cut_s, missing_s = np.full(grid.shape, np.inf), np.full(grid.shape, np.inf)
        ijk_from_lps = np.linalg.inv(LPS @ grid.steps_mm)
        first_lps = LPS @ grid.first_mm
        viewer = tick_stream.TickViewer(int(started.page.rsplit(":", 1)[1].strip("/")), poses_hz=120)
        self.addCleanup(viewer.close)

        def note_cut(sweep):
            begin, end, radius = np.array(sweep[:3]), np.array(sweep[3:6]), sweep[6]
            corners = [ijk_from_lps @ (point + offset - first_lps) for point in (begin, end)
                       for offset in radius * np.array(list(itertools.product((-1, 1), repeat=3)))]
            low = np.maximum(np.floor(np.min(corners, axis=0)).astype(int), 0)
            high = np.minimum(np.ceil(np.max(corners, axis=0)).astype(int) + 1, grid.dims)
            indices = np.array(list(itertools.product(*map(range, low, high)))).reshape(-1, 3)
            centres = indices @ (LPS @ grid.steps_mm).T + first_lps
            along = end - begin
            part = np.clip((centres - begin) @ along / max(along @ along, 1e-12), 0, 1)
            inside = indices[np.linalg.norm(centres - begin - part[:, None] * along, axis=1) < radius]
            at = tuple(inside[:, ::-1].T)
            cut_s[at] = np.minimum(cut_s[at], time.monotonic())

        def read_cuts():
            try:
                while True:
                    opcode, data = viewer.receive()
                    if opcode == 8:
                        return
                    if opcode == 1 and (message := json.loads(data))["type"] == "cut":
                        for sweep in message["sweeps"]:
                            note_cut(sweep)
            except (OSError, IndexError, ValueError):
                return  # the session has ended
        thread = threading.Thread(target=read_cuts, daemon=True)
        thread.start()
        ended = False
        while not ended:
            # as Slicer's timer
            time.sleep(0.03)
            try:
                session.poll()
            except PalpateError:
                ended = True
            masks = [segment.mask for segment in session.segmentation.segments.values()]
            gone = before & np.logical_and.reduce([mask == 0 for mask in masks])
            missing_s[gone & np.isinf(missing_s)] = time.monotonic()
        thread.join()
        # those that are not under the burr have been cut loose
        both = np.isfinite(cut_s) & np.isfinite(missing_s)
        self.assertGreater(both.sum(), 5)
        # what is cut is missing
        self.assertEqual(int((np.isfinite(cut_s) & before & np.isinf(missing_s)).sum()), 0)
        late_ms = 1e3 * (missing_s[both] - cut_s[both])
        print(f"{before.size} voxels, {both.sum()} of them cut: median {np.median(late_ms):.0f} ms, "
              f"95 % {np.percentile(late_ms, 95):.0f} ms, largest {late_ms.max():.0f} ms, load {os.getloadavg()[0]:.1f}")

    def test_lines_become_a_plan(self):
        volume, segmentation, grid, _ = two_blocks()
        scan, labels, scene_file, plan = (self.folder / name for name in ("scan.nrrd", "labels.seg.nrrd", "scene.toml", "plan.toml"))
        nrrd.write_scan(scan, *scene.scan_of(volume))
        nrrd.write_segmentation(labels, grid, scene.labels_of(segmentation, volume))
        self.succeed("scene", "new", "--scan", scan, "--labels", labels, "-o", scene_file)
        line = STUB.AddNewNodeByClass("vtkMRMLMarkupsLineNode", 'To the "tibia"\n')
        # along k through both blocks, from outside to the middle of the second one
        line.points = [grid.steps_mm @ ijk + grid.first_mm for ijk in ([15, 12, 1.5], [15, 12, 12.5])]
        session = self.session()
        session.write_plan([line, line], plan)
        shown = self.succeed("plan", "show", plan, "--scene", scene_file).stdout
        # six slices of 1.6 mm, then three
        self.assertRegex(shown, r"passes through .*femur 9\.\d mm, tibia 4\.\d mm")
        self.assertEqual(shown.count("depth           17.60 mm"), 2)
        for bad, says in [([], "no line is chosen"), ([[0, 0, 0]], "1 points")]:
            line.points = bad
            with self.assertRaisesRegex(PalpateError, says):
                session.write_plan([line] if bad else [], plan)

    def test_faults_are_told(self):
        volume, segmentation, _, _ = two_blocks()
        session = self.session()
        bent = STUB.AddNewNodeByClass("vtkMRMLLinearTransformNode", "Bent")
        segmentation.parent = bent
        with self.assertRaisesRegex(PalpateError, "under another transform"):
            session.start(volume, segmentation)
        volume.parent, bent.linear = bent, False
        with self.assertRaisesRegex(PalpateError, "not linear"):
            session.start(volume, segmentation)
        volume.parent = segmentation.parent = None
        with self.assertRaisesRegex(PalpateError, "is no program"):
            session.start(volume, segmentation, path="/nowhere/palpate")
        with self.assertRaisesRegex(PalpateError, "no device"):
            session.start(volume, segmentation, device="hammer")
        with self.assertRaisesRegex(PalpateError, "cannot be reached"):
            session.attach("127.0.0.1", 1)
        self.assertFalse(session.is_active)
        session.start(volume, segmentation)
        with self.assertRaisesRegex(PalpateError, "is active"):
            session.attach("127.0.0.1", 1)
        # a joined session whose palpate ends
        there = self.joined(session)
        session.stop()

        def is_told():
            try:
                there.poll()
            except PalpateError as error:
                return "has ended" in str(error)
            return False
        until(is_told, "the end is not told")

    def test_a_transform_above_both_moves_them(self):
        volume, segmentation, grid, _ = two_blocks()
        moved = STUB.AddNewNodeByClass("vtkMRMLLinearTransformNode", "Moved")
        moved.matrix[:3] = np.hstack([oblique_grid((2, 2, 2)).steps_mm, [[1], [2], [3]]])
        volume.parent = segmentation.parent = moved
        np.testing.assert_allclose(scene.labels_of(segmentation, volume).grid.ijk_to_ras(), moved.matrix @ grid.ijk_to_ras(), atol=1e-12)

    def test_images_of_another_kind_are_refused(self):
        grid, voxels = Grid((2, 2, 2), np.eye(3), [0, 0, 0]), np.arange(8, dtype="<u2")
        fields = [1, 1, 5, 2, 1, *grid.dims, *np.eye(3).T.ravel(), 0.5, 0.5, 0.5, 0, 0, 0, *grid.dims]
        body = openigtlink.IMAGE_HEAD.pack(*fields) + voxels.tobytes()
        found, first, read = openigtlink.parse_image(body)
        self.assertTrue(found.is_same(grid))
        self.assertEqual(first, (0, 0, 0))
        self.assertTrue((read.ravel() == voxels).all())
        for n, other in [(1, 2), (2, 10), (3, 1), (4, 2)]:
            with self.assertRaises(ValueError):
                openigtlink.parse_image(openigtlink.IMAGE_HEAD.pack(*[*fields[:n], other, *fields[n + 1:]]) + voxels.tobytes())
        with self.assertRaises(ValueError):
            openigtlink.parse_image(body[:-1])
        # a box of it
        fields[20:26] = [1, 0, 1, 1, 2, 1]
        found, first, read = openigtlink.parse_image(openigtlink.IMAGE_HEAD.pack(*fields) + voxels[:2].tobytes())
        self.assertTrue(found.is_same(grid))
        self.assertEqual((first, read.shape), ((1, 0, 1), (1, 2, 1)))
        fields[20] = 2
        with self.assertRaises(ValueError):
            openigtlink.parse_image(openigtlink.IMAGE_HEAD.pack(*fields) + voxels[:2].tobytes())

    def test_damaged_messages_are_refused_and_nothing_else_happens(self):
        seed = int.from_bytes(os.urandom(4), "big") if os.environ.get("PALPATE_TEST_SEED") == "any" else 11
        rng = np.random.default_rng(seed)
        fields = [1, 1, 5, 2, 1, 3, 2, 2, *np.eye(3).T.ravel(), 0.5, 0.5, 0.5, 0, 0, 0, 3, 2, 2]
        image = openigtlink.IMAGE_HEAD.pack(*fields) + bytes(24)
        listed = openigtlink.LISTED_LABEL.pack(b"femur", b"Labels", 3, 0, 1, 2, 3, 255, 3, 2, 2, b"")
        refused = 0
        for n in range(3000):
            body = bytearray((image, 2 * listed)[n % 2])
            for _ in range(rng.integers(1, 5)):
                body[rng.integers(len(body))] = rng.integers(256)
            body = body[:rng.integers(len(body) + 1)] if n % 5 == 0 else body
            try:
                if n % 2:
                    self.assertLessEqual(len(openigtlink.parse_label_list(body)), 2)
                else:
                    grid, first, part = openigtlink.parse_image(body)
                    ends = [begin + count for begin, count in zip(first, part.shape[::-1])]
                    self.assertTrue(all(end <= whole for end, whole in zip(ends, grid.dims)))
            except (ValueError, struct.error):
                # what ends the connection, LabelsClient._receive()
                refused += 1
        self.assertGreater(refused, 300, f"seed {seed}")

    def test_the_extension_is_complete(self):
        used = set(re.findall(r"self\.ui\.(\w+)", (MODULE / "Palpate.py").read_text()))
        form = xml.etree.ElementTree.parse(MODULE / "Resources/UI/Palpate.ui")
        self.assertEqual(used - {widget.get("name") for widget in form.iter("widget")}, set())
        listed = (MODULE / "CMakeLists.txt").read_text()
        for file in (MODULE / "PalpateLib").glob("*.py"):
            self.assertIn(f"PalpateLib/{file.name}", listed)
        compile((MODULE / "Palpate.py").read_text(), "Palpate.py", "exec")


if __name__ == "__main__":
    unittest.TestCase.maxDiff = None
    cli.main()
