#pragma once

#include <vector>

#include "palpate/volume/volume.h"

/// Workloads of the comparisons.
namespace palpate::bench {

/// 256 x 256 x 124 voxels of 0.625 x 0.625 x 0.9 mm, as in the original publication.
GridGeometry founding_grid();

/// Two bones with rounded ends, 3 mm apart, which is a hard case for a filter, like a segmented joint.
Volume<std::uint8_t> two_bones();

/// `count` points on the rounded end of the first of the two bones, spaced 0.05 mm: the path of a probe.
std::vector<Point<Patient>> probe_path(std::size_t count);

/// `count` random points in the founding grid, at least `margin` voxels from its boundary.
std::vector<Point<Patient>> random_points(std::size_t count, double margin);

}  // namespace palpate::bench
