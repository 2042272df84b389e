#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>

#include "palpate/scene/scene.h"
#include "palpate/scene/script.h"
#include "scene/keys.h"

namespace palpate {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

constexpr const char* kScript = R"(title = "Touch"
device = "touch"
hand = "whole-arm"
rate = 4000
delay = 1.5
tremor = 0.1
seed = 42
[[step]]
approach = "femur"
speed = 30
clearance = 20
[[step]]
press = 1.25
settle = 0.75
[[step]]
hold = 0.7
[[step]]
slide = 4
direction = [1, -2, 0.5]
speed = 5
[[step]]
rotate = -10
axis = "forward"
seconds = 2
[[step]]
leave = true
speed = 50
[[step]]
approach = "#95"
[[step]]
method = "gaussian-sphere"
)";

TEST(ParseScript, ReadsEveryKey) {
  const auto parsed = parse_script(kScript, "script.toml");
  ASSERT_TRUE(parsed.ok()) << parsed.error().message();
  const Script& script = *parsed;
  EXPECT_EQ(script.title, "Touch");
  EXPECT_EQ(script.device, "touch");
  EXPECT_EQ(script.hand, "whole-arm");
  EXPECT_EQ(script.rate_hz, 4000);
  EXPECT_DOUBLE_EQ(script.delay_s, 1.5e-3);
  EXPECT_EQ(script.tremor_mm, 0.1);
  EXPECT_EQ(script.seed, 42u);
  EXPECT_EQ(script.source, "script.toml");
  EXPECT_THAT(script.lines, ElementsAre(8, 12, 15, 17, 21, 25, 28, 30));
  EXPECT_EQ(script.device_line, 2);
  EXPECT_EQ(script.hand_line, 3);
  ASSERT_EQ(script.steps.size(), 8u);
  const auto& approach = std::get<ApproachStep>(script.steps[0]);
  EXPECT_EQ(approach.structure, "femur");
  EXPECT_EQ(approach.speed_mm_s, 30);
  EXPECT_EQ(approach.clearance_mm, 20);
  const auto& press = std::get<PressStep>(script.steps[1]);
  EXPECT_EQ(press.force_N, 1.25);
  EXPECT_EQ(press.settle_s, 0.75);
  EXPECT_EQ(std::get<HoldStep>(script.steps[2]).seconds, 0.7);
  const auto& slide = std::get<SlideStep>(script.steps[3]);
  EXPECT_EQ(slide.distance_mm, 4);
  EXPECT_EQ(slide.direction, Vector<Patient>(1, -2, 0.5));
  EXPECT_EQ(slide.speed_mm_s, 5);
  const auto& rotate = std::get<RotateStep>(script.steps[4]);
  EXPECT_EQ(rotate.degrees, -10);
  EXPECT_EQ(rotate.axis_world, Eigen::Vector3d(0, 1, 0));
  EXPECT_EQ(rotate.seconds, 2);
  EXPECT_EQ(std::get<LeaveStep>(script.steps[5]).speed_mm_s, 50);
  EXPECT_EQ(std::get<ApproachStep>(script.steps[6]).structure, "#95");
  EXPECT_EQ(std::get<MethodStep>(script.steps[7]).method, ForceMethod::kGaussianSphere);
}

TEST(ParseScript, ASecondHandHoldsAScope) {
  EXPECT_FALSE(has_scope(*parse_script("[[step]]\napproach = \"femur\"\n", "s")));
  const auto script = parse_script(
      "[[step]]\nscope = \"probe\"\n[[step]]\nscope = [1, 2, 3]\nfrom = [0, 3, 4]\ndistance = 25\nspeed = "
      "10\noptics = 70\nback = 4\n",
      "s");
  ASSERT_TRUE(script.ok()) << script.error().message();
  EXPECT_TRUE(has_scope(*script));
  const auto& plain = std::get<ScopeStep>(script->steps[0]);
  EXPECT_FALSE(plain.at);
  EXPECT_EQ(plain.from, Vector<Patient>(0, -1, 0));
  EXPECT_EQ(plain.optics, ScopeOptics());
  const auto& step = std::get<ScopeStep>(script->steps[1]);
  EXPECT_EQ(step.at, Point<Patient>(1, 2, 3));
  EXPECT_NEAR((step.from - Vector<Patient>(0, 0.6, 0.8)).norm(), 0, 1e-12);
  EXPECT_EQ(step.distance_mm, 25);
  EXPECT_EQ(step.speed_mm_s, 10);
  EXPECT_EQ(step.optics, (ScopeOptics{70, 4}));
  EXPECT_THAT(parse_script("[[step]]\nscope = \"femur\"\n", "s").error().message(),
              HasSubstr("s:2: a scope cannot look at \"femur\""));
}

