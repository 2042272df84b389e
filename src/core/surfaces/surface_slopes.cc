#include "surfaces/surface_slopes.h"

#include <cmath>

#include "surfaces/surface_rows.h"

namespace palpate::internal {

Span3 stretches(const GridGeometry& grid) {
  const int cells = std::max(0, grid.dims[0] - 1);
  return {{0, 0, 0},
          {(cells + kStretch - 1) / kStretch, std::max(0, grid.dims[1] - 1), std::max(0, grid.dims[2] - 1)}};
}

Span3 stretches_at(const GridGeometry& grid, const Span3& voxels) {
  Span3 cells = voxels;
  for (int a = 0; a < 3; ++a) cells.low[a] = std::max(0, cells.low[a] - 1);
  cells.low[0] /= kStretch;
  cells.high[0] = (cells.high[0] + kStretch - 1) / kStretch;
  return cells.clipped(stretches(grid));
}

void bound_slopes(const GridGeometry& grid, const Block<std::int16_t>& position, Block<float>& slopes) {
  // for oblique grid axes the bound includes the norm of the inverse metric
  const Eigen::Matrix3d gram = grid.direction.transpose() * grid.direction;
  const double oblique = gram.isIdentity(1e-9) ? 1 : std::sqrt(gram.inverse().norm());
  CellRows rows{};
  for (int a = 0; a < 3; ++a) {
    rows.per_step[a] = static_cast<float>(oblique * kSurfaceStep_mm / grid.spacing_mm[a]);
  }
  for_each_row(slopes.span(), [&](int j, int k) {
    for (int s = slopes.span().low[0]; s < slopes.span().high[0]; ++s) {
      const int first = s * kStretch, cells = std::min(kStretch, grid.dims[0] - 1 - first);
      for (int n = 0; n < 4; ++n) {
        rows.row[n] = position.row(j + n % 2, k + n / 2) + (first - position.span().low[0]);
      }
      slopes.row(j, k)[s - slopes.span().low[0]] = steepest_square(rows, static_cast<std::size_t>(cells));
    }
  });
}

float greatest(std::span<const float> slopes) {
  // independent maxima, so that comparisons do not wait for each other
  std::array<float, 16> worst{};
  std::size_t n = 0;
  for (; n + worst.size() <= slopes.size(); n += worst.size()) {
    for (std::size_t m = 0; m < worst.size(); ++m) {
      worst[m] = worst[m] < slopes[n + m] ? slopes[n + m] : worst[m];
    }
  }
  for (; n < slopes.size(); ++n) worst[0] = std::max(worst[0], slopes[n]);
  return *std::max_element(worst.begin(), worst.end());
}

float max_outside(std::span<const float> slopes, const Span3& all, const Span3& without) {
  const auto positions = [&](int i, int j, int k) {
    return (static_cast<std::size_t>(k) * static_cast<std::size_t>(all.size(1)) +
            static_cast<std::size_t>(j)) *
               static_cast<std::size_t>(all.size(0)) +
           static_cast<std::size_t>(i);
  };
  // ranges between the excluded rows
  float worst = 0;
  std::size_t from = 0;
  for_each_row(without, [&](int j, int k) {
    const std::size_t to = positions(without.low[0], j, k);
    worst = std::max(worst, greatest(slopes.subspan(from, to - from)));
    from = positions(without.high[0], j, k);
  });
  return std::max(worst, greatest(slopes.subspan(from)));
}

double steepest_of(float square) {
  // margin for rounding
  return std::max(1e-6, std::sqrt(static_cast<double>(square)) * (1 + 1e-6));
}

}  // namespace palpate::internal
