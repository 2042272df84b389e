#include "palpate/navigation/result_files.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "base/test_seed.h"
#include "navigation/test_poses.h"

namespace palpate {
namespace {

using ::testing::HasSubstr;

PivotCalibration some_pivot() {
  PivotCalibration pivot;
  pivot.tip = {-17.8, 1.1, -156.9};
  pivot.is_outlier = {false, true, false};
  pivot.used = 2;
  pivot.rms_mm = 0.3;
  pivot.tip_error_mm = 0.125;
  return pivot;
}

RegistrationOutcome some_outcome(std::mt19937& random) {
  std::vector<PointPair> pairs;
  const Rotation<Tracker, Patient> turn(test::any_rotation(random));
  for (int n = 0; n < 6; ++n) {
    const Point<Patient> at(40 * test::normal(random));
    pairs.push_back({"P" + std::to_string(n), at,
                     Transform<Tracker, Patient>(turn, Vector<Tracker>(1, 2, 3)) * at +
                         Vector<Tracker>(0.3 * test::normal(random)),
                     1});
  }
  auto found = register_points(pairs);
  PALPATE_CHECK(found.ok());
  RegistrationOutcome outcome;
  outcome.by_points = *std::move(found);
  for (const PointPair& pair : pairs) outcome.names.push_back(pair.name);
  outcome.fle_scale = outcome.by_points.fle_scale;
  outcome.targets = {{10, 20, 30}};
  outcome.reference = "ReferenceToTracker";
  return outcome;
}

TEST(ResultFiles, AreReadAsTheyWereWritten) {
  const auto tip = parse_tip(tip_text(some_pivot()), "tip.json");
  ASSERT_TRUE(tip) << tip.error().message();
  EXPECT_EQ(tip->at.eigen(), some_pivot().tip.eigen());
  EXPECT_EQ(tip->error_mm, 0.125);
  EXPECT_EQ(tip->scatter_mm, 0.3);

  std::mt19937 random(test::test_seed());
  SCOPED_TRACE("seed " + std::to_string(test::test_seed()));
  const RegistrationOutcome outcome = some_outcome(random);
  const auto patient = parse_registration(registration_text(outcome), "registration.json");
  ASSERT_TRUE(patient) << patient.error().message();
  EXPECT_EQ(patient->patient_from_tracker.linear(), outcome.by_points.patient_from_tracker.linear());
  EXPECT_EQ(patient->fre_mm, outcome.by_points.fre_mm);
  EXPECT_EQ(patient->reference, "ReferenceToTracker");
  ASSERT_TRUE(patient->error);
  EXPECT_EQ(patient->error->covariance, rigid_error(outcome.by_points, *outcome.fle_scale).covariance);

  // if the points fit exactly, the error is unknown
  RegistrationOutcome exact = some_outcome(random);
  exact.fle_scale.reset();
  const auto unknown = parse_registration(registration_text(exact), "registration.json");
  ASSERT_TRUE(unknown);
  EXPECT_FALSE(unknown->error);
  EXPECT_FALSE(error_of_tip({*tip, *unknown}, {}));
}

// the three variances add up, and is_far depends on the registration's only
TEST(ErrorOfTip, IsTheSumOfItsParts) {
  std::mt19937 random(test::test_seed());
  SCOPED_TRACE("seed " + std::to_string(test::test_seed()));
  const RegistrationOutcome outcome = some_outcome(random);
  const RigidError error = rigid_error(outcome.by_points, *outcome.fle_scale);
  const Navigation navigation{{{}, 0.5, 1.2}, {{}, 0, error, ""}};
  for (const Point<Patient>& position :
       {error.about, Point<Patient>(10, 20, 30), Point<Patient>(400, 0, 0)}) {
    const auto found = error_of_tip(navigation, position);
    ASSERT_TRUE(found);
    const double alone_mm = error_at(error, position).rms_mm;
    EXPECT_NEAR(found->rms_mm, std::sqrt(alone_mm * alone_mm + 0.25 + 1.44), 1e-9);
    EXPECT_GT(found->max_mm, found->rms_mm);
    EXPECT_EQ(found->is_far, alone_mm > 2 * error_at(error, error.about).rms_mm);
  }
  EXPECT_FALSE(error_of_tip(navigation, error.about)->is_far);
  EXPECT_TRUE(error_of_tip(navigation, {400, 0, 0})->is_far);
  // for an error-free tool the error equals the TRE in the registration file
  const auto exact = error_of_tip({{}, {{}, 0, error, ""}}, {10, 20, 30});
  EXPECT_EQ(exact->max_mm, error_at(error, {10, 20, 30}).max_mm);
}

TEST(ResultFiles, RejectsOtherFiles) {
  const auto tip = [](const char* text) {
    const auto read = parse_tip(text, "tip.json");
    return read ? std::string("taken") : read.error().message();
  };
  EXPECT_THAT(tip("{"), HasSubstr("tip.json: is not a file of a tool's tip"));
  EXPECT_THAT(tip("{}"), HasSubstr("tip_mm"));
  EXPECT_THAT(tip(R"({"tip_mm": [1, 2, "3"]})"), HasSubstr("tip_mm"));
  EXPECT_THAT(tip(R"({"tip_mm": [1, 2, 1e9], "tip_error_mm": 0, "rms_mm": 0})"), HasSubstr("tip_mm"));
  EXPECT_THAT(tip(R"({"tip_mm": [1, 2, 3], "tip_error_mm": -1, "rms_mm": 0})"), HasSubstr("tip_error_mm"));

  const auto registration = [](const std::string& text) {
    const auto read = parse_registration(text, "r.json");
    return read ? std::string("taken") : read.error().message();
  };
  const std::string rigid =
      R"({"patient_from_tracker": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], )";
  EXPECT_THAT(registration("7"), HasSubstr("r.json: is not a file of a registration"));
  EXPECT_THAT(
      registration(R"({"patient_from_tracker": [[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]})"),
      HasSubstr("rigid transform"));
  EXPECT_THAT(registration(rigid + R"("x": 1})"), HasSubstr("has no by_points"));
  EXPECT_THAT(registration(rigid + R"("by_points": {}})"), HasSubstr("fre_mm"));
  EXPECT_THAT(registration(rigid + R"("by_points": {"fre_mm": 1, "covariance": [1]}})"),
              HasSubstr("covariance"));
  EXPECT_THAT(registration(rigid + R"("by_points": {"fre_mm": 1}, "reference": 1})"),
              HasSubstr("an invalid name"));
  EXPECT_EQ(registration(rigid + R"("by_points": {"fre_mm": 1}})"), "taken")
      << "of before errors were written";
  // a covariance with a negative eigenvalue
  std::string rows;
  for (int r = 0; r < 6; ++r) {
    rows += r ? ", [" : "[";
    for (int c = 0; c < 6; ++c) rows += std::string(c ? ", " : "") + (r == c ? (r == 4 ? "-1" : "1") : "0");
    rows += "]";
  }
  EXPECT_THAT(registration(rigid + R"("by_points": {"fre_mm": 1, "centroid_mm": [0, 0, 0], "covariance": [)" +
                           rows + "]}}"),
              HasSubstr("covariance"));
}

}  // namespace
}  // namespace palpate