TEST(ParseScript, DirectionsAreThePatients) {
  const std::vector<std::pair<const char*, Vector<Patient>>> expected{
      {"superior", {0, 0, 1}},  {"inferior", {0, 0, -1}}, {"anterior", {0, -1, 0}},
      {"posterior", {0, 1, 0}}, {"left", {1, 0, 0}},      {"right", {-1, 0, 0}}};
  for (const auto& [name, direction] : expected) {
    const auto script = parse_script(
        std::string("[[step]]\napproach = 'a'\n[[step]]\nslide = 1\ndirection = '") + name + "'\n", "t");
    ASSERT_TRUE(script.ok()) << script.error().message();
    EXPECT_EQ(std::get<SlideStep>(script->steps[1]).direction, direction) << name;
  }
}

TEST(ParseScript, ApproachHasTargetAndDirection) {
  const auto script = parse_script(
      "[[step]]\napproach = [1, -2.5, 3]\nfrom = [0, 0, 2]\n[[step]]\nleave = true\n"
      "[[step]]\napproach = 'femur'\nlandmark = 'anterior'\n[[step]]\nleave = true\n"
      "[[step]]\napproach = 'femur'\nnearest = '#7'\nfrom = 'left'\n[[step]]\nleave = true\n"
      "[[step]]\napproach = 'femur'\nnearest = [4, 5, 6]\n",
      "t");
  ASSERT_TRUE(script.ok()) << script.error().message();
  const auto step = [&](std::size_t s) { return std::get<ApproachStep>(script->steps[s]); };
  EXPECT_EQ(step(0).point, Point<Patient>(1, -2.5, 3));
  EXPECT_EQ(step(0).structure, "");
  EXPECT_EQ(step(0).from, Vector<Patient>(0, 0, 1)) << "a direction has unit length";
  EXPECT_EQ(step(2).landmark, Vector<Patient>(0, -1, 0));
  EXPECT_FALSE(step(2).from);
  EXPECT_EQ(std::get<std::string>(step(4).nearest), "#7");
  EXPECT_EQ(step(4).from, Vector<Patient>(1, 0, 0));
  EXPECT_EQ(std::get<Point<Patient>>(step(6).nearest), Point<Patient>(4, 5, 6));
}

TEST(ParseScript, AxesHaveUnitLength) {
  const auto script = parse_script("[[step]]\nrotate = 5\naxis = [0, 3, 4]\n", "t");
  ASSERT_TRUE(script.ok()) << script.error().message();
  EXPECT_TRUE(std::get<RotateStep>(script->steps[0]).axis_world.isApprox(Eigen::Vector3d(0, 0.6, 0.8)));
}

double script_default_of(const TableSpec& table, std::string_view key) {
  return std::stod(std::string(table.find(key)->default_text));
}

