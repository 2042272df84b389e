#include "surfaces/surface_normal.h"

#include <cmath>

#include "surfaces/surface_rows.h"

namespace palpate::internal {

namespace {

/// Width of the mean over the nearby surface. Heights are defined within its radius and vary slowly with
/// distance: a tool of 3 mm radius needs normals 3 mm away.
constexpr double kNearby_mm = 1.5;
/// Distance from the surface within which a voxel contributes to it.
constexpr float kBand_mm = 1;
/// Heights up to the first leave the broad distance unchanged: a sphere of 5 mm radius is below it. From the
/// second on the position has the share kMaxFraction.
constexpr float kThick_mm = 0.8f, kThin_mm = 1.2f, kMaxFraction = 0.9f;

}  // namespace

NormalGrid::NormalGrid(const GridGeometry& fine) : geometry(fine) {
  for (int a = 0; a < 3; ++a) {
    step[a] = std::max(1, static_cast<int>(std::lround(kNormalGrid_mm / fine.spacing_mm[a])));
    geometry.dims[a] = (fine.dims[a] + step[a] - 1) / step[a];
    geometry.spacing_mm[a] = fine.spacing_mm[a] * step[a];
  }
}

Span3 NormalGrid::inside(const Span3& fine) const {
  Span3 s;
  for (int a = 0; a < 3; ++a) {
    s.low[a] = (fine.low[a] + step[a] - 1) / step[a];
    s.high[a] = (fine.high[a] + step[a] - 1) / step[a];
  }
  return s;
}

void BroadFilter::apply(const Block<float>& distance, Block<std::int16_t>& broad) const {
  Block<float> smooth(broad.span());
  filter_block(distance, kernel, smooth);
  mm_to_steps(smooth.values().data(), smooth.values().size(), broad.values().data());
}

NormalFilter::NormalFilter(const Eigen::Vector3d& spacing_mm, double sigma_mm)
    : kernel(gaussian_block_kernel(spacing_mm, kNearby_mm)),
      slope(static_cast<float>(std::erf(kBroadReach_mm / (sigma_mm * std::sqrt(2.0))))) {}

void NormalFilter::apply(const Block<float>& broad, const Block<float>& position,
                         Block<std::int16_t>& normal) const {
  Block<float> weights(broad.span()), heights(broad.span());
  weigh_by_position(position.values().data(), broad.values().data(), {.band_mm = kBand_mm, .slope = slope},
                    weights.values().size(), weights.values().data(), heights.values().data());
  Block<float> surface(normal.span()), height_sum(normal.span());
  filter_block(weights, kernel, surface);
  filter_block(heights, kernel, height_sum);

  const PositionFraction fraction{.low_mm = kThick_mm,
                                  .high_mm = kThin_mm,
                                  .most = kMaxFraction,
                                  .slope = slope,
                                  .limit_mm = static_cast<float>(kBroadReach_mm)};
  const auto length = static_cast<std::size_t>(normal.span().size(0));
  const int shift = normal.span().low[0] - broad.span().low[0];
  for_each_row(normal.span(), [&](int j, int k) {
    const NormalRows rows{broad.row(j, k) + shift, position.row(j, k) + shift, surface.row(j, k),
                          height_sum.row(j, k)};
    blend_with_position(rows, fraction, length, normal.row(j, k));
  });
}

}  // namespace palpate::internal
