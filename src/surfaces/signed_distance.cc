#include "surfaces/signed_distance.h"

#include <cmath>

#include "surfaces/signed_distance_rows.h"
#include "surfaces/surface_filter.h"
#include "surfaces/surface_rows.h"

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

void distance_to_class(const Block<std::uint8_t>& mask, std::uint8_t other, const Eigen::Vector3d& spacing_mm,
                       double reach_mm, Block<float>& distance) {
  const Index3 window = distance_window(spacing_mm, reach_mm);
  BlockKernel kernel;
  for (int a = 0; a < 3; ++a) kernel.axis[a] = squares(spacing_mm[a], window[a]);
  const auto far = static_cast<float>(reach_mm * reach_mm);

  // squared distance to the nearest voxel of class `other`; the mask may reach farther than is looked at
  const Span3& span = distance.span();
  const Span3 seen = span.grown(window);
  Block<float> start(seen), squared(span);
  const auto seen_length = static_cast<std::size_t>(seen.size(0));
  for_each_row(seen, [&](int j, int k) {
    const std::uint8_t* m = mask.row(j, k) + (seen.low[0] - mask.span().low[0]);
    std::transform(m, m + seen_length, start.row(j, k),
                   [=](std::uint8_t here) { return here == other ? 0.0f : far; });
  });
  filter_block(start, kernel, least_of_rows, squared);

  const auto mine = static_cast<std::uint8_t>(1 - other);
  const auto length = static_cast<std::size_t>(span.size(0));
  for_each_row(span, [&](int j, int k) {
    const std::uint8_t* m = mask.row(j, k) + (span.low[0] - mask.span().low[0]);
    roots_where(m, mine, squared.row(j, k), length, distance.row(j, k));
  });
}

void signed_distance(const Block<std::uint8_t>& mask, const Eigen::Vector3d& spacing_mm, double reach_mm,
                     Block<float>& distance) {
  for (const std::uint8_t other : {std::uint8_t{0}, std::uint8_t{1}})
    distance_to_class(mask, other, spacing_mm, reach_mm, distance);
}

}  // namespace palpate::internal
