#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <filesystem>
#include <fstream>

#include "palpate/verification/verification.h"
#include "verification/machine.h"

namespace palpate {
namespace {

using ::testing::HasSubstr;
using ::testing::MatchesRegex;

TEST(Suites, AreListedWithALineEach) {
  const auto suites = verification_suites();
  ASSERT_FALSE(suites.empty());
  EXPECT_EQ(suites.front().first, "contact") << "the default method first";
  for (const auto& [name, line] : suites) EXPECT_FALSE(line.empty()) << name;
}

TEST(Suites, AnUnknownOneIsAnErrorThatNamesThoseThereAre) {
  const auto report = run_suite("acuracy");
  ASSERT_FALSE(report.ok());
  EXPECT_EQ(report.error().kind, ErrorKind::kUsage);
  EXPECT_THAT(report.error().what, HasSubstr("'acuracy'"));
  for (const auto& suite : verification_suites()) EXPECT_THAT(report.error().remedy, HasSubstr(suite.first));
}

TEST(Suites, AnOptionThatASuiteDoesNotTakeIsRefusedByName) {
  SuiteOptions seconds, spin, rate, scene;
  seconds.seconds = 1;
  spin.spin_us = 1;
  rate.rate_hz = 1000;
  scene.scene = "knee-phantom";
  const std::pair<const char*, SuiteOptions> cases[] = {
      {"--seconds", seconds}, {"--spin", spin}, {"--rate", rate}, {"--scene", scene}};
  for (const auto& [option, options] : cases) {
    const auto report = run_suite("accuracy", options);
    ASSERT_FALSE(report.ok()) << option;
    EXPECT_EQ(report.error().kind, ErrorKind::kUsage);
    EXPECT_THAT(report.error().what, HasSubstr("'accuracy' takes no " + std::string(option)));
  }
}

TEST(Suites, MeasuredCurvesAreComparedWithTheirPresets) {
  EXPECT_EQ(run_suite("outside").error().kind, ErrorKind::kUsage);
  SuiteOptions options;
  options.curves = std::filesystem::path(::testing::TempDir()) / "suites_test_curves.csv";
  std::ofstream file(*options.curves);
  file << "depth_mm,force_N,curve,radius_mm,preset\n";
  // by Hertz, 20 kPa, nu 0.45
  for (int n = 1; n <= 20; ++n)
    file << 0.1 * n << "," << 4.0 / 3 * 0.02 / (1 - 0.45 * 0.45) * 2 * std::pow(0.1 * n, 1.5) << ",a,4,fat\n";
  file.close();
  const auto report = run_suite("outside", options);
  ASSERT_TRUE(report.ok()) << report.error().what;
  const auto value = [&](const std::string& name) {
    for (const Figure& figure : report->figures)
      if (figure.name == "outside/a/" + name) return figure.value;
    return -1.0;
  };
  EXPECT_EQ(value("inside-band"), 100);
  EXPECT_NEAR(value("modulus"), 20, 1);
  EXPECT_EQ(value("stiffening"), 0);
  EXPECT_NEAR(value("end-force-over-preset"), 20 / 9.1, 0.1);
  EXPECT_EQ(run_suite("contact", options).error().kind, ErrorKind::kUsage);
}

TEST(Suites, AKnownOneRunsAndCanBeInterrupted) {
  const std::atomic<bool> stop = true;
  const auto report = run_suite("accuracy", {}, Progress({}, &stop));
  ASSERT_FALSE(report.ok());
  EXPECT_EQ(report.error().kind, ErrorKind::kInterrupted);
}

TEST(Machine, IsDescribedByProcessorCoresAndSimdTarget) {
  EXPECT_THAT(machine_description(), MatchesRegex("..*, [0-9]+ cores?, SIMD [A-Z].*"));
}

TEST(Machine, BuildIsDescribedByVersionCommitTypeAndCompiler) {
  EXPECT_THAT(build_description(),
              MatchesRegex("palpate [0-9.]+, commit [0-9a-z+]+, [A-Za-z]*, [A-Za-z]+ [0-9.]+.*"));
}

TEST(Machine, ADateIsYearMonthAndDay) {
  EXPECT_THAT(today(), MatchesRegex("20[0-9][0-9]-[01][0-9]-[0-3][0-9]"));
}

}  // namespace
}  // namespace palpate