TEST(ParseScript, DefaultsAreTheDocumentedOnes) {
  const auto script = parse_script(
      "[[step]]\napproach = 'a'\n[[step]]\npress = 1\n[[step]]\nslide = 1\n[[step]]\nrotate = "
      "1\n[[step]]\nleave = true\n",
      "t");
  ASSERT_TRUE(script.ok()) << script.error().message();
  const ScriptKeys& keys = script_key_tables();
  EXPECT_EQ(keys.top.find("device")->default_text, "\"" + script->device + "\"");
  EXPECT_EQ(keys.top.find("hand")->default_text, "\"" + script->hand + "\"");
  EXPECT_EQ(script->device_line, 0);
  EXPECT_EQ(script->hand_line, 0);
  EXPECT_EQ(script->rate_hz, script_default_of(keys.top, "rate"));
  EXPECT_EQ(script->delay_s, script_default_of(keys.top, "delay"));
  EXPECT_EQ(script->tremor_mm, script_default_of(keys.top, "tremor"));
  EXPECT_EQ(static_cast<double>(script->seed), script_default_of(keys.top, "seed"));
  const auto& actions = keys.actions;
  EXPECT_EQ(std::get<ApproachStep>(script->steps[0]).speed_mm_s, script_default_of(actions[0], "speed"));
  EXPECT_EQ(std::get<ApproachStep>(script->steps[0]).clearance_mm,
            script_default_of(actions[0], "clearance"));
  EXPECT_EQ(std::get<PressStep>(script->steps[1]).settle_s, script_default_of(actions[1], "settle"));
  EXPECT_EQ(std::get<SlideStep>(script->steps[2]).speed_mm_s, script_default_of(actions[3], "speed"));
  EXPECT_EQ(std::get<SlideStep>(script->steps[2]).direction, Vector<Patient>(0, 0, 1));
  EXPECT_EQ(actions[3].find("direction")->default_text, "\"superior\"");
  EXPECT_EQ(std::get<RotateStep>(script->steps[3]).seconds, script_default_of(actions[4], "seconds"));
  EXPECT_EQ(std::get<RotateStep>(script->steps[3]).axis_world, Eigen::Vector3d(0, 0, 1));
  EXPECT_EQ(actions[4].find("axis")->default_text, "\"up\"");
  EXPECT_EQ(std::get<LeaveStep>(script->steps[4]).speed_mm_s, script_default_of(actions[6], "speed"));
}

struct BadScript {
  const char* text;
  int line;
  const char* what;
  const char* remedy;
};

void PrintTo(const BadScript& bad, std::ostream* out) {
  *out << bad.text;
}

class ParseScriptError : public testing::TestWithParam<BadScript> {};

TEST_P(ParseScriptError, NamesLineReasonAndRemedy) {
  const auto script = parse_script(GetParam().text, "script.toml");
  ASSERT_FALSE(script.ok());
  EXPECT_EQ(script.error().kind, ErrorKind::kBadInput);
  EXPECT_EQ(script.error().where, "script.toml:" + std::to_string(GetParam().line))
      << script.error().message();
  EXPECT_THAT(script.error().what, HasSubstr(GetParam().what));
  EXPECT_THAT(script.error().remedy, HasSubstr(GetParam().remedy));
}

#define APPROACH "[[step]]\napproach = 'femur'\n"

