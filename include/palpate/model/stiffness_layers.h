#pragma once

#include <vector>

#include "palpate/haptics/proxy.h"

namespace palpate {

/// Stiffnesses that contact feels as one layer where their structures touch.
struct StiffnessRange {
  double least_N_per_mm = 0, most_N_per_mm = 0;

  /// The largest relative error, 0 ... 1: the stiffest structure, covered by the softest, is felt as soft as
  /// that one.
  double error() const { return 1 - least_N_per_mm / most_N_per_mm; }
};

/// What differs by less is one layer: nobody feels it, and every layer is a surface to be made and a proxy.
inline constexpr double kSameStiffness = 1.05;

/// The layers of structures that touch (docs/decisions/0018-one-body-in-layers.md), softest first. Of more
/// than `most` those next to each other that differ least become one.
/// @param stiffnesses  N/mm, above 0, in any order
/// @param most         at least 1
std::vector<StiffnessRange> stiffness_layers(std::vector<double> stiffnesses, int most = kMostLayers);

}  // namespace palpate
