#pragma once

#include <cmath>
#include <random>

#include "palpate/tissue/elastic_grid.h"

/// Elastic grids shared by tests.
namespace palpate::testing {

inline ElasticMaterial soft(double youngs_modulus_kPa, double poissons_ratio, double stiffening = 0) {
  return {Matter::kSoft, youngs_modulus_kPa, poissons_ratio, stiffening};
}

inline ElasticBox elastic_box(std::array<int, 3> cells, double cell_mm = 1) {
  ElasticBox box;
  box.cells = cells;
  box.cell_mm = cell_mm;
  return box;
}

/// Uniform material.
inline ElasticGrid elastic_block(std::array<int, 3> cells, double cell_mm, const ElasticMaterial& material) {
  return ElasticGrid(
      elastic_box(cells, cell_mm), [=](const Point<Patient>&) { return material; }, 1);
}

/// Air, bone and tissues of 1 kPa to 1 MPa at random per sample, some nodes held in some directions.
inline ElasticGrid random_grid(std::array<int, 3> cells, double cell_mm, std::mt19937& random) {
  std::uniform_real_distribution<double> unit(0, 1);
  const double air = 0.4 * unit(random), bone = 0.1 * unit(random);
  ElasticGrid grid(
      elastic_box(cells, cell_mm),
      [&](const Point<Patient>&) {
        const double what = unit(random);
        if (what < air) return ElasticMaterial{};
        if (what < air + bone) return ElasticMaterial{Matter::kRigid, 0, 0};
        return soft(std::pow(10, 3 * unit(random)), 0.49 * unit(random));
      },
      1 + static_cast<int>(random() % 2));
  for (int k = 0; k <= cells[2]; ++k)
    for (int j = 0; j <= cells[1]; ++j)
      for (int i = 0; i <= cells[0]; ++i)
        if (unit(random) < 0.05) grid.constrain(i, j, k, static_cast<std::uint8_t>(random() % 8));
  return grid;
}

}  // namespace palpate::testing