INSTANTIATE_TEST_SUITE_P(
    Keys, ParseScriptError,
    testing::Values(
        BadScript{"", 1, "the script has no step", "[[step]]"},
        BadScript{"divice = 'touch'\n" APPROACH, 1, "unknown key \"divice\"", "did you mean device?"},
        BadScript{"rate = 200\n" APPROACH, 1, "rate = 200 is outside 250 ... 10000 Hz", ""},
        BadScript{"delay = 21\n" APPROACH, 1, "delay = 21 is outside 0 ... 20 ms", ""},
        BadScript{"rate = nan\n" APPROACH, 1, "rate is not a finite number", ""},
        BadScript{"tremor = 2\n" APPROACH, 1, "tremor = 2 is outside 0 ... 1 mm", ""},
        BadScript{"seed = -1\n" APPROACH, 1, "seed = -1 is outside 0", ""},
        BadScript{"seed = 1.5\n" APPROACH, 1, "seed is a number", "a whole number"},
        BadScript{"device = 5\n" APPROACH, 1, "device is a whole number", "a text"},
        BadScript{"[[step]]\n", 1, "a step without an action", "slide, rotate, method, leave"},
        BadScript{"[[step]]\naproach = 'femur'\n", 2, "unknown key \"aproach\" in [[step]]",
                  "did you mean approach?"},
        BadScript{"[[step]]\nspeed = 5\nHold = 1\n", 3, "unknown key \"Hold\"", "did you mean hold?"},
        BadScript{"[[step]]\nxyz = 'femur'\n", 1, "a step without an action", "a step has one of approach"},
        BadScript{"seed = 2\n[[steps]]\napproach = 'femur'\n", 2, "unknown key \"steps\"",
                  "did you mean step?"},
        BadScript{"title = 'x'\n[[tissue]]\nname = 'a'\n", 2, "a scene, not a palpation script", "--script"},
        BadScript{APPROACH "[[step]]\npress = 1\nhold = 1\n", 3, "two actions, press and hold", "of its own"},
        BadScript{APPROACH "[[step]]\npress = 1\nspeed = 1\n", 5, "unknown key \"speed\" in press", "settle"},
        BadScript{APPROACH "clearence = 1\n", 3, "unknown key \"clearence\" in approach",
                  "did you mean clearance?"},
        BadScript{"[[step]]\napproach = 95\n", 2, "approach is a whole number", "a text"},
        BadScript{"[[step]]\napproach = ''\n", 2, "approach is empty", ""},
        BadScript{"[[step]]\napproach = '#'\n", 2, "not a label number", "\"#1\" ... \"#65535\""},
        BadScript{"[[step]]\napproach = '#0'\n", 2, "not a label number", ""},
        BadScript{"[[step]]\napproach = '#65536'\n", 2, "not a label number", ""},
        BadScript{"[[step]]\napproach = '#9x'\n", 2, "not a label number", ""},
        BadScript{"[[step]]\napproach = '#4294967391'\n", 2, "not a label number", ""},
        BadScript{APPROACH "nearest = '#0'\n", 3, "nearest = \"#0\" is not a label number", ""},
        BadScript{APPROACH "nearest = [1, 2]\n", 3, "not three numbers", "a text or a point"},
        BadScript{APPROACH "landmark = 'top'\n", 3, "unknown landmark \"top\"", "\"superior\""},
        BadScript{APPROACH "landmark = 'left'\nnearest = 'tibia'\n", 4, "both landmark and nearest",
                  "keep only one"},
        BadScript{"[[step]]\napproach = [1, 2, 3]\nlandmark = 'left'\n", 3,
                  "a point with a landmark or nearest", "name a structure"},
        BadScript{APPROACH "from = [0, 0, 0]\n", 3, "from has no direction", ""},
        BadScript{APPROACH "[[step]]\npress = 41\n", 4, "press = 41 is outside 0.02 ... 40 N", ""},
        BadScript{APPROACH "[[step]]\nhold = 61\n", 4, "hold = 61 is outside 0.01 ... 60 s", ""},
        BadScript{APPROACH "[[step]]\nslide = 0\n", 4, "slide = 0 is outside 0.1 ... 200 mm", ""},
        BadScript{APPROACH "[[step]]\nslide = 1\ndirection = 'up'\n", 5, "unknown direction \"up\"",
                  "direction takes \"superior\", \"inferior\""},
        BadScript{APPROACH "[[step]]\nslide = 1\ndirection = [0, 0, 0]\n", 5, "direction has no direction",
                  ""},
        BadScript{APPROACH "[[step]]\nslide = 1\ndirection = [0, nan, 0]\n", 5,
                  "direction is not a finite number", ""},
        BadScript{APPROACH "[[step]]\nslide = 1\ndirection = [0, 1]\n", 5, "not three numbers", ""},
        BadScript{APPROACH "[[step]]\nslide = 1\ndirection = true\n", 5, "direction is true or false", ""},
        BadScript{"[[step]]\nrotate = 181\n", 2, "rotate = 181 is outside -180 ... 180 degrees", ""},
        BadScript{"[[step]]\nrotate = 1\naxis = 'left'\n", 3, "unknown axis \"left\"", "right"},
        BadScript{"[[step]]\nmethod = 'spline'\n", 2, "unknown method \"spline\"",
                  "method takes \"trilinear\""},
        BadScript{APPROACH "[[step]]\nleave = false\n", 4, "leave = false does nothing", ""},
        BadScript{APPROACH "[[step]]\nleave = 1\n", 4, "leave is a whole number", "true or false"}));

