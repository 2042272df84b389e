#include "palpate/lint/lint.h"

#include <algorithm>
#include <map>
#include <set>

#include "lint/study.h"

namespace palpate {
namespace {

using internal::figure;
using internal::LintStudy;

void check_slices(LintStudy& study) {
  constexpr double kThickSlices = 2.5;
  const Eigen::Vector3d& spacing = study.grid.spacing_mm;
  const double widest = spacing.maxCoeff(), ratio = widest / spacing.minCoeff();
  if (ratio < kThickSlices || study.statistics.empty()) return;
  study.add(
      LintKind::kTerraces, LintSeverity::kWarning, {}, {widest, "mm"},
      "slices are " + figure(widest, "mm") + " thick, " + figure(ratio, "") + " times the width of a voxel");
}

char grade_of(const std::set<LintKind>& faults, int warnings) {
  return faults.size() > 1 ? 'D' : faults.size() == 1 ? 'C' : warnings > 0 ? 'B' : 'A';
}

LintReport graded(LintStudy& study) {
  LintReport report;
  report.findings = std::move(study.findings);
  std::ranges::stable_sort(report.findings, {},
                           [](const LintFinding& f) { return std::pair(f.severity, f.kind); });
  std::map<LabelId, std::set<LintKind>> faults;
  for (const Segment& segment : study.labels.segments) {
    const SegmentStatistics* statistics = study.statistics_of(segment.id);
    StructureGrade grade{segment.id, study.name_of(segment.id), statistics ? statistics->voxels : 0,
                         statistics ? statistics->volume_mm3 : 0};
    for (const LintFinding& finding : report.findings) {
      if (std::ranges::find(finding.structures, segment.id) == finding.structures.end()) continue;
      grade.faults += finding.severity == LintSeverity::kFault;
      grade.warnings += finding.severity == LintSeverity::kWarning;
      grade.undecided += finding.severity == LintSeverity::kUndetermined;
      if (finding.severity == LintSeverity::kFault) faults[segment.id].insert(finding.kind);
    }
    grade.grade = grade_of(faults[segment.id], grade.warnings);
    report.structures.push_back(std::move(grade));
  }
  constexpr double kReached = 0.9;
  for (const char letter : {'A', 'B', 'C', 'D'}) {
    report.grade = letter;
    const auto reach =
        std::ranges::count_if(report.structures, [&](const StructureGrade& s) { return s.grade <= letter; });
    if (static_cast<double>(reach) >= kReached * static_cast<double>(report.structures.size())) break;
  }
  const bool whole_map = std::ranges::any_of(report.findings, [](const LintFinding& f) {
    return f.severity == LintSeverity::kFault && f.structures.empty();
  });
  if (whole_map) report.grade = std::max(report.grade, 'C');
  return report;
}

}  // namespace

Result<LintReport> lint(const LabelMap& labels, const LintOptions& options, const Progress& progress) {
  using namespace internal;
  if (!(options.tool_radius_mm >= kMinLintToolRadius_mm && options.tool_radius_mm <= kMaxLintToolRadius_mm))
    return Error{ErrorKind::kBadInput,
                 "the tool's radius is outside " + figure(kMinLintToolRadius_mm, "") + " ... " +
                     figure(kMaxLintToolRadius_mm, "mm"),
                 "tool radius", ""};
  LintStudy study(labels, options, progress);
  const ProgressSpan all{"examining the labels"};
  check_names(study);
  check_sides(study);
  check_overlaps(study);
  check_slices(study);
  const auto layers = static_cast<double>(labels.layers.size());
  for (std::size_t n = 0; n < labels.layers.size(); ++n) {
    const auto at = static_cast<double>(n);
    if (auto done = check_shapes(study, n, all.part(0.5 * at / layers, 0.5 * (at + 1) / layers)); !done)
      return done.error();
  }
  const Volume<LabelId> flat = labels.flattened();
  if (auto done = check_gaps(study, flat, all.part(0.5, 0.65)); !done) return done.error();
  if (auto done = check_access(study, flat, all.part(0.65, 0.85)); !done) return done.error();
  if (auto done = check_body(study, flat, all.part(0.85, 1)); !done) return done.error();
  if (auto done = check_leaks(study, flat); !done) return done.error();
  if (progress.stopped()) return Progress::interrupted();
  return graded(study);
}

}  // namespace palpate
