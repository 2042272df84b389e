#include "palpate/lint/lint.h"

#include <algorithm>
#include <map>
#include <set>

#include "lint/lint_context.h"

namespace palpate {
namespace {

using internal::figure;
using internal::LintContext;

void check_slices(LintContext& context) {
  constexpr double kThickSlices = 2.5;
  const Eigen::Vector3d& spacing = context.grid.spacing_mm;
  const double widest = spacing.maxCoeff(), ratio = widest / spacing.minCoeff();
  if (ratio < kThickSlices || context.statistics.empty()) return;
  context.add(
      LintKind::kTerraces, LintSeverity::kWarning, {}, {widest, "mm"},
      "slices are " + figure(widest, "mm") + " thick, " + figure(ratio, "") + " times the width of a voxel");
}

char grade_of(const std::set<LintKind>& faults, int warnings) {
  return faults.size() > 1 ? 'D' : faults.size() == 1 ? 'C' : warnings > 0 ? 'B' : 'A';
}

LintReport graded(LintContext& context) {
  LintReport report;
  report.findings = std::move(context.findings);
  std::ranges::stable_sort(report.findings, {},
                           [](const LintFinding& f) { return std::pair(f.severity, f.kind); });
  std::map<LabelId, std::set<LintKind>> faults;
  for (const Segment& segment : context.labels.segments) {
    const SegmentStatistics* statistics = context.statistics_of(segment.id);
    StructureGrade grade{segment.id, context.name_of(segment.id), statistics ? statistics->voxels : 0,
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
  LintContext context(labels, options, progress);
  const ProgressSpan all{"examining the labels"};
  check_names(context);
  check_sides(context);
  check_overlaps(context);
  check_slices(context);
  const auto layers = static_cast<double>(labels.layers.size());
  for (std::size_t n = 0; n < labels.layers.size(); ++n) {
    const auto at = static_cast<double>(n);
    if (auto done = check_shapes(context, n, all.part(0.5 * at / layers, 0.5 * (at + 1) / layers)); !done)
      return done.error();
  }
  const Volume<LabelId> flat = labels.flattened();
  if (auto done = check_gaps(context, flat, all.part(0.5, 0.65)); !done) return done.error();
  if (auto done = check_access(context, flat, all.part(0.65, 0.85)); !done) return done.error();
  if (auto done = check_body(context, flat, all.part(0.85, 1)); !done) return done.error();
  if (auto done = check_leaks(context, flat); !done) return done.error();
  if (progress.stopped()) return Progress::interrupted();
  return graded(context);
}

}  // namespace palpate
