"""Rotations and poses of tracked tools, and landmarks of a knee, for the tests of registration and tracking."""

import math

# landmarks in the patient, LPS, mm
POINTS = {"medial": (30, -10, 5), "lateral": (-32, -8, 2), "tuberosity": (4, -38, -60), "patella": (0, -52, 20), "fibula": (-38, 22, -40)}


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


def composed(a, b):
    """Of poses, each a rotation and a shift: what b does first."""
    return [[sum(a[0][r][k] * b[0][k][c] for k in range(3)) for c in range(3)] for r in range(3)], at(a, b[1])


def at(pose, p):
    return [x + s for x, s in zip(times(pose[0], p), pose[1])]
