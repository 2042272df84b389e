#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <set>

#include "base/test_docs.h"
#include "lint/test_planted_faults.h"

namespace palpate {
namespace {

using test::LintCase;

const LintFinding* finding_of(const LintReport& report, LintKind kind) {
  const auto at = std::ranges::find(report.findings, kind, &LintFinding::kind);
  return at == report.findings.end() ? nullptr : &*at;
}

TEST(Lint, EveryKindIsDescribed) {
  std::set<std::string_view> keys;
  for (const LintKindInfo& info : lint_kinds()) {
    EXPECT_EQ(&lint_kind(info.kind), &info);
    EXPECT_TRUE(keys.insert(info.key).second);
    EXPECT_TRUE(info.definition.ends_with("."));
    EXPECT_FALSE(info.effect.empty() || info.effect.ends_with("."));
    EXPECT_FALSE(info.remedy.empty() || info.remedy.ends_with("."));
  }
}

TEST(Lint, TheManualListsEveryKind) {
  test::check_docs_section(PALPATE_SOURCE_DIR, "guide/lint.md", "kinds", lint_kind_table());
}

TEST(Lint, SidesAreUndeterminedWithoutNames) {
  LintCase one = test::organs_case(1);
  for (Segment& segment : one.labels.segments)
    if (segment.name != "spine") segment.name = "organ " + std::to_string(segment.id);
  const auto report = one.report();
  ASSERT_TRUE(report.ok());
  const LintFinding* sides = finding_of(*report, LintKind::kSwappedSides);
  ASSERT_NE(sides, nullptr);
  EXPECT_EQ(sides->severity, LintSeverity::kUndetermined);
}

TEST(Lint, BodyIsUndeterminedWithoutScan) {
  const LintCase one = test::organs_case(1);
  const auto report = lint(one.labels, {});
  ASSERT_TRUE(report.ok());
  const LintFinding* body = finding_of(*report, LintKind::kOutsideBody);
  ASSERT_NE(body, nullptr);
  EXPECT_EQ(body->severity, LintSeverity::kUndetermined);
}

TEST(Lint, AMapWithoutStructuresIsAFault) {
  LabelMap empty;
  empty.layers.emplace_back(test::organs_case(1).labels.geometry());
  const auto report = lint(empty, {});
  ASSERT_TRUE(report.ok());
  ASSERT_EQ(report->findings.size(), 1u);
  EXPECT_EQ(report->findings.front().kind, LintKind::kNoVoxels);
  EXPECT_EQ(report->grade, 'C');
}

TEST(Lint, CountsEachVoxelOnTheBorderOnce) {
  // a block in a corner of the volume, 3 x 4 x 5 voxels of 1 mm
  GridGeometry grid;
  grid.dims = {12, 12, 12};
  LabelMap labels;
  labels.layers.emplace_back(grid);
  labels.segments = {{1, "block", {}, 0, 1}};
  for (int k = 0; k < 5; ++k)
    for (int j = 0; j < 4; ++j)
      for (int i = 0; i < 3; ++i) labels.layers[0].at(i, j, k) = 1;
  const auto report = lint(labels, {});
  ASSERT_TRUE(report.ok());
  const LintFinding* cut = finding_of(*report, LintKind::kCutByBorder);
  ASSERT_NE(cut, nullptr);
  EXPECT_EQ(cut->quantity, 4 * 5 + 3 * 5 + 3 * 4);
  EXPECT_EQ(cut->voxels, 3u * 4 * 5 - 2 * 3 * 4);
}

TEST(Lint, DoesNotDependOnThreads) {
  std::mt19937 random(5);
  LintCase one = test::organs_case(3);
  for (const auto& fault : test::planted_faults())
    if (fault.kind <= LintKind::kHoles) fault.plant(one, random);
  LintOptions options;
  options.scan = &one.scan;
  options.threads = 1;
  const auto once = lint(one.labels, options);
  options.threads = 3;
  const auto again = lint(one.labels, options);
  ASSERT_TRUE(once.ok() && again.ok());
  ASSERT_EQ(once->findings.size(), again->findings.size());
  for (std::size_t n = 0; n < once->findings.size(); ++n) {
    EXPECT_EQ(once->findings[n].sentence, again->findings[n].sentence);
    EXPECT_EQ(once->findings[n].voxel, again->findings[n].voxel);
  }
}

TEST(Lint, RepairedFaultsAreNotReportedAgain) {
  std::mt19937 random(7);
  LintCase one = test::organs_case(4);
  for (const auto& fault : test::planted_faults())
    if (lint_kind(fault.kind).is_repairable) {
      ASSERT_TRUE(fault.plant(one, random)) << fault.name;
    }
  const LabelMap before = one.labels;
  auto repaired = repaired_labels(one.labels);
  ASSERT_TRUE(repaired.ok());
  one.labels = repaired->labels;
  const auto report = one.report();
  ASSERT_TRUE(report.ok());
  for (const LintFinding& finding : report->findings)
    EXPECT_FALSE(finding.severity == LintSeverity::kFault && lint_kind(finding.kind).is_repairable)
        << finding.sentence;
  // the counts of the mends equal the number of changed voxels
  std::size_t changed = 0, declared = 0;
  for (std::size_t n = 0; n < before.layers[0].voxels().size(); ++n)
    changed += before.layers[0].voxels()[n] != one.labels.layers[0].voxels()[n];
  for (const LintRepair& repair : repaired->repairs) declared += repair.voxels;
  EXPECT_GT(changed, 0u);
  EXPECT_EQ(changed, declared);
  // a second call changes nothing
  const auto again = repaired_labels(one.labels);
  ASSERT_TRUE(again.ok());
  EXPECT_TRUE(again->repairs.empty());
}

TEST(Lint, GradesFollowFromFindings) {
  LintCase one = test::organs_case(2);
  const auto clean = one.report();
  ASSERT_TRUE(clean.ok());
  EXPECT_EQ(clean->grade, 'A');
  std::mt19937 random(3);
  std::optional<std::vector<LabelId>> hurt;
  for (const auto& fault : test::planted_faults())
    if (fault.kind == LintKind::kHoles) hurt = fault.plant(one, random);
  ASSERT_TRUE(hurt);
  const auto report = one.report();
  ASSERT_TRUE(report.ok());
  for (const StructureGrade& structure : report->structures)
    EXPECT_EQ(structure.grade, structure.id == hurt->front() ? 'C' : 'A') << structure.name;
}

TEST(Lint, ABadRadiusAndAnInterruptionAreErrors) {
  const LintCase one = test::organs_case(1);
  EXPECT_EQ(one.report(0).error().kind, ErrorKind::kBadInput);
  EXPECT_EQ(one.report(13).error().kind, ErrorKind::kBadInput);
  const std::atomic<bool> stop = true;
  EXPECT_EQ(lint(one.labels, {}, Progress({}, &stop)).error().kind, ErrorKind::kInterrupted);
  EXPECT_EQ(repaired_labels(one.labels, 0, Progress({}, &stop)).error().kind, ErrorKind::kInterrupted);
}

}  // namespace
}  // namespace palpate
