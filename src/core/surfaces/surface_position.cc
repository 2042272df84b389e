#include "surfaces/surface_position.h"

#include <cmath>

#include "surfaces/signed_distance_rows.h"
#include "surfaces/surface_rows.h"

namespace palpate::internal {

namespace {

constexpr double kWiden_mm = 0.5, kSoften_mm = 0.25;
/// Fraction of its distance by which a voxel is held on its side, and also the fraction on the wrong side at
/// which it is held completely. With one value h for both, a voxel at -x is moved by x / h of the way to h:
/// -x + x (x + h) / h = x^2 / h, which is never on the wrong side.
constexpr float kHeld = 0.25f;

BlockKernel whole_voxels_within(const Eigen::Vector3d& spacing_mm, double radius_mm) {
  BlockKernel kernel;
  for (int a = 0; a < 3; ++a) {
    const int radius = std::max(1, static_cast<int>(std::lround(radius_mm / spacing_mm[a])));
    kernel.axis[a].weights.assign(static_cast<std::size_t>(radius) + 1, 0.0f);
  }
  return kernel;
}

Index3 sum(const Index3& a, const Index3& b) {
  return {a[0] + b[0], a[1] + b[1], a[2] + b[2]};
}

/// Distance on the wrong side, negated so that min_of_rows finds the maximum. Returns false if there is
/// none.
bool negated_wrong(const Block<float>& distance, const Block<float>& smooth, Block<float>& wrong) {
  const auto length = static_cast<std::size_t>(wrong.span().size(0));
  const int shift = wrong.span().low[0] - distance.span().low[0];
  bool any = false;
  for_each_row(wrong.span(), [&](int j, int k) {
    const bool here =
        wrong_side(distance.row(j, k) + shift, smooth.row(j, k), kHeld, length, wrong.row(j, k));
    any = any || here;
  });
  return any;
}

}  // namespace

PositionFilter::PositionFilter(const Eigen::Vector3d& spacing_mm, double sigma_mm)
    : smooth(quadratic_block_kernel(spacing_mm, sigma_mm)),
      widen(whole_voxels_within(spacing_mm, kWiden_mm)),
      soften(gaussian_block_kernel(spacing_mm, kSoften_mm)) {}

Index3 PositionFilter::reach() const {
  return sum(smooth.reach(), sum(widen.reach(), soften.reach()));
}

void PositionFilter::apply(const Block<float>& distance, Block<std::int16_t>& position) const {
  const Span3& span = position.span();
  const Span3 softened = span.grown(soften.reach()), widened = softened.grown(widen.reach());

  Block<float> smoothed(widened);
  filter_block(distance, smooth, smoothed);

  // weights where labels must be enforced; hardly any on a bone
  Block<float> wrong(widened), preserve(span, 0);
  if (negated_wrong(distance, smoothed, wrong)) {
    Block<float> worst(softened);
    filter_block(wrong, widen, min_of_rows, worst);
    filter_block(worst, soften, preserve);
  }

  const auto length = static_cast<std::size_t>(span.size(0));
  const int to_distance = span.low[0] - distance.span().low[0], to_smooth = span.low[0] - widened.low[0];
  for_each_row(span, [&](int j, int k) {
    const PositionRows rows{distance.row(j, k) + to_distance, smoothed.row(j, k) + to_smooth,
                            wrong.row(j, k) + to_smooth, preserve.row(j, k)};
    hold_position(rows, kHeld, length, position.row(j, k));
  });
}

}  // namespace palpate::internal
