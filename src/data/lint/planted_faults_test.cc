#include <gtest/gtest.h>

#include <functional>
#include <iostream>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "base/test_seed.h"
#include "lint/test_planted_faults.h"

namespace palpate {
namespace {

using test::LintCase;

struct Counts {
  int planted = 0, found = 0;
};

/// Plants each kind of fault into `maps` maps, with up to ten attempts per map.
/// @param fraction        minimum fraction of the planted faults that must be found
/// @param unplantable  names of the faults for which such a map has no space
void expect_found(const std::function<LintCase(unsigned)>& make, int maps, double fraction,
                  const std::set<std::string_view>& unplantable = {}) {
  const unsigned seed = test::test_seed();
  std::cout << "seed " << seed << '\n';
  std::vector<LintCase> clean;
  std::vector<LintReport> reports;
  for (int n = 0; n < maps; ++n) {
    clean.push_back(make(seed + static_cast<unsigned>(n)));
    auto report = clean.back().report();
    ASSERT_TRUE(report.ok()) << report.error().message();
    reports.push_back(*std::move(report));
  }
  for (const test::PlantedFault& fault : test::planted_faults()) {
    Counts counts;
    for (int n = 0; n < maps; ++n) {
      std::mt19937 random(seed + 1000u * static_cast<unsigned>(n));
      for (int attempt = 0; attempt < 10; ++attempt) {
        LintCase one = clean[static_cast<std::size_t>(n)];
        const auto structures = fault.plant(one, random);
        if (!structures) continue;
        const auto report = one.report();
        ASSERT_TRUE(report.ok());
        ++counts.planted;
        const bool found =
            test::is_found(*report, reports[static_cast<std::size_t>(n)], fault.kind, *structures);
        counts.found += found;
        if (!found) std::cout << "  missed " << fault.name << " in map " << n << '\n';
        break;
      }
    }
    std::cout << fault.name << ": " << counts.found << " of " << counts.planted << '\n';
    EXPECT_EQ(counts.planted, unplantable.contains(fault.name) ? 0 : maps) << fault.name;
    EXPECT_GE(counts.found, fraction * counts.planted) << fault.name;
  }
}

TEST(PlantedFaults, AreFoundOfEveryKind) {
  expect_found(test::organs_case, 2, 1);
}

TEST(PlantedFaults, TwentyOfEachKindAreFoundInOrgans) {
  expect_found(test::organs_case, 20, 0.95);
}

TEST(PlantedFaults, TwentyOfEachKindAreFoundInKnees) {
  // one knee has no left and right structures, and no air around it
  expect_found(test::knee_case, 20, 0.95, {"swapped sides", "mirrored", "outside body"});
}

/// Faults and warnings of a map, one per line.
std::vector<std::string> alarms_in(const LintReport& report, const std::set<LintKind>& but = {}) {
  std::vector<std::string> alarms;
  for (const LintFinding& finding : report.findings)
    if (finding.severity != LintSeverity::kUndetermined && !but.contains(finding.kind))
      alarms.push_back(finding.sentence);
  return alarms;
}

void expect_at_most_one_alarm(const std::function<LintCase(unsigned)>& make, unsigned maps,
                              const std::set<LintKind>& but = {}) {
  const unsigned seed = test::test_seed();
  std::size_t all = 0;
  for (unsigned n = 0; n < maps; ++n) {
    const auto report = make(seed + n).report();
    ASSERT_TRUE(report.ok());
    const auto alarms = alarms_in(*report, but);
    EXPECT_LE(alarms.size(), 1u) << "seed " << seed + n << ": " << ::testing::PrintToString(alarms);
    all += alarms.size();
  }
  std::cout << "seed " << seed << ": " << all << " alarms in " << maps << " maps\n";
}

TEST(PlantedFaults, CleanOrgansRaiseAtMostOneAlarm) {
  expect_at_most_one_alarm(test::organs_case, 4);
}

TEST(PlantedFaults, TwentyCleanOrgansRaiseAtMostOneAlarm) {
  expect_at_most_one_alarm(test::organs_case, 20);
}

// The knee is cut off at both ends, its joint spaces are one voxel wide and the rims of its cartilages taper
// off, so these findings are correct.
TEST(PlantedFaults, CleanKneesRaiseAtMostOneAlarm) {
  expect_at_most_one_alarm(test::knee_case, 5,
                           {LintKind::kCutByBorder, LintKind::kNarrowGap, LintKind::kOneVoxelSheet});
}

}  // namespace
}  // namespace palpate
