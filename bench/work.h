#pragma once

#include <vector>

#include "palpate/volume/volume.h"

/// The works that comparisons are made on.
namespace palpate::bench {

/// 256 x 256 x 124 voxels of 0.625 x 0.625 x 0.9 mm, those of the founding work.
GridGeometry founding_grid();

/// Two bones with rounded ends, 3 mm apart: what a segmented joint is to a filter.
Volume<std::uint8_t> two_bones();

/// `count` points on the rounded end of the first of the two bones, 0.05 mm from one to the next: a probe
/// that feels its way along.
std::vector<Point<Patient>> probe_path(std::size_t count);

/// `count` points anywhere in the founding grid, at least `margin` voxels from its border.
std::vector<Point<Patient>> random_points(std::size_t count, double margin);

}  // namespace palpate::bench
