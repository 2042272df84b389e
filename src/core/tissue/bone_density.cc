#include "palpate/tissue/bone_density.h"

#include <algorithm>
#include <cmath>

#include "palpate/base/for_each_index.h"
#include "palpate/tissue/tissue_settings.h"

namespace palpate {
namespace {

std::uint16_t stored_ratio(double ratio) {
  return static_cast<std::uint16_t>(std::lround(ratio * kDensityRatioOne));
}

// mean ratio of the labelled neighbours of a voxel; 1 without any
std::uint16_t mean_around(const Volume<std::uint16_t>& ratios, const Volume<std::uint8_t>& is_rigid, int i,
                          int j, int k) {
  const GridGeometry& grid = ratios.geometry();
  double sum = 0;
  int count = 0;
  for (int c = std::max(k - 1, 0); c <= std::min(k + 1, grid.dims[2] - 1); ++c)
    for (int b = std::max(j - 1, 0); b <= std::min(j + 1, grid.dims[1] - 1); ++b)
      for (int a = std::max(i - 1, 0); a <= std::min(i + 1, grid.dims[0] - 1); ++a) {
        if (is_rigid.at(a, b, c) == 0) continue;
        sum += ratios.at(a, b, c);
        ++count;
      }
  return count > 0 ? static_cast<std::uint16_t>(std::lround(sum / count)) : kDensityRatioOne;
}

}  // namespace

double density_ratio(double HU, double full_HU) {
  if (std::isnan(HU)) return 1;
  const double density = std::clamp(HU / full_HU, kCuttingSettings.min_density, kCuttingSettings.max_density);
  return density * density;
}

std::shared_ptr<const Bricks<std::uint16_t>> density_ratios_of(const Model& model) {
  if (!(model.full_density_HU > 0) || model.scan == nullptr) return nullptr;
  const GridGeometry& grid = model.labels->geometry();
  Volume<std::uint8_t> is_rigid(grid);
  Volume<std::uint16_t> own(grid), ratios(grid);
  const auto for_rows = [&](const auto& run) {
    (void)for_each_index(grid.dims[2], worker_count(0, grid.dims[2]), [&](int /*worker*/, int k) {
      for (int j = 0; j < grid.dims[1]; ++j)
        for (int i = 0; i < grid.dims[0]; ++i) run(i, j, k);
      return true;
    });
  };
  for_rows([&](int i, int j, int k) {
    const Tissue* const tissue = model.tissue_of(model.labels->at(i, j, k));
    const bool rigid = tissue != nullptr && tissue->touchable && !tissue->elastic;
    is_rigid.at(i, j, k) = rigid ? 1 : 0;
    own.at(i, j, k) = rigid ? stored_ratio(density_ratio(model.scan->at(i, j, k), model.full_density_HU))
                            : kDensityRatioOne;
  });
  for_rows([&](int i, int j, int k) {
    const bool is_touchable = model.is_touchable(model.labels->at(i, j, k));
    ratios.at(i, j, k) = !is_touchable ? mean_around(own, is_rigid, i, j, k) : own.at(i, j, k);
  });
  return std::make_shared<const Bricks<std::uint16_t>>(ratios, kDensityRatioOne);
}

}  // namespace palpate
