#!/usr/bin/env python3
"""What rigid tools of several parts press on an elastic half space with E* = 1, and what one sphere would.

Cells of 0.15 mm, each with an even pressure (Love 1929; Johnson 1985, 3.25); pressures not below 0 by constrained
conjugate gradients (Polonsky & Keer 1999). A sphere is its paraboloid. The figures stand in
src/core/contact/footprint_test.cc. Takes a minute; needs numpy.
"""

import numpy

CELL_MM = 0.15


def sinks_by(half, x, y):
    """Displacement at (x, y) under a uniform pressure of 1 on a square of half edge `half` at the origin, times pi E*
    (Love 1929)."""
    def reach(a, b):
        return numpy.hypot(a, b)
    east, west, north, south = x + half, x - half, y + half, y - half
    return (
        east * numpy.log((north + reach(north, east)) / (south + reach(south, east)))
        + north * numpy.log((east + reach(north, east)) / (west + reach(north, west)))
        + west * numpy.log((south + reach(south, west)) / (north + reach(north, west)))
        + south * numpy.log((west + reach(south, west)) / (east + reach(south, east)))
    )


def force(depth_at, xs, ys):
    """Force on a rigid tool, N for E* = 1 N/mm2. @param depth_at  penetration of the undeformed surface at (x, y), mm
    """
    depth = depth_at(*numpy.meshgrid(xs, ys, indexing="ij"))
    rows, columns = depth.shape
    away_x, away_y = numpy.arange(-rows, rows) * CELL_MM, numpy.arange(-columns, columns) * CELL_MM
    kernel = sinks_by(CELL_MM / 2, away_x[:, None], away_y[None, :]) / numpy.pi
    kernel = numpy.fft.rfft2(numpy.fft.ifftshift(kernel))

    def sunk(pressure):
        padded = numpy.zeros((2 * rows, 2 * columns))
        padded[:rows, :columns] = pressure
        return numpy.fft.irfft2(numpy.fft.rfft2(padded) * kernel, s=padded.shape)[:rows, :columns]

    pressure = numpy.where(depth > 0, 1.0, 0.0)
    way, goes_on, last = numpy.zeros_like(pressure), 0, 1
    for _ in range(3000):
        gap = sunk(pressure) - depth
        touches = pressure > 0
        square = (gap[touches] ** 2).sum()
        way = numpy.where(touches, gap + goes_on * square / last * way, 0)
        last = square
        change = sunk(way)
        step = (gap[touches] * way[touches]).sum() / (change[touches] * way[touches]).sum()
        before = pressure.copy()
        pressure = numpy.maximum(pressure - step * way, 0)
        overlaps = (pressure == 0) & (gap < 0)
        goes_on = 0 if overlaps.any() else 1
        pressure[overlaps] -= step * gap[overlaps]
        if abs(pressure - before).sum() < 1e-8 * pressure.sum():
            break
    return pressure.sum() * CELL_MM**2


def told(what, radius, depth, truth):
    one = 4 / 3 * radius**0.5 * depth**1.5
    print(f"{what}: {truth:.3f} N, of one sphere {one:.3f} ({100 * (one / truth - 1):+.0f} %)")


def two_spheres(radius, apart, depth, higher=0):
    xs = numpy.arange(-apart / 2 - 2.2 * radius, apart / 2 + 2.2 * radius, CELL_MM)
    ys = numpy.arange(-2.2 * radius, 2.2 * radius, CELL_MM)

    def depth_at(x, y):
        one, other = ((x - at) ** 2 + y**2 for at in (-apart / 2, apart / 2))
        return numpy.maximum(depth - one / (2 * radius), depth - higher - other / (2 * radius))

    told(f"two spheres of {radius} mm, {apart} mm apart, {depth} mm deep, one {higher} mm higher", radius, depth, force(depth_at, xs, ys))


def shaft(radius, length, depth):
    xs = numpy.arange(-2.5 * radius, length + 2.5 * radius, CELL_MM)
    ys = numpy.arange(-2.5 * radius, 2.5 * radius, CELL_MM)

    def depth_at(x, y):
        return depth - ((x - numpy.clip(x, 0, length)) ** 2 + y**2) / (2 * radius)

    told(f"a shaft of {radius} mm, {length} mm long, {depth} mm deep", radius, depth, force(depth_at, xs, ys))


two_spheres(3, 1e-9, 1)
for apart_mm in (2, 4, 8, 12):
    two_spheres(3, apart_mm, 2)
two_spheres(3, 8, 2, 1)
for sizes in ((2, 20, 0.3), (2, 20, 1), (2, 20, 2), (1, 20, 1), (5, 30, 2), (2, 5, 1), (1, 40, 1)):
    shaft(*sizes)
