#pragma once

#include <algorithm>
#include <array>

#include "palpate/geometry/geometry.h"

namespace palpate {

/// Cell that contains a point, and the point's relative position in it, for trilinear interpolation.
struct TrilinearWeights {
  int low[3];
  double part[3];

  /// @param last  index of the last node, or of the last cell if values are at cell centres
  TrilinearWeights(const Eigen::Vector3d& at, const std::array<int, 3>& last) {
    for (int axis = 0; axis < 3; ++axis) {
      const double within = std::clamp(at[axis], 0.0, static_cast<double>(last[axis]));
      low[axis] = std::min(static_cast<int>(within), std::max(last[axis] - 1, 0));
      part[axis] = within - low[axis];
    }
  }
  /// Calls visit(i, j, k, weight) for the corners with a weight above 0.
  template <class Visit>
  void corners(Visit&& visit) const {
    for (int c = 0; c < 8; ++c) {
      double weight = 1;
      int at[3];
      for (int axis = 0; axis < 3; ++axis) {
        const int up = (c >> axis) & 1;
        at[axis] = low[axis] + up;
        weight *= up != 0 ? part[axis] : 1 - part[axis];
      }
      if (weight > 0) visit(at[0], at[1], at[2], weight);
    }
  }
};

}  // namespace palpate
