#include "preparation/signed_distance.h"

#include <cmath>

#include "preparation/signed_distance_rows.h"
#include "preparation/surface_filter.h"
#include "preparation/surface_rows.h"

namespace palpate::internal {

namespace {

/// Squares of the distances to neighbours along an axis, as far as they are within reach.
AxisKernel squares(double spacing_mm, int count) {
  AxisKernel kernel;
  for (int t = 0; t <= count; ++t) {
    const double d = t * spacing_mm;
    kernel.weights.push_back(static_cast<float>(d * d));
  }
  return kernel;
}

}  // namespace

Index3 distance_window(const Eigen::Vector3d& spacing_mm, double reach_mm) {
  Index3 window;
  for (int a = 0; a < 3; ++a) window[a] = static_cast<int>(std::floor(reach_mm / spacing_mm[a]));
  return window;
}

void signed_distance(const Block<std::uint8_t>& mask, const Eigen::Vector3d& spacing_mm, double reach_mm,
                     Block<float>& distance) {
  const Index3 window = distance_window(spacing_mm, reach_mm);
  BlockKernel kernel;
  for (int a = 0; a < 3; ++a) kernel.axis[a] = squares(spacing_mm[a], window[a]);
  const auto far = static_cast<float>(reach_mm * reach_mm);

  const Span3& span = distance.span();
  const auto length = static_cast<std::size_t>(span.size(0));
  Block<float> start(mask.span()), squared(span);
  for (const std::uint8_t other : {std::uint8_t{0}, std::uint8_t{1}}) {
    // squared distance to the nearest voxel of class `other`
    std::transform(mask.values().begin(), mask.values().end(), start.values().begin(),
                   [=](std::uint8_t m) { return m == other ? 0.0f : far; });
    filter_block(start, kernel, least_of_rows, squared);
    const auto mine = static_cast<std::uint8_t>(1 - other);
    for_each_row(span, [&](int j, int k) {
      const std::uint8_t* m = mask.row(j, k) + (span.low[0] - mask.span().low[0]);
      roots_where(m, mine, squared.row(j, k), length, distance.row(j, k));
    });
  }
}

}  // namespace palpate::internal
