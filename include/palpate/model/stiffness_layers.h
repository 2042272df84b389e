#pragma once

#include <vector>

#include "palpate/contact/proxy.h"

namespace palpate {

/// Range of stiffnesses that contact merges into one layer where their structures touch.
struct StiffnessRange {
  double min_N_per_mm = 0, max_N_per_mm = 0;

  /// Largest relative error, 0 ... 1: the stiffest structure, covered by the softest, is rendered with the
  /// softest one's stiffness.
  double error() const { return 1 - min_N_per_mm / max_N_per_mm; }
};

/// Ratio of stiffnesses below which structures share a layer: the difference is imperceptible, and every
/// layer costs a surface and a proxy.
inline constexpr double kSameStiffness = 1.05;

/// Layers of structures that touch (docs/decisions/0018-one-body-in-layers.md), softest first. If there are
/// more than `largest`, adjacent layers with the least resulting error are merged.
/// @param stiffnesses  N/mm, above 0, in any order
/// @param largest      at least 1
std::vector<StiffnessRange> stiffness_layers(std::vector<double> stiffnesses, int largest = kMaxLayers);

}  // namespace palpate
