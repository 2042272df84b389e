#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/volume/volume.h"
#include "palpate/volume_io/placement_options.h"
#include "volume_io/mesh/mesh.h"

/// Position of a mesh in the patient. A mesh file specifies neither its unit nor, usually, its axes: they are
/// given by the user, or inferred from a scan within which only one interpretation of the numbers lies.
namespace palpate::volume_io {

/// Units tried if none is given; mm.
inline constexpr std::array<double, 3> kMeshUnits_mm{1, 10, 1000};

/// Converts a point from file coordinates to LPS mm.
Eigen::Vector3d in_patient(const Eigen::Vector3d& point, MeshSpace space, double unit_mm);

/// Statistics of the points of one or several meshes.
class MeshSurvey {
 public:
  /// @param scan     null: none; must outlive this object
  /// @param unit_mm  the only unit to try
  explicit MeshSurvey(const GridGeometry* scan, std::optional<double> unit_mm = {}) : scan_(scan) {
    if (unit_mm) units_mm_ = {*unit_mm};
  }
  void observe(const TriangleMesh& mesh);

  std::span<const double> units_mm() const { return units_mm_; }
  bool has_scan() const { return scan_ != nullptr; }
  std::uint64_t points() const { return points_; }
  /// Fraction of all points, 0 ... 1, that lie within the scan's voxels under an interpretation; `unit` is an
  /// index of units_mm().
  double within(MeshSpace space, std::size_t unit) const;
  /// Largest extent in file coordinates.
  double extent() const { return points_ == 0 ? 0 : (high_ - low_).maxCoeff(); }
  const GridGeometry* scan() const { return scan_; }

 private:
  const GridGeometry* scan_;
  std::vector<double> units_mm_{kMeshUnits_mm.begin(), kMeshUnits_mm.end()};
  std::uint64_t points_ = 0;
  std::array<std::array<std::uint64_t, kMeshUnits_mm.size()>, 2> within_{};
  Eigen::Vector3d low_ = Eigen::Vector3d::Zero(), high_ = Eigen::Vector3d::Zero();
};

struct TransformedMeshes {
  MeshSpace space = MeshSpace::kLps;
  double unit_mm = 1;
  bool space_is_known = true;  ///< False: neither the user, the file nor a scan determines it.
  std::string note;            ///< Interpretation used, and why: "is read as LPS mm: ...".
};

/// Chooses coordinate system and unit.
/// @param survey             survey with the given unit, or with all
/// @param placement_options  values given by the user
/// @param declared           value stated by the file
/// Errors, without `where`: less than half of the points lie within the scan under every interpretation;
/// several units, or both coordinate systems, fit, so that the user must decide.
Result<TransformedMeshes> transform_meshes(const MeshSurvey& survey,
                                           const MeshPlacementOptions& placement_options,
                                           std::optional<MeshSpace> declared);

}  // namespace palpate::volume_io
