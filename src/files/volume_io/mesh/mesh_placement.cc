#include "volume_io/mesh/mesh_placement.h"

#include <algorithm>
#include <cmath>

#include "volume_io/voxel_source.h"

namespace palpate::volume_io {
namespace {

std::string name_of(MeshSpace space) {
  return space == MeshSpace::kLps ? "LPS" : "RAS";
}

MeshSpace other_than(MeshSpace space) {
  return space == MeshSpace::kLps ? MeshSpace::kRas : MeshSpace::kLps;
}

std::string name_of_unit(double unit_mm) {
  if (unit_mm == 1) return "mm";
  if (unit_mm == 10) return "cm";
  if (unit_mm == 1000) return "m";
  return "units of " + std::to_string(unit_mm) + " mm";
}

std::string percent(double part) {
  // 100 % only if it is all of them
  return std::to_string(part >= 1 ? 100 : static_cast<int>(std::min(99.0, std::round(100 * part)))) + " %";
}

// Fractions of points within the scan that decide the coordinate system: minimum for the correct one and
// maximum for a wrong one.
constexpr double kMinForCorrect = 0.99, kByMistake = 0.9, kHalf = 0.5, kHardlyAny = 0.02;

bool proves(double fraction_within, double other_fraction_within) {
  return (fraction_within >= kMinForCorrect && other_fraction_within < kByMistake) ||
         (fraction_within >= kHalf && other_fraction_within <= kHardlyAny);
}

}  // namespace

Eigen::Vector3d in_patient(const Eigen::Vector3d& point, MeshSpace space, double unit_mm) {
  const double turn = space == MeshSpace::kRas ? -1 : 1;
  return unit_mm * Eigen::Vector3d(turn * point.x(), turn * point.y(), point.z());
}

void MeshSurvey::observe(const TriangleMesh& mesh) {
  Transform<Voxel, Patient> X;
  if (scan_) X = scan_->X_PatientVoxel().inverse();
  for (const Eigen::Vector3d& point : mesh.points) {
    low_ = points_ == 0 ? point : Eigen::Vector3d(low_.cwiseMin(point));
    high_ = points_ == 0 ? point : Eigen::Vector3d(high_.cwiseMax(point));
    ++points_;
    if (!scan_) continue;
    for (const MeshSpace space : {MeshSpace::kLps, MeshSpace::kRas})
      for (std::size_t unit = 0; unit < units_mm_.size(); ++unit) {
        const Eigen::Vector3d voxel = (X * Point<Patient>(in_patient(point, space, units_mm_[unit]))).eigen();
        bool is_inside = true;
        // a surface around the outermost voxels lies half a voxel outside, or one voxel if it is smoothed
        for (int a = 0; a < 3; ++a)
          is_inside = is_inside && voxel[a] >= -1 && voxel[a] <= scan_->dims[static_cast<std::size_t>(a)];
        within_[static_cast<std::size_t>(space)][unit] += is_inside;
      }
  }
}

double MeshSurvey::within(MeshSpace space, std::size_t unit) const {
  return points_ == 0 ? 0
                      : static_cast<double>(within_[static_cast<std::size_t>(space)][unit]) /
                            static_cast<double>(points_);
}

Result<TransformedMeshes> transform_meshes(const MeshSurvey& survey,
                                           const MeshPlacementOptions& placement_options,
                                           std::optional<MeshSpace> declared) {
  const std::optional<MeshSpace> space = placement_options.space ? placement_options.space : declared;
  const std::string by = placement_options.space ? "as requested" : "as stated in the file";
  TransformedMeshes placed;
  if (!survey.has_scan() || (space && placement_options.unit_mm)) {
    placed.space = space.value_or(MeshSpace::kLps);
    placed.unit_mm = placement_options.unit_mm.value_or(1);
    placed.space_is_known = space.has_value();
    placed.note = "is read as " + name_of(placed.space) + " (" +
                  (space ? by : "which the file does not state: its sides are unknown") + ") in " +
                  name_of_unit(placed.unit_mm) +
                  (placement_options.unit_mm ? "" : " (which the file does not state)");
    return placed;
  }

  // Units in which the meshes lie in the scan and exceed a minimum size: a scan that contains the origin also
  // contains a mesh read too small.
  constexpr double kSpeck_voxels = 2;
  std::vector<std::size_t> fitting;
  std::string fitting_units;
  for (std::size_t tried = 0; tried < survey.units_mm().size(); ++tried) {
    const double best =
        space ? survey.within(*space, tried)
              : std::max(survey.within(MeshSpace::kLps, tried), survey.within(MeshSpace::kRas, tried));
    if (best < kHalf ||
        survey.extent() * survey.units_mm()[tried] < kSpeck_voxels * survey.scan()->min_spacing_mm())
      continue;
    fitting_units += (fitting.empty() ? "" : " and in ") + name_of_unit(survey.units_mm()[tried]);
    fitting.push_back(tried);
  }
  const std::string tried_units =
      placement_options.unit_mm ? name_of_unit(*placement_options.unit_mm) : "mm, cm and m";
  if (fitting.size() > 1)
    return bad_input(
        "", "does not state its unit, and lies in the scan if read in " + fitting_units + " alike",
        "choose one with --mesh-unit mm, --mesh-unit cm or --mesh-unit m (in a scene file: mesh_unit)");
  if (fitting.empty())
    return bad_input(
        "",
        "does not lie in the scan, read as " + (space ? name_of(*space) : "LPS or as RAS") + " in " +
            tried_units + ": at least half of its points must lie in it",
        "give the scan that it was made on; or choose how to read it with --mesh-space and --mesh-unit");
  const std::size_t unit = fitting.front();
  placed.unit_mm = survey.units_mm()[unit];
  const double lps = survey.within(MeshSpace::kLps, unit), ras = survey.within(MeshSpace::kRas, unit);
  placed.space = space.value_or(lps >= ras ? MeshSpace::kLps : MeshSpace::kRas);
  const double fraction_within = survey.within(placed.space, unit),
               other_fraction_within = survey.within(other_than(placed.space), unit);
  if (!space && !proves(fraction_within, other_fraction_within))
    return bad_input("",
                     "does not state whether its axes are LPS or RAS, and lies in the scan either way (" +
                         percent(lps) + " of its points as LPS, " + percent(ras) + " as RAS)",
                     "choose one with --mesh-space lps or --mesh-space ras (in a scene file: mesh_space)");
  placed.note = "is read as " + name_of(placed.space) + (space ? " (" + by + ")" : "") + " in " +
                name_of_unit(placed.unit_mm) + ": so " + percent(fraction_within) +
                " of its points lie in the scan";
  if (!space)
    placed.note += ", as " + name_of(other_than(placed.space)) + " " + percent(other_fraction_within);
  return placed;
}

}  // namespace palpate::volume_io
