#pragma once

#include <optional>
#include <vector>

#include "palpate/haptics/haptics.h"

namespace palpate {

/// Ways for a tool through the space that no felt structure fills, on a grid of about a millimetre.
class FreeSpace {
 public:
  /// @param reach_mm  how far the tool stands out from its tip; more than kMostReach_mm counts as that
  explicit FreeSpace(const Model& model, double reach_mm = 0);
  static constexpr double kMostReach_mm = 8;

  /// Corner points of a way from `from` to `to`, both included, which keeps off structures where it
  /// can: A* (Hart, Nilsson & Raphael 1968) with a price for closeness. Empty when none exists. Ends that lie
  /// in a structure's own cell start at the nearest free one.
  std::vector<Point<Patient>> path(const Point<Patient>& from, const Point<Patient>& to) const;

  /// Whether the tool can come to this place from the air about the patient.
  bool reachable(const Point<Patient>& p) const { return from_outside_[index(cell_at(p))]; }
  /// At least so far from every felt structure, mm; 0 where one may be.
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
  Cell cells_{0, 0, 0};                  ///< with a free margin round the volume
  int margin_ = 0;                       ///< of free cells on every side of the volume
  std::uint8_t needed_ = 1;              ///< clearance at which the tool touches nothing
  double cell_mm_ = 1;                   ///< the narrowest side of a cell
  std::vector<std::uint8_t> clearance_;  ///< steps to the nearest felt cell, 0 in one, at most kFar
  std::vector<bool> from_outside_;       ///< can be reached from the margin
  Transform<Patient, Voxel> X_PatientVoxel_;
  Transform<Voxel, Patient> X_VoxelPatient_;
};

}  // namespace palpate
