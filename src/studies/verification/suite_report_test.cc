#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "palpate/verification/verification.h"

namespace palpate {
namespace {

using ::testing::HasSubstr;

SuiteReport example() {
  return {"accuracy",
          "some \"processor\"",
          "some build",
          "2026-11-27",
          {{"scheduler", "some scheduler"}},
          {{"a/direction/mean", 0.6612345, "deg", 4000, 0.8},
           {"a/direction/p99", 3.7, "deg", 4000, 3.0},
           {"a/direction/max", 5.25, "deg", 4000, {}},
           {"b/time", 12.5, "us", 7, {}}}};
}

TEST(Figure, IsWithinItsLimitUpToAndIncludingIt) {
  Figure figure{"x", 2, "deg", 1, 2.0};
  EXPECT_TRUE(figure.ok());
  figure.value = 2.0000001;
  EXPECT_FALSE(figure.ok());
  figure.limit.reset();
  EXPECT_TRUE(figure.ok());
}

TEST(SuiteReport, IsOkWhenEveryFigureIs) {
  SuiteReport report = example();
  EXPECT_FALSE(report.ok());
  report.figures[1].value = 2.9;
  EXPECT_TRUE(report.ok());
}

TEST(SuiteReport, JsonHoldsEverythingInOrder) {
  const auto json = nlohmann::ordered_json::parse(to_json(example()));
  EXPECT_EQ(json["suite"], "accuracy");
  EXPECT_EQ(json["machine"], "some \"processor\"");
  EXPECT_EQ(json["build"], "some build");
  EXPECT_EQ(json["date"], "2026-11-27");
  EXPECT_EQ(json["notes"]["scheduler"], "some scheduler");
  EXPECT_EQ(json.size(), 6u);
  const auto& figures = json["figures"];
  ASSERT_EQ(figures.size(), 4u);
  EXPECT_EQ(figures.begin().key(), "a/direction/mean");
  EXPECT_EQ(figures["a/direction/mean"]["value"], 0.6612345);
  EXPECT_EQ(figures["a/direction/mean"]["unit"], "deg");
  EXPECT_EQ(figures["a/direction/mean"]["n"], 4000);
  EXPECT_EQ(figures["a/direction/mean"]["limit"], 0.8);
  EXPECT_FALSE(figures["b/time"].contains("limit"));
}

TEST(SuiteReport, JsonSurvivesBytesThatAreNoUtf8) {
  SuiteReport report = example();
  report.machine = "cpu \xff\xfe";
  EXPECT_TRUE(nlohmann::json::accept(to_json(report)));
}

TEST(SuiteReport, TableGroupsFiguresAndNamesExceededLimits) {
  const std::string table = to_table(example());
  EXPECT_THAT(table, HasSubstr("figure        mean     p99     max   unit     n\n"
                               "a/direction  0.661   3.700!  5.250    deg  4000\n"
                               "\n"
                               "figure    time   unit  n\n"
                               "b       12.500     us  7\n"));
  EXPECT_THAT(table, HasSubstr("1 of 2 limits kept\nbeyond its limit: a/direction/p99 3.7 > 3 deg\n"));
  EXPECT_THAT(table, HasSubstr("some \"processor\""));
  EXPECT_THAT(table, HasSubstr("build      some build\nscheduler  some scheduler\n"));
}

TEST(SuiteReport, ManyFiguresAreLaidOutByTheirFirstPartWithTheirQuantitiesSideBySide) {
  SuiteReport report;
  for (const char* method : {"a", "b-spline"}) {
    for (int n = 0; n < 15; ++n) {
      const std::string path = std::string(method) + "/ball/" + std::to_string(n);
      report.figures.push_back({path + "/direction/mean", 0.25 + n, "deg", 9, 1.5});
      report.figures.push_back({path + "/direction/max", 123.5, "deg", 9, {}});
      if (n == 1) report.figures.push_back({path + "/change-at-half-voxels/max", 7, "percent", 5, {}});
    }
  }
  // a short report is a single table, as before
  SuiteReport few = report;
  few.figures.resize(20);
  EXPECT_THAT(to_table(few), HasSubstr("\nfigure                           mean       max      unit  n\n"));

  for (int n = 15; n < 40; ++n)
    report.figures.push_back({"b-spline/ball/" + std::to_string(n) + "/direction/mean", 0.5, "deg", 9, {}});
  const std::string table = to_table(report);
  EXPECT_THAT(table, HasSubstr("\n"
                               "            direction, deg   change-at-half-voxels, percent\n"
                               "a           mean       max                              max\n"
                               "ball/0     0.250   123.500\n"
                               "ball/1     1.250   123.500                            7.000\n"
                               "ball/2     2.250!  123.500\n"));
  EXPECT_THAT(table, HasSubstr("\nb-spline     mean       max                              max\n"
                               "ball/0      0.250   123.500\n"));
  EXPECT_THAT(table, HasSubstr("ball/39     0.500\n"));
  EXPECT_THAT(table, HasSubstr("beyond its limit: b-spline/ball/14/direction/mean 14.25 > 1.5 deg\n"));
}

// a long table of names with too few parts for a WideTable
TEST(SuiteReport, ManyFiguresOfShortNamesStandOneBelowTheOther) {
  SuiteReport report;
  for (int n = 0; n < 60; ++n)
    report.figures.push_back({"loop-" + std::to_string(n) + "/time", 1.0 * n, "us", 9, {}});
  EXPECT_THAT(to_table(report), HasSubstr("\nloop-59  59.000     us  9\n"));
}

TEST(SuiteReport, IsWrittenAtomically) {
  const auto folder = std::filesystem::path(::testing::TempDir()) / "palpate_suite_report_test";
  std::filesystem::create_directories(folder);
  const auto file = folder / "figures.json";
  ASSERT_TRUE(write_json(file, example()).ok());
  std::ifstream stream(file);
  const std::string text{std::istreambuf_iterator<char>(stream), {}};
  EXPECT_EQ(text, to_json(example()));

  const auto refused = write_json(folder / "missing" / "figures.json", example());
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.error().kind, ErrorKind::kOutput);
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace palpate
