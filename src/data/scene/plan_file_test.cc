#include "palpate/scene/plan_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "base/test_seed.h"

namespace palpate {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::StartsWith;

constexpr const char* kWholePlan = R"(title = "Tunnel"
[[trajectory]]
name = "way in"
entry = [1, 2, 3.5]
target = [1, 2, -26.5]
enters = ["femur", 12]
entry_within = 2
target_within = 1.5
angle_within = 5
depth_within = 3
[[region]]
name = "hole"
shape = "cylinder"
trajectory = "way in"
radius = 4
from = -2
depth = 20
structures = ["femur"]
[[region]]
name = "nodule"
structures = ["nodule"]
[[region]]
name = "end"
shape = "sphere"
trajectory = "way in"
radius = 6
[[region]]
name = "slot"
shape = "box"
trajectory = "way in"
width = 8
height = 3
across = [1, 0, 1]
[[keep_away]]
structures = ["nerve", 7]
distance = 2.5
)";

std::string refused_plan(const std::string& text) {
  const auto plan = parse_plan(text, "plan.toml");
  return plan ? "accepted" : plan.error().message();
}

/// kWholePlan with one substring replaced.
std::string changed_plan(const std::string& from, const std::string& to) {
  std::string text = kWholePlan;
  const std::size_t at = text.find(from);
  PALPATE_CHECK(at != std::string::npos);
  return text.replace(at, from.size(), to);
}

TEST(ParsePlan, ReadsEveryKey) {
  const auto plan = parse_plan(kWholePlan, "plan.toml");
  ASSERT_TRUE(plan) << plan.error().message();
  EXPECT_EQ(plan->title, "Tunnel");
  ASSERT_EQ(plan->trajectories.size(), 1u);
  const PlanTrajectory& trajectory = plan->trajectories[0];
  EXPECT_EQ(trajectory.name, "way in");
  EXPECT_EQ(trajectory.entry, Point<Patient>(1, 2, 3.5));
  EXPECT_EQ(trajectory.target, Point<Patient>(1, 2, -26.5));
  EXPECT_THAT(trajectory.enters, ElementsAre(LabelReference("femur"), LabelReference(12)));
  EXPECT_EQ(trajectory.entry_within_mm, 2);
  EXPECT_EQ(trajectory.target_within_mm, 1.5);
  EXPECT_EQ(trajectory.angle_within_deg, 5);
  EXPECT_EQ(trajectory.depth_within_mm, 3);
  EXPECT_EQ(trajectory.length_mm(), 30);
  EXPECT_EQ(trajectory.axis(), Vector<Patient>(0, 0, -1));
  ASSERT_EQ(plan->regions.size(), 4u);
  const PlanRegion& hole = plan->regions[0];
  EXPECT_EQ(hole.shape, PlanShape::kCylinder);
  EXPECT_EQ(hole.radius_mm, 4);
  EXPECT_EQ(hole.from_mm, -2);
  EXPECT_EQ(hole.depth_mm, 20);
  EXPECT_THAT(hole.structures, ElementsAre(LabelReference("femur")));
  EXPECT_EQ(plan->regions[1].shape, PlanShape::kStructures);
  // default depth: the target
  EXPECT_EQ(plan->regions[2].depth_mm, 30);
  // orthogonalised
  EXPECT_LT((plan->regions[3].across - Vector<Patient>(1, 0, 0)).norm(), 1e-12);
  EXPECT_EQ(plan->regions[3].height_mm, 3);
  ASSERT_EQ(plan->distances.size(), 1u);
  EXPECT_EQ(plan->distances[0].distance_mm, 2.5);
}

TEST(ParsePlan, KeepsTheCommentsAtItsBeginning) {
  const std::string heading = "# For Monday's list.\n\n  # Second line, not \"title\"\r\n";
  const auto plan = parse_plan(heading + "\n" + kWholePlan + "\n# the end\n", "plan.toml");
  ASSERT_TRUE(plan) << plan.error().message();
  EXPECT_EQ(plan->heading, heading);
  EXPECT_EQ(plan_text(*plan).substr(0, heading.size() + 8), heading + "title = ");
  EXPECT_EQ(parse_plan(plan_text(*plan), "again.toml")->heading, heading);
  EXPECT_EQ(parse_plan(kWholePlan, "plan.toml")->heading, "");
}

