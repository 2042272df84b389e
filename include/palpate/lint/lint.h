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
#include "palpate/volume/volume.h"

/// Fitness of a segmentation for touch: faults of shape, of names and of placement, a grade for each
/// structure, and what can be mended without a decision. Thresholds and their evidence:
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

/// The one description of a kind, from which words, JSON, page and manual follow.
struct LintKindInfo {
  LintKind kind;
  std::string_view key;         ///< "one_voxel_sheet"
  std::string_view title;       ///< "Sheet one voxel thick"
  std::string_view definition;  ///< when it is reported, with thresholds; a sentence
  std::string_view effect;      ///< what it does to touch; a clause without a full stop
  std::string_view remedy;      ///< how to mend it; an imperative without a full stop
  bool is_mended = false;       ///< mended_labels() can mend it
};
/// All kinds, in the order of LintKind.
std::span<const LintKindInfo> lint_kinds();
const LintKindInfo& lint_kind(LintKind kind);

/// The kinds as a Markdown table: the one of docs/guide/lint.md.
std::string lint_kind_table();

enum class LintSeverity : std::uint8_t {
  kFault,       ///< wrong in any patient
  kWarning,     ///< may be anatomy or intended, and touch suffers from it
  kCannotTell,  ///< undecided: what would decide it is missing
};
/// "fault", "warning", "cannot tell"
std::string_view in_words(LintSeverity severity);

struct LintFinding {
  LintKind kind = LintKind::kIslands;
  LintSeverity severity = LintSeverity::kFault;
  std::vector<LabelId> structures;      ///< segment ids; empty: the whole label map
  double quantity = 0;                  ///< in `unit`
  std::string_view unit;                ///< "mm3", "mm2", "mm", "%" or "" for a number
  std::size_t voxels = 0;               ///< affected; 0 where a finding has none
  std::optional<Point<Patient>> place;  ///< centre of an affected voxel
  std::array<int, 3> voxel{0, 0, 0};    ///< the same as indices, where there is a place
  std::string sentence;                 ///< what was found, with figures; without a full stop
};

/// A: nothing but what cannot be told. B: warnings. C: faults of one kind. D: faults of several kinds.
struct StructureGrade {
  LabelId id = 0;
  std::string name;  ///< "label 7" where it has none
  std::size_t voxels = 0;
  double volume_mm3 = 0;
  char grade = 'A';
  int faults = 0, warnings = 0, undecided = 0;  ///< number of findings
};

struct LintReport {
  std::vector<LintFinding> findings;       ///< faults first, then by kind
  std::vector<StructureGrade> structures;  ///< ascending id
  /// The grade that nine of ten structures reach, and no better than C where a fault concerns the whole map.
  char grade = 'A';

  std::size_t count(LintSeverity severity) const;
};

struct LintOptions {
  double tool_radius_mm = 1;            ///< of the tool for which gaps and access are measured; above 0
  bool oriented = true;                 ///< false: the files do not say how the grid lies in the patient
  const Volume<float>* scan = nullptr;  ///< any grid; null: findings that need it cannot be told
  /// Whether a structure of that name is too stiff to push a tool through, empty where that is unknown;
  /// without a function it is unknown of every structure.
  std::function<std::optional<bool>(const std::string& name)> is_hard;
  int threads = 0;  ///< 0: one for each processor; results do not depend on it
};

/// Errors: kBadInput for a tool radius that is not above 0 and at most 12 mm; kInterrupted.
Result<LintReport> lint(const LabelMap& labels, const LintOptions& options, const Progress& progress = {});

/// One change that mended_labels() made.
struct LintMend {
  LintKind kind = LintKind::kIslands;
  LabelId structure = 0;   ///< segment id
  std::size_t parts = 0;   ///< islands or holes; 0 for a name
  std::size_t voxels = 0;  ///< that changed
  std::string name;        ///< the new name, of names
};
struct MendedLabels {
  LabelMap labels;
  std::vector<LintMend> mends;
};
/// Mends what needs no decision: islands take the value that most of their neighbours have, holes that of the
/// structure around them, empty and duplicate names become unique. Grid, layers and values stay. What lint()
/// reports as islands, holes, no_name or duplicate_name faults is gone afterwards.
/// Errors: kInterrupted.
Result<MendedLabels> mended_labels(LabelMap labels, int threads = 0, const Progress& progress = {});

}  // namespace palpate
