"""Voxel grids in the patient's frame."""

import itertools

import numpy as np

# RAS from LPS, and LPS from RAS
RAS_LPS = np.diag([-1.0, -1.0, 1.0])


class Grid:
    """A regular grid of voxels.

    dims       voxels along i, j, k
    steps_mm   3 x 3, RAS: column n is the displacement to the next voxel along axis n. Oblique, left-handed and
               anisotropic grids are allowed
    first_mm   centre of voxel (0, 0, 0), RAS
    """

    def __init__(self, dims, steps_mm, first_mm):
        self.dims = tuple(int(count) for count in dims)
        self.steps_mm = np.array(steps_mm, dtype=float).reshape(3, 3)
        self.first_mm = np.array(first_mm, dtype=float).reshape(3)

    @classmethod
    def from_ijk_to_ras(cls, dims, matrix):
        """@param matrix  4 x 4, RAS positions in mm from voxel indices"""
        matrix = np.asarray(matrix, dtype=float)
        return cls(dims, matrix[:3, :3], matrix[:3, 3])

    def ijk_to_ras(self):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.steps_mm, self.first_mm
        return matrix

    @property
    def shape(self):
        """Shape of the grid's voxel arrays: k, j, i."""
        return self.dims[::-1]

    def is_same(self, other, tolerance_mm=1e-3):
        """Whether corner voxels of both grids are at the same positions."""
        if self.dims != other.dims:
            return False
        corners = np.array(list(itertools.product(*((0, count - 1) for count in self.dims))))
        difference = corners @ (self.steps_mm - other.steps_mm).T + self.first_mm - other.first_mm
        return bool(np.abs(difference).max() <= tolerance_mm)
