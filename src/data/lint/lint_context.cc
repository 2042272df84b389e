#include "lint/lint_context.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "palpate/base/for_each_index.h"

namespace palpate::internal {

LintContext::LintContext(const LabelMap& map, const LintOptions& input, const Progress& how_far)
    : labels(map),
      options(input),
      progress(how_far),
      grid(map.geometry()),
      workers(worker_count(input.threads, std::max(1, map.geometry().dims[2]))),
      statistics(segment_statistics(map)) {}

const SegmentStatistics* LintContext::statistics_of(LabelId id) const {
  const auto at = std::ranges::lower_bound(statistics, id, {}, &SegmentStatistics::id);
  return at != statistics.end() && at->id == id ? &*at : nullptr;
}

std::string LintContext::name_of(LabelId id) const {
  const Segment* segment = labels.find(id);
  return segment == nullptr || segment->name.empty() ? "label " + std::to_string(id) : segment->name;
}

std::string LintContext::names_of(const std::vector<LabelId>& ids) const {
  constexpr std::size_t kMaxNamed = 5;
  std::string text;
  for (std::size_t n = 0; n < std::min(ids.size(), kMaxNamed); ++n)
    text += (n == 0 ? "" : ids.size() <= kMaxNamed && n + 1 == ids.size() ? " and " : ", ") + name_of(ids[n]);
  if (ids.size() > kMaxNamed) text += " and " + std::to_string(ids.size() - kMaxNamed) + " more";
  return text;
}

Point<Patient> LintContext::position_of(const std::array<int, 3>& voxel) const {
  return grid.X_PatientVoxel() * Point<Voxel>(voxel[0], voxel[1], voxel[2]);
}

double LintContext::face_mm2(std::size_t axis) const {
  return grid.voxel_volume_mm3() / grid.spacing_mm[static_cast<Eigen::Index>(axis)];
}

void LintContext::add(LintKind kind, LintSeverity severity, std::vector<LabelId> structures,
                      const Extent& extent, std::string sentence) {
  LintFinding finding;
  finding.kind = kind;
  finding.severity = severity;
  finding.structures = std::move(structures);
  finding.quantity = extent.quantity;
  finding.unit = extent.unit;
  finding.voxels = extent.voxels;
  if (extent.voxel) {
    finding.voxel = *extent.voxel;
    finding.position = position_of(*extent.voxel);
  }
  finding.sentence = std::move(sentence);
  findings.push_back(std::move(finding));
}

std::string figure(double value, std::string_view unit) {
  char text[64];
  if (std::abs(value) >= 1000)
    std::snprintf(text, sizeof text, "%.0f", value);
  else
    std::snprintf(text, sizeof text, "%.3g", value);
  return unit.empty() ? std::string(text) : std::string(text) + " " + std::string(unit);
}

std::string counted(std::size_t count, std::string_view noun) {
  return std::to_string(count) + " " + std::string(noun) + (count == 1 ? "" : "s");
}

}  // namespace palpate::internal
