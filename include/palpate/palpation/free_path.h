#pragma once

#include <optional>
#include <vector>

#include "palpate/contact/model.h"

namespace palpate {

/// Path planning for a tool through the space free of structures with contact, on a grid of about 1 mm: A*
/// (Hart, Nilsson & Raphael 1968) with a cost that penalises proximity to structures.
class FreeSpace {
 public:
  /// @param reach_mm  radius of the tool about its tip; clamped to kMaxReach_mm
  explicit FreeSpace(const Model& model, double reach_mm = 0);
  static constexpr double kMaxReach_mm = 8;

  /// Corner points of a path from `from` to `to`, both included, which stays away from structures where it
  /// can. Empty if there is none. An end inside an occupied cell is replaced by the nearest free one.
  std::vector<Point<Patient>> path(const Point<Patient>& from, const Point<Patient>& to) const;

  /// Whether the tool can reach this point from the air around the patient.
  bool reachable(const Point<Patient>& p) const { return from_outside_[index(cell_at(p))]; }
  /// Lower bound of the distance to every structure with contact, mm; 0 in an occupied cell.
  double clearance_mm(const Point<Patient>& p) const;

 private:
  using Cell = std::array<int, 3>;
  std::size_t index(const Cell& c) const {
    return (static_cast<std::size_t>(c[2]) * cells_[1] + static_cast<std::size_t>(c[1])) * cells_[0] +
           static_cast<std::size_t>(c[0]);
  }
  bool contains(const Cell& c) const {
    return c[0] >= 0 && c[1] >= 0 && c[2] >= 0 && c[0] < cells_[0] && c[1] < cells_[1] && c[2] < cells_[2];
  }
  Cell cell_at(const Point<Patient>& p) const;
  Point<Patient> centre(const Cell& c) const;
  std::optional<Cell> nearest_free(const Cell& c) const;

  std::array<int, 3> voxels_per_cell_{1, 1, 1};
  Cell cells_{0, 0, 0};                  ///< Includes a free margin around the volume
  int margin_ = 0;                       ///< Width of the free margin on every side of the volume; cells
  std::uint8_t needed_ = 1;              ///< Clearance at which the tool is in contact with nothing; steps
  double cell_mm_ = 1;                   ///< Shortest side of a cell
  std::vector<std::uint8_t> clearance_;  ///< Steps to the nearest occupied cell, 0 in one, at most kFar
  std::vector<bool> from_outside_;       ///< Whether the margin is connected to the cell
  Transform<Patient, Voxel> X_PatientVoxel_;
  Transform<Voxel, Patient> X_VoxelPatient_;
};

}  // namespace palpate