TEST(ParsePlan, IsWrittenAndReadAgainToTheLastBit) {
  const auto plan = parse_plan(kWholePlan, "plan.toml");
  ASSERT_TRUE(plan);
  const std::string text = plan_text(*plan);
  const auto again = parse_plan(text, "again.toml");
  ASSERT_TRUE(again) << again.error().message() << "\n" << text;
  EXPECT_EQ(plan_text(*again), text);
  // negative zero is written as 0
  const auto zero = parse_plan(changed_plan("entry = [1, 2, 3.5]", "entry = [-0.0, 2, 3.5]"), "plan.toml");
  ASSERT_TRUE(zero);
  EXPECT_THAT(plan_text(*zero), HasSubstr("entry = [0, 2, 3.5]"));

  const auto seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> coordinate(-300, 300), part(0.2, 30);
  for (int n = 0; n < 200; ++n) {
    PlanFile made;
    made.title = "a \"quoted\"\ntitle \\ ü";
    const auto point = [&] {
      return Point<Patient>(coordinate(random), coordinate(random), coordinate(random));
    };
    made.trajectories.push_back({"t\t1", point(), point(), {"a", 5}, part(random), {}, part(random), {}, 0});
    const Vector<Patient> axis = made.trajectories[0].axis();
    Vector<Patient> across = Vector<Patient>(1, 0.3, -0.2);
    across = (across - axis * across.dot(axis)).normalized();
    made.regions.push_back({"box",
                            PlanShape::kBox,
                            0,
                            {},
                            0,
                            -part(random),
                            part(random),
                            part(random),
                            part(random),
                            across,
                            0});
    made.distances.push_back({{"nerve"}, part(random), 0});
    const auto read = parse_plan(plan_text(made), "made.toml");
    ASSERT_TRUE(read) << read.error().message() << "\n" << plan_text(made);
    EXPECT_EQ(read->title, made.title);
    EXPECT_EQ(read->trajectories[0].name, made.trajectories[0].name);
    EXPECT_EQ(read->trajectories[0].entry, made.trajectories[0].entry);
    EXPECT_EQ(read->trajectories[0].target, made.trajectories[0].target);
    EXPECT_EQ(read->trajectories[0].entry_within_mm, made.trajectories[0].entry_within_mm);
    EXPECT_EQ(read->trajectories[0].target_within_mm, std::nullopt);
    EXPECT_EQ(read->regions[0].across, across);
    EXPECT_EQ(read->regions[0].from_mm, made.regions[0].from_mm);
    EXPECT_EQ(read->regions[0].width_mm, made.regions[0].width_mm);
    EXPECT_EQ(read->distances[0].distance_mm, made.distances[0].distance_mm);
  }
}

