"""Self-test of the module, run by Slicer's build (BUILD_TESTING), and by palpate's with a stand-in for Slicer."""

import shutil
import time
import unittest

import numpy as np
import slicer
from PalpateLib import scene
from PalpateLib.grid import Grid
from PalpateLib.logic import SceneSession

NAMES = {3: ("femur", (0.9, 0.8, 0.7)), 7: ("tibia", (0.7, 0.8, 0.9))}


def oblique_grid(dims):
    """A grid with turned axes and three different spacings."""
    turn, _ = np.linalg.qr(np.array([[1.0, 0.2, -0.3], [-0.1, 1.0, 0.4], [0.25, -0.35, 1.0]]))
    return Grid(dims, turn * np.array([0.7, 1.1, 1.6]), [12.5, -30.25, 41.0])


def two_blocks():
    """A scan, and a segmentation of two blocks that touch. @returns (volume, segmentation, grid, voxels)"""
    grid = oblique_grid((30, 24, 20))
    voxels = np.zeros(grid.shape, dtype=np.uint16)
    voxels[4:10, 4:20, 5:25], voxels[10:16, 4:20, 5:25] = 3, 7
    segmentation, _, _ = scene.new_segmentation(grid, voxels, NAMES, "Blocks")
    volume = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLScalarVolumeNode", "Scan")
    volume.SetIJKToRASMatrix(slicer.util.vtkMatrixFromArray(grid.ijk_to_ras()))
    slicer.util.updateVolumeFromArray(volume, np.where(voxels != 0, 1000, 0).astype(np.int16))
    return volume, segmentation, grid, voxels


class PalpateSelfTest(unittest.TestCase):
    def setUp(self):
        slicer.mrmlScene.Clear(0)

    def test_labels_of_a_segmentation_are_those_it_was_made_of(self):
        volume, segmentation, grid, voxels = two_blocks()
        labels = scene.labels_of(segmentation, volume)
        self.assertEqual([(segment.label, segment.name) for segment in labels.segments], [(3, "femur"), (7, "tibia")])
        self.assertTrue(labels.grid.is_same(grid))
        self.assertEqual(len(labels.layers), 1)
        self.assertTrue((labels.layers[0] == voxels).all())

    def test_palpate_serves_them(self):
        session, joined = SceneSession(), SceneSession()
        if shutil.which("palpate") is None:
            self.skipTest("palpate is not installed")
        volume, segmentation, _, voxels = two_blocks()
        try:
            session.start(volume, segmentation)
            joined.attach("127.0.0.1", session._session.port)
            until = time.monotonic() + 60
            while joined.segmentation is None and time.monotonic() < until:
                joined.poll()
                slicer.app.processEvents()
            labels = scene.labels_of(joined.segmentation, volume)
            self.assertTrue((labels.layers[0] == voxels).all())
        finally:
            joined.stop()
            session.stop()


if __name__ == "__main__":
    unittest.main()