INSTANTIATE_TEST_SUITE_P(
    Order, ParseScriptError,
    testing::Values(BadScript{"[[step]]\npress = 1\n", 1, "press without contact", "approach"},
                    BadScript{"[[step]]\nhold = 1\n", 1, "hold without contact", "approach"},
                    BadScript{"[[step]]\nmill = [1, 2, 3]\n", 1, "mill without contact", "approach"},
                    BadScript{APPROACH "[[step]]\nmill = [1, 2]\n", 4, "not three numbers", ""},
                    BadScript{"[[step]]\nslide = 1\n", 1, "slide without contact", "approach"},
                    BadScript{"[[step]]\nleave = true\n", 1, "leave without contact", "approach"},
                    BadScript{APPROACH "[[step]]\nleave = true\n[[step]]\nhold = 1\n", 5,
                              "hold without contact", ""},
                    BadScript{APPROACH "[[step]]\nhold = 1\n[[step]]\napproach = 'tibia'\n", 5,
                              "still touching \"femur\" (line 1)", "leave = true"}));

TEST(ParseScript, RotatesAndChangesTheMethodWithOrWithoutContact) {
  EXPECT_TRUE(parse_script("[[step]]\nrotate = 1\n" APPROACH "[[step]]\nrotate = 1\n", "t").ok());
  const std::string change = "[[step]]\nmethod = 'b-spline'\n";
  EXPECT_TRUE(parse_script(change + APPROACH + change, "t").ok());
}

TEST(ParseScript, LimitsSteps) {
  std::string text = APPROACH;
  for (std::size_t i = 1; i < kMaxScriptSteps; ++i) text += "[[step]]\nhold = 1\n";
  EXPECT_TRUE(parse_script(text, "t").ok());
  const auto too_many = parse_script(text + "[[step]]\nhold = 1\n", "t");
  ASSERT_FALSE(too_many.ok());
  EXPECT_EQ(too_many.error().where, "t:2001");
}

TEST(EmbeddedScript, KneeHoldsEveryBoneAndCartilage) {
  const auto text = embedded_script("knee-phantom");
  ASSERT_TRUE(text.has_value());
  EXPECT_EQ(embedded_script("knee"), text);
  EXPECT_EQ(embedded_script("knee-atlas"), text);
  EXPECT_FALSE(embedded_script("head").has_value());
  const auto script = parse_script(*text, "knee.toml");
  ASSERT_TRUE(script.ok()) << script.error().message();

  // structure, force and duration of each hold
  std::vector<std::string> held;
  std::string structure;
  double force = 0;
  int slides = 0, rotations = 0;
  for (const ScriptStep& step : script->steps) {
    if (const auto* approach = std::get_if<ApproachStep>(&step)) structure = approach->structure;
    if (const auto* press = std::get_if<PressStep>(&step)) force = press->force_N;
    if (const auto* hold = std::get_if<HoldStep>(&step);
        hold && hold->seconds >= 0.5 && force >= 0.5 && force <= 2)
      held.push_back(structure);
    if (std::holds_alternative<SlideStep>(step)) ++slides;
    if (const auto* rotate = std::get_if<RotateStep>(&step)) {
      ++rotations;
      EXPECT_EQ(structure, "femur");
      EXPECT_EQ(rotate->degrees, 10);
    }
  }
  EXPECT_THAT(held, ElementsAre("femur", "tibia", "fibula", "patella", "femoral_cartilage",
                                "lateral_tibial_cartilage", "medial_tibial_cartilage", "patellar_cartilage"));
  EXPECT_EQ(slides, 2);
  EXPECT_EQ(rotations, 1);

  // each of them belongs to a touchable tissue of the embedded scene
  const auto scene = parse_scene(*embedded_scene("knee"), "knee.toml");
  ASSERT_TRUE(scene.ok());
  for (const std::string& name : held) {
    EXPECT_TRUE(std::any_of(scene->tissues.begin(), scene->tissues.end(), [&](const TissueSettings& tissue) {
      return tissue.touchable &&
             std::count(tissue.labels.begin(), tissue.labels.end(), LabelReference(name)) == 1;
    })) << name;
  }
}

}  // namespace
}  // namespace palpate