TEST(ParsePlan, EveryErrorHasLineAndRemedy) {
  EXPECT_THAT(refused_plan("[[trajectory]]\nname = \"a\"\nentry = [0,0,0]\ntarget = [0,0,9]\n"),
              AllOf(StartsWith("plan.toml:1: the plan has no title"), HasSubstr("title = ")));
  EXPECT_THAT(refused_plan("title = \"a\"\n"),
              AllOf(HasSubstr("the plan is empty"), HasSubstr("add a [[trajectory]]")));
  EXPECT_THAT(refused_plan(changed_plan("entry = [1, 2, 3.5]\n", "")),
              AllOf(StartsWith("plan.toml:2: "), HasSubstr("without entry")));
  EXPECT_THAT(refused_plan(changed_plan("target = [1, 2, -26.5]", "target = [1, 2, 3.45]")),
              AllOf(StartsWith("plan.toml:5: entry and target are the same place"), HasSubstr("0.1 mm")));
  EXPECT_THAT(
      refused_plan(changed_plan("target = [1, 2, -26.5]", "target = [1, 2, -1026.5]")),
      AllOf(StartsWith("plan.toml:5: entry and target are 1030 mm apart"), HasSubstr("1000 mm long")));
  EXPECT_THAT(refused_plan(changed_plan("target = [1, 2, -26.5]", "target = [1, 2]")),
              StartsWith("plan.toml:5: "));
  EXPECT_THAT(refused_plan(changed_plan("target = [1, 2, -26.5]", "target = [1, 2, nan]")),
              StartsWith("plan.toml:5: "));
  EXPECT_THAT(refused_plan(changed_plan("entry_within", "entry_whitin")),
              AllOf(StartsWith("plan.toml:7: "), HasSubstr("did you mean entry_within?")));
  EXPECT_THAT(refused_plan(changed_plan("angle_within = 5", "angle_within = 91")),
              AllOf(StartsWith("plan.toml:9: "), HasSubstr("outside 0.1 ... 90 degrees")));
  EXPECT_THAT(refused_plan(changed_plan("trajectory = \"way in\"", "trajectory = \"wayin\"")),
              AllOf(StartsWith("plan.toml:14: there is no trajectory \"wayin\""),
                    HasSubstr("did you mean \"way in\"?")));
  EXPECT_THAT(refused_plan(changed_plan("shape = \"cylinder\"", "shape = \"cylinde\"")),
              AllOf(StartsWith("plan.toml:13: "), HasSubstr("cylinder")));
  EXPECT_THAT(refused_plan(changed_plan("radius = 4\n", "")),
              AllOf(StartsWith("plan.toml:11: "), HasSubstr("\"cylinder\" without radius")));
  EXPECT_THAT(
      refused_plan(changed_plan("structures = [\"nodule\"]", "structures = [\"nodule\"]\nradius = 3")),
      AllOf(HasSubstr("radius of a region whose shape is \"structures\""), HasSubstr("remove it")));
  EXPECT_THAT(refused_plan(changed_plan("structures = [\"nodule\"]\n", "")),
              HasSubstr("without structures and without a shape"));
  EXPECT_THAT(refused_plan(changed_plan("depth = 20", "depth = -3")),
              AllOf(HasSubstr("ends at -3 mm, before its start"), HasSubstr("greater than from")));
  EXPECT_THAT(refused_plan(changed_plan("across = [1, 0, 1]", "across = [0.05, 0, 1]")),
              AllOf(HasSubstr("across points along the trajectory"), HasSubstr("5 degrees")));
  // its norm overflows, so it has no direction; found by the fuzzer
  EXPECT_THAT(refused_plan(changed_plan("across = [1, 0, 1]", "across = [1e300, 0, 1]")),
              HasSubstr("across has no direction"));
  EXPECT_THAT(refused_plan(changed_plan("name = \"nodule\"", "name = \"hole\"")),
              AllOf(HasSubstr("a second region \"hole\""), HasSubstr("another name")));
  EXPECT_THAT(refused_plan(changed_plan("distance = 2.5\n", "")),
              HasSubstr("[[keep_away]] without distance"));
  EXPECT_THAT(refused_plan(changed_plan("distance = 2.5", "distance = -1")),
              HasSubstr("outside 0 ... 100 mm"));
  EXPECT_THAT(refused_plan("title = \"a\"\n[[tissue]]\n"),
              AllOf(StartsWith("plan.toml:2: this is a scene"), HasSubstr("docs/guide/rehearsal.md")));
  EXPECT_THAT(refused_plan(" {\"markups\": []}"), HasSubstr("palpate plan from-markups"));
  EXPECT_THAT(refused_plan("title = "), StartsWith("plan.toml:1"));
  std::string many = "title = \"a\"\n";
  for (int n = 0; n < 201; ++n) many += "[[keep_away]]\nstructures = [1]\ndistance = 1\n";
  EXPECT_THAT(refused_plan(many),
              AllOf(HasSubstr("more than 200 [[keep_away]]"), HasSubstr("split the plan")));
}

}  // namespace
}  // namespace palpate
