#pragma once

#include <string>
#include <utility>
#include <vector>

#include "lint/voxel_runs.h"
#include "palpate/lint/lint.h"
#include "palpate/volume/label_map.h"

/// State and helpers shared by the checks of lint().
namespace palpate::internal {

/// An island has less than this fraction of the voxels of its structure's largest component, and at most
/// this volume.
inline constexpr double kIslandFraction = 0.02, kIsland_mm3 = 1000;
/// An enclosed cavity of at most this fraction of the volume of the structure around it, and at most this
/// volume, is a hole; a larger one may be anatomy.
inline constexpr double kHoleFraction = 0.02, kHole_mm3 = 1000;

/// Label map being checked, and the findings so far.
struct LintContext {
  LintContext(const LabelMap& labels, const LintOptions& options, const Progress& progress);

  const LabelMap& labels;
  const LintOptions& options;
  const Progress& progress;
  const GridGeometry& grid;
  int workers;
  std::vector<SegmentStatistics> statistics;
  std::vector<LintFinding> findings;

  const SegmentStatistics* statistics_of(LabelId id) const;
  /// Name of a structure: "liver", or "label 7" if it has none.
  std::string name_of(LabelId id) const;
  /// Names of at most five structures: "liver, spleen and 3 more".
  std::string names_of(const std::vector<LabelId>& ids) const;
  Point<Patient> position_of(const std::array<int, 3>& voxel) const;
  /// Area of a voxel face perpendicular to an axis, mm2.
  double face_mm2(std::size_t axis) const;

  /// Measurement of a finding, and where it is.
  struct Extent {
    double quantity = 0;
    std::string_view unit = {};                    ///< Empty: nothing measured
    std::size_t voxels = 0;                        ///< Number of voxels concerned
    std::optional<std::array<int, 3>> voxel = {};  ///< Indices of the voxel that is reported as its position
  };
  /// Adds a finding.
  /// @param sentence  without final full stop
  void add(LintKind kind, LintSeverity severity, std::vector<LabelId> structures, const Extent& extent,
           std::string sentence);
};

/// Value with its unit, to three significant digits: "12.3 mm2".
std::string figure(double value, std::string_view unit);
/// Count with its noun: "1 voxel", "2 voxels".
std::string counted(std::size_t count, std::string_view noun);

/// Canonical form of a name for comparison: lower case, runs of other characters than letters and digits
/// replaced by one space.
std::string plain_name(const std::string& name);

/// Islands of a layer, by component number, and its cavities that a single structure encloses.
struct Islands {
  std::vector<std::uint32_t> islands;
  struct Cavity {
    std::uint32_t component;
    LabelId around;  ///< Value of the enclosing structure
    bool is_hole;    ///< Whether it is within the limits of a hole
  };
  std::vector<Cavity> cavities;
};
Islands islands_and_cavities(const RunVolume& runs, const std::vector<Component>& components,
                             double voxel_mm3);

// ---- the checks; each adds its findings. Errors: kInterrupted.

/// Islands, holes, sheets, necks, open cavities, seams, terraces and cuts by the border, in one layer.
Result<void> check_shapes(LintContext& context, std::size_t layer, const ProgressSpan& span);
/// @param flat  segment id of each voxel; overlapping layers are flattened
Result<void> check_leaks(LintContext& context, const Volume<LabelId>& flat);
Result<void> check_gaps(LintContext& context, const Volume<LabelId>& flat, const ProgressSpan& span);
Result<void> check_access(LintContext& context, const Volume<LabelId>& flat, const ProgressSpan& span);
Result<void> check_body(LintContext& context, const Volume<LabelId>& flat, const ProgressSpan& span);
void check_names(LintContext& context);
void check_sides(LintContext& context);
void check_overlaps(LintContext& context);

}  // namespace palpate::internal
