#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/volume/volume.h"
#include "palpate/volume_io/volume_io.h"
#include "volume_io/mesh.h"

/// Where a mesh lies in the patient. Its file says neither unit nor, as a rule, axes: they are said by
/// whoever reads it, or follow from a scan, in which only one reading of the numbers may lie.
namespace palpate::volume_io {

/// The units that are tried where none is asked for, mm.
inline constexpr std::array<double, 3> kMeshUnits_mm{1, 10, 1000};

/// A point in a file's own numbers, in LPS mm.
Eigen::Vector3d in_patient(const Eigen::Vector3d& point, MeshSpace space, double unit_mm);

/// What is known of the points of one or several meshes.
class MeshSurvey {
 public:
  /// @param scan     null: none; outlives this
  /// @param unit_mm  the only one that is tried
  explicit MeshSurvey(const GridGeometry* scan, std::optional<double> unit_mm = {}) : scan_(scan) {
    if (unit_mm) units_mm_ = {*unit_mm};
  }
  void see(const TriangleMesh& mesh);

  std::span<const double> units_mm() const { return units_mm_; }
  bool has_scan() const { return scan_ != nullptr; }
  std::uint64_t points() const { return points_; }
  /// The part of all points, 0 ... 1, that lie within the scan's voxels if read so; unit by its index.
  double within(MeshSpace space, std::size_t unit) const;
  /// The largest extent in the file's own numbers.
  double extent() const { return points_ == 0 ? 0 : (high_ - low_).maxCoeff(); }
  const GridGeometry* scan() const { return scan_; }

 private:
  const GridGeometry* scan_;
  std::vector<double> units_mm_{kMeshUnits_mm.begin(), kMeshUnits_mm.end()};
  std::uint64_t points_ = 0;
  std::array<std::array<std::uint64_t, kMeshUnits_mm.size()>, 2> within_{};
  Eigen::Vector3d low_ = Eigen::Vector3d::Zero(), high_ = Eigen::Vector3d::Zero();
};

struct PlacedMeshes {
  MeshSpace space = MeshSpace::kLps;
  double unit_mm = 1;
  bool space_is_known = true;  ///< false: nobody says it and there is no scan
  std::string note;            ///< what is taken, and why: "is read as LPS mm: ..."
};

/// @param survey  that has tried the unit that is asked for, or all
/// @param asked   by the user
/// @param stated  by the file
/// Errors, without `where`: read in no way do half of the points lie within the scan; in several units they
/// do, more than a speck, or either way around, so that it must be asked for.
Result<PlacedMeshes> place_meshes(const MeshSurvey& survey, const MeshPlacing& asked,
                                  std::optional<MeshSpace> stated);

}  // namespace palpate::volume_io
