#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"
#include "palpate/volume/label_map.h"
#include "palpate/volume/volume.h"

/// Fitness of a segmentation for touch: faults of shape, of names and of placement, a grade for each
/// structure, and what can be repaired without a decision. Thresholds and their evidence:
/// docs/decisions/0082-thresholds-of-lint.md.
namespace palpate {

enum class LintKind : std::uint8_t {
  kLeakySheet,
  kOneVoxelSheet,
  kNeck,
  kOpenCavity,
  kIslands,
  kHoles,
  kNarrowGap,
  kSeam,
  kTerraces,
  kSwappedSides,
  kCutByBorder,
  kOverlap,
  kNoName,
  kDuplicateName,
  kNoVoxels,
  kOutsideBody,
  kOutsideScan,
  kUnreachable,
};

/// Description of a kind of finding. Texts, JSON, page and manual are derived from it.
struct LintKindInfo {
  LintKind kind;
  std::string_view key;         ///< Identifier in JSON: "one_voxel_sheet"
  std::string_view title;       ///< Title in texts: "Sheet one voxel thick"
  std::string_view definition;  ///< Condition under which it is reported, with thresholds; full sentences
  std::string_view effect;      ///< Consequence for touch; a clause without a full stop
  std::string_view remedy;      ///< Remedy; an imperative without a full stop
  bool is_repairable = false;   ///< Whether repaired_labels() can repair it
};
/// All kinds, in the order of LintKind.
std::span<const LintKindInfo> lint_kinds();
const LintKindInfo& lint_kind(LintKind kind);

/// Markdown table of the kinds, which is the one in docs/guide/lint.md.
std::string lint_kind_table();

enum class LintSeverity : std::uint8_t {
  kFault,         ///< Wrong in any patient
  kWarning,       ///< May be anatomy or intended, but impairs touch
  kUndetermined,  ///< Undecided: the input that would decide it is missing
};
/// "fault", "warning", "cannot tell"
std::string_view in_words(LintSeverity severity);

struct LintFinding {
  LintKind kind = LintKind::kIslands;
  LintSeverity severity = LintSeverity::kFault;
  std::vector<LabelId> structures;         ///< Segment ids; empty: the whole label map
  double quantity = 0;                     ///< Measured value in `unit`
  std::string_view unit;                   ///< "mm3", "mm2", "mm", "%", or "" for a number
  std::size_t voxels = 0;                  ///< Number of affected voxels; 0 if the finding has none
  std::optional<Point<Patient>> position;  ///< Centre of an affected voxel; empty: the finding has no place
  std::array<int, 3> voxel{0, 0, 0};       ///< Indices of that voxel; valid if `position` is set
  std::string sentence;                    ///< Description with figures; without a full stop
};

/// Grade of a structure. A: nothing but undecided findings. B: warnings. C: faults of one kind. D: faults of
/// several kinds.
struct StructureGrade {
  LabelId id = 0;
  std::string name;  ///< "label 7" if it has none
  std::size_t voxels = 0;
  double volume_mm3 = 0;
  char grade = 'A';
  int faults = 0, warnings = 0, undecided = 0;  ///< Numbers of findings
};

struct LintReport {
  std::vector<LintFinding> findings;       ///< Sorted by severity, faults first, then by kind
  std::vector<StructureGrade> structures;  ///< In ascending order of id
  /// Grade that at least nine of ten structures reach; C at best if a fault concerns the whole map.
  char grade = 'A';

  std::size_t count(LintSeverity severity) const;
};

/// Permitted range of LintOptions::tool_radius_mm.
inline constexpr double kMinLintToolRadius_mm = 0.01, kMaxLintToolRadius_mm = 12;

struct LintOptions {
  double tool_radius_mm = 1;            ///< Tool radius for gaps and access
  bool oriented = true;                 ///< false: the files do not state the grid's orientation
  const Volume<float>* scan = nullptr;  ///< Scan on any grid; null: findings that need it are undecided
  /// Whether a structure of that name is too stiff for a tool to pass through; empty: unknown. Without a
  /// function it is unknown for every structure.
  std::function<std::optional<bool>(const std::string& name)> is_hard;
  int threads = 0;  ///< Number of threads; 0: one per processor. Results do not depend on it.
};

/// Checks a label map and grades its structures.
/// Errors: kBadInput for a tool radius that is not above 0 and at most 12 mm; kInterrupted.
Result<LintReport> lint(const LabelMap& labels, const LintOptions& options, const Progress& progress = {});

/// A change made by repaired_labels(), summed per kind and structure.
struct LintRepair {
  LintKind kind = LintKind::kIslands;
  LabelId structure = 0;   ///< Segment id
  std::size_t parts = 0;   ///< Number of islands or holes; 0 for a name
  std::size_t voxels = 0;  ///< Number of changed voxels
  std::string name;        ///< New name, if a name was changed
};
struct RepairedLabels {
  LabelMap labels;
  std::vector<LintRepair> repairs;
};
/// Repairs the faults that need no decision: an island takes the value that shares the most faces with it, a
/// hole the value of the structure around it, and empty and duplicate names become unique. Grid, layers and
/// values stay. Faults that lint() reports as islands, holes, no_name or duplicate_name are gone afterwards.
/// Errors: kInterrupted.
Result<RepairedLabels> repaired_labels(LabelMap labels, int threads = 0, const Progress& progress = {});

}  // namespace palpate
