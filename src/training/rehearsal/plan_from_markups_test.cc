#include "palpate/rehearsal/plan_from_markups.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace palpate {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::StartsWith;

// oblique to all patient axes
constexpr const char* kPointsRas =
    R"({"label": "L-1", "position": [-10.25, 20.5, 30], "positionStatus": "defined"},
       {"label": "L-2", "position": [-4, 11.125, 3.5], "positionStatus": "defined"})";
constexpr const char* kPointsLps =
    R"({"label": "L-1", "position": [10.25, -20.5, 30]}, {"label": "L-2", "position": [4, -11.125, 3.5]})";

std::string markups_of(const std::string& type, const std::string& axes, const std::string& points,
                       const std::string& more = "") {
  return R"({"markups": [{"type": ")" + type + R"(", )" + more + R"("coordinateSystem": ")" + axes +
         R"(", "coordinateUnits": "mm", "controlPoints": [)" + points + "]}]}";
}

std::string refused_markups(const std::string& text) {
  const auto made = plan_from_markups(text, "plan", "m.mrk.json");
  return made ? "accepted" : made.error().message();
}

TEST(PlanFromMarkups, LinesInEitherSystemAreTheSameTrajectory) {
  const Point<Patient> entry(10.25, -20.5, 30), target(4, -11.125, 3.5);
  for (const auto& [axes, points] : {std::pair("RAS", kPointsRas), std::pair("LPS", kPointsLps),
                                     std::pair("0", kPointsRas), std::pair("1", kPointsLps)}) {
    SCOPED_TRACE(axes);
    const auto made = plan_from_markups(markups_of("Line", axes, points), "Knee", "m.mrk.json");
    ASSERT_TRUE(made) << made.error().message();
    EXPECT_EQ(made->plan.title, "Knee");
    ASSERT_EQ(made->plan.trajectories.size(), 1u);
    EXPECT_EQ(made->plan.trajectories[0].name, "L");
    EXPECT_EQ(made->plan.trajectories[0].entry, entry);
    EXPECT_EQ(made->plan.trajectories[0].target, target);
    EXPECT_TRUE(made->left_out.empty());
    // the result is a valid plan file
    const auto again = parse_plan(plan_text(made->plan), "plan.toml");
    ASSERT_TRUE(again) << again.error().message();
    EXPECT_EQ(again->trajectories[0].target, target);
  }
}

TEST(PlanFromMarkups, PointsCalledEntryAndTarget) {
  const auto made = plan_from_markups(
      markups_of("Fiducial", "RAS",
                 R"({"label": "TARGET", "position": [4, 5, 6]}, {"label": "F-3", "position": [0, 0, 0]},
                    {"label": "entry", "position": [1, 2, 3]},
                    {"label": "Entry", "position": [9, 9, 9], "positionStatus": "undefined"})"),
      "plan", "m.mrk.json");
  ASSERT_TRUE(made) << made.error().message();
  ASSERT_EQ(made->plan.trajectories.size(), 1u);
  EXPECT_EQ(made->plan.trajectories[0].entry, Point<Patient>(-1, -2, 3));
  EXPECT_EQ(made->plan.trajectories[0].target, Point<Patient>(-4, -5, 6));
  EXPECT_THAT(made->left_out, ElementsAre("F-3"));
}

TEST(PlanFromMarkups, NamesAreTheMarkupsOwnAndDiffer) {
  const std::string one =
      std::string(R"({"type": "Line", "name": "Screw", "controlPoints": [)") + kPointsLps + "]}";
  const std::string bare =
      R"({"type": "Line", "controlPoints": [{"position": [1, 2, 3]}, {"position": [4, 5, 6]}]})";
  const auto made = plan_from_markups("{\"markups\": [" + one + ", " + one + ", " + bare + "]}", "plan", "m");
  ASSERT_TRUE(made) << made.error().message();
  ASSERT_EQ(made->plan.trajectories.size(), 3u);
  EXPECT_EQ(made->plan.trajectories[0].name, "Screw");
  EXPECT_EQ(made->plan.trajectories[1].name, "Screw 2");
  EXPECT_EQ(made->plan.trajectories[2].name, "trajectory 3");
}

TEST(PlanFromMarkups, RejectsMarkupsThatAreNoTrajectoriesByName) {
  for (const char* type : {"Curve", "ClosedCurve", "ROI", "Plane", "Angle"})
    EXPECT_THAT(refused_markups(markups_of(type, "LPS", kPointsLps)),
                AllOf(StartsWith("m.mrk.json: a markup is a " + std::string(type)), HasSubstr("a Line")));
  EXPECT_THAT(refused_markups(R"({"markups": [{"controlPoints": []}]})"),
              HasSubstr("does not state its type"));
  const std::string one = R"({"label": "Entry", "position": [1, 2, 3]})";
  EXPECT_THAT(refused_markups(markups_of("Line", "LPS", one)), HasSubstr("a Line has 1 points, not 2"));
  EXPECT_THAT(refused_markups(markups_of("Line", "LPS", std::string(kPointsLps) + ", " + one)),
              HasSubstr("a Line has 3 points"));
  EXPECT_THAT(refused_markups(markups_of("Fiducial", "LPS", one)),
              AllOf(HasSubstr("no point is called Target"), HasSubstr("two points called Entry and Target")));
  EXPECT_THAT(refused_markups(markups_of("Fiducial", "LPS", R"({"label": "target", "position": [1, 2, 3]})")),
              HasSubstr("no point is called Entry"));
  EXPECT_THAT(refused_markups(markups_of("Fiducial", "LPS", kPointsLps)),
              HasSubstr("no point is called Entry or Target"));
  EXPECT_THAT(refused_markups(markups_of("Fiducial", "LPS", one + ", " + one)),
              HasSubstr("2 points are called Entry"));
  EXPECT_THAT(refused_markups(
                  markups_of("Fiducial", "LPS", one + R"(, {"label": "Target", "position": [1, 2, 3.01]})")),
              AllOf(HasSubstr("the same place"), HasSubstr("0.1 mm")));
  EXPECT_THAT(refused_markups(markups_of("Line", "IJK", kPointsLps)), HasSubstr("\"IJK\""));
  EXPECT_THAT(refused_markups(markups_of("Line", "LPS", R"({"position": [1, 2]})")),
              HasSubstr("three numbers"));
  EXPECT_THAT(refused_markups("{"), HasSubstr("not a JSON file"));
}

}  // namespace
}  // namespace palpate
