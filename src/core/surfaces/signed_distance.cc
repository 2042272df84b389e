#include "surfaces/signed_distance.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "surfaces/signed_distance_rows.h"
#include "surfaces/surface_filter.h"
#include "surfaces/surface_rows.h"

namespace palpate::internal {

namespace {

/// Kernel of squared distances to the neighbours along an axis within reach.
AxisKernel squares(double spacing_mm, int count) {
  AxisKernel kernel;
  for (int t = 0; t <= count; ++t) {
    const double d = t * spacing_mm;
    kernel.weights.push_back(static_cast<float>(d * d));
  }
  return kernel;
}

/// Squared distance along k to the nearest voxel of class `other`, at most `far`. First axis of the
/// transform, on which the mask is counted from below and from above.
/// @param mask  covers `squared` and the reach along k; may be larger
void nearest_along_k(const Block<std::uint8_t>& mask, std::uint8_t other, const AxisKernel& squares_mm2,
                     float far, Block<float>& squared) {
  const Span3& span = squared.span();
  const int window = squares_mm2.radius(), length = span.size(0);
  std::vector<float> of_steps(squares_mm2.weights);
  for (float& one : of_steps) one = std::min(one, far);
  of_steps.push_back(far);
  const auto most = static_cast<float>(window + 1);
  // number of steps since the last voxel of that class, for every column
  const auto rows = static_cast<std::size_t>(span.size(1)), columns = static_cast<std::size_t>(length);
  std::vector<float> steps(rows * columns, most);
  const auto follow = [&](int j, int k) {
    const std::uint8_t* m = mask.row(j, k) + (span.low[0] - mask.span().low[0]);
    float* const here = steps.data() + columns * static_cast<std::size_t>(j - span.low[1]);
    for (int i = 0; i < length; ++i) here[i] = m[i] == other ? 0.0f : std::min(here[i] + 1, most);
    return here;
  };
  for (int k = span.low[2] - window; k < span.high[2]; ++k)
    for (int j = span.low[1]; j < span.high[1]; ++j) {
      const float* const here = follow(j, k);
      if (k >= span.low[2]) std::copy_n(here, length, squared.row(j, k));
    }
  std::fill(steps.begin(), steps.end(), most);
  for (int k = span.high[2] - 1 + window; k >= span.low[2]; --k)
    for (int j = span.low[1]; j < span.high[1]; ++j) {
      const float* const here = follow(j, k);
      if (k >= span.high[2]) continue;
      float* const to = squared.row(j, k);
      for (int i = 0; i < length; ++i) to[i] = of_steps[static_cast<std::size_t>(std::min(to[i], here[i]))];
    }
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

  const Span3& span = distance.span();
  Block<float> nearest(span.grown({window[0], window[1], 0})), squared(span);
  nearest_along_k(mask, other, kernel.axis[2], far, nearest);
  filter_slices(nearest, kernel, min_of_rows, squared);

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
