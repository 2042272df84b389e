#pragma once

#include <cmath>
#include <functional>
#include <random>
#include <vector>

#include "contact_body.h"

/// Generated bodies of thin bone in soft tissue.
namespace palpate::test {

/// Label map of 1 (soft) and 2 (bone) on a cube of edge 2 `half_mm` around the origin.
inline LabelMap soft_and_bone(double half_mm, double spacing_mm,
                              const std::function<int(const Eigen::Vector3d&)>& label_at) {
  GridGeometry grid;
  const int count = 2 * static_cast<int>(std::ceil(half_mm / spacing_mm)) + 1;
  grid.dims = {count, count, count};
  grid.spacing_mm = Eigen::Vector3d::Constant(spacing_mm);
  grid.origin = Point<Patient>(Eigen::Vector3d::Constant(-0.5 * (count - 1) * spacing_mm));
  LabelMap map;
  map.layers.emplace_back(grid);
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  for (int k = 0; k < count; ++k)
    for (int j = 0; j < count; ++j)
      for (int i = 0; i < count; ++i)
        map.layers[0].at(i, j, k) =
            static_cast<LabelId>(label_at((X_PatientVoxel * Point<Voxel>(i, j, k)).eigen()));
  map.segments = {{1, "soft", {}, 0, 1}, {2, "bone", {}, 0, 2}};
  return map;
}

inline Model soft_and_bone_model(const LabelMap& map) {
  return model_of(map, [](const Segment& segment) { return segment.id == 1 ? 0.1 : 1.5; });
}

/// Soft ball of radius 8 mm around a bone cup that is open at the top, inner radius 5 mm.
inline LabelMap cup_in_a_ball(double wall_mm) {
  return soft_and_bone(12, 0.3, [&](const Eigen::Vector3d& p) {
    const double r = p.norm();
    if (r > 8) return 0;
    return r > 5 && r < 5 + wall_mm && p.z() < 2.5 ? 2 : 1;
  });
}

/// Soft ball of radius 11 mm around plates and hollow cells of thin bone, as in a temporal bone.
inline LabelMap cells_and_plates(unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> coordinate(-8, 8), radius(1.5, 4), wall(0.5, 0.9), unit(-1, 1);
  struct Cell {
    Eigen::Vector3d middle;
    double radius, wall;
  };
  struct Plate {
    Eigen::Vector3d normal;
    double offset, thick;
  };
  std::vector<Cell> cells;
  std::vector<Plate> plates;
  for (int n = 0; n < 24; ++n) {
    const Eigen::Vector3d centre(coordinate(random), coordinate(random), coordinate(random));
    cells.push_back({centre, radius(random), wall(random)});
  }
  for (int n = 0; n < 3; ++n) {
    const Eigen::Vector3d normal(unit(random), unit(random), unit(random));
    plates.push_back({normal.normalized(), 0.6 * coordinate(random), wall(random)});
  }
  return soft_and_bone(15, 0.3, [=](const Eigen::Vector3d& p) {
    if (p.norm() > 11) return 0;
    for (const Plate& plate : plates)
      if (std::abs(plate.normal.dot(p) - plate.offset) < 0.5 * plate.thick) return 2;
    bool bone = false;
    for (const Cell& cell : cells) {
      const double r = (p - cell.middle).norm();
      if (r < cell.radius - cell.wall) return 1;
      bone = bone || r < cell.radius;
    }
    return bone ? 2 : 1;
  });
}

}  // namespace palpate::test
