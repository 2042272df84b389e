#include "palpate/palpation/scripted_hand.h"

#include <gtest/gtest.h>

#include <optional>
#include <string>
#include <utility>

#include "loading/test_loading.h"

namespace palpate {
namespace {

using testing::loaded_ball;
using testing::press_script;

TEST(Simulate, HoldsTheBallAtTheAskedForce) {
  const auto result = simulate(loaded_ball(), press_script("ball"), {}, "");
  ASSERT_TRUE(result.ok()) << result.error().message();
  ASSERT_EQ(result->holds.size(), 1u);
  EXPECT_GE(result->holds[0].held_s, 1.0) << "settling and holding";
  EXPECT_NEAR(result->holds[0].mean_force_N, 0.9, 0.25);
  EXPECT_TRUE(result->problems.empty()) << result->problems.front();
  EXPECT_EQ(result->summary.not_finite, 0u);
}

TEST(Simulate, NeverExceedsTheUserLimitEvenWhenPressedHarder) {
  SimulationOptions options;
  options.max_force_N = 0.7;
  const auto result = simulate(loaded_ball(), press_script("ball", 1.3), options, "");
  ASSERT_TRUE(result.ok());
  EXPECT_EQ(result->limit_N, 0.7);
  EXPECT_LE(result->max_force_N, 0.7);
  EXPECT_GT(result->summary.clamped, 0u);
  ASSERT_FALSE(result->problems.empty()) << "1.3 N cannot be reached and this is said";
}

TEST(Simulate, DefaultLimitIsTheLesserOfContinuousRatingAndThreeNewtons) {
  Script script = press_script("ball", 0.5);
  EXPECT_EQ(simulate(loaded_ball(), script, {}, "")->limit_N, 1.4) << "Premium's continuous force";
  script.device = "touch";
  EXPECT_EQ(simulate(loaded_ball(), script, {}, "")->limit_N, 0.88);
  SimulationOptions options;
  options.max_force_N = 39;
  EXPECT_EQ(simulate(loaded_ball(), script, options, "")->limit_N, 3.3) << "never above the device's peak";
}

TEST(Simulate, IsBitForBitRepeatableAndFollowsTheSeed) {
  const auto hash_of = [](std::uint64_t seed) {
    SimulationOptions options;
    options.seed = seed;
    return simulate(loaded_ball(), press_script("ball"), options, "")->summary.run_hash;
  };
  EXPECT_EQ(hash_of(3), hash_of(3));
  EXPECT_NE(hash_of(3), hash_of(4));
}

TEST(Simulate, LeavesIntoFreeSpaceWithAnyGrip) {
  for (const char* hand : {"light-grip", "firm-grip", "whole-arm"})
    for (const double clearance_mm : {1.0, 15.0}) {
      test::TemporaryFolder folder;
      Script script = press_script("ball");
      script.hand = hand;
      std::get<ApproachStep>(script.steps[0]).clearance_mm = clearance_mm;
      const auto result = simulate(loaded_ball(), script, {}, folder / "run.h5");
      ASSERT_TRUE(result.ok()) << result.error().message();
      EXPECT_TRUE(result->problems.empty()) << hand << ": " << result->problems.front();
      const auto recording = read_recording(folder / "run.h5");
      ASSERT_TRUE(recording.ok());
      EXPECT_LT(recording->ticks.back().device[0].unclamped_force_N, 0.02) << hand << " " << clearance_mm;
    }
}

TEST(Simulate, APressThatTheTissueCannotGiveIsGivenUpAtTheSurface) {
  // the shell renders at most half of the bone's force: if more is requested, the hand must not penetrate it
  LoadedScene loaded = loaded_ball();
  SimulationOptions options;
  options.max_force_N = 8;
  options.method = ForceMethod::kTrilinear;
  test::TemporaryFolder folder;
  const auto result = simulate(loaded, press_script("ball", 7.0), options, folder / "run.h5");
  ASSERT_TRUE(result.ok());
  ASSERT_EQ(result->problems.size(), 2u) << "known before, and met";
  EXPECT_NE(result->problems[0].find("at most"), std::string::npos);
  EXPECT_NE(result->problems[1].find("ball"), std::string::npos);
  const auto recording = read_recording(folder / "run.h5");
  ASSERT_TRUE(recording.ok());
  EXPECT_EQ(recording->summary->problems, result->problems);
  for (const TickRecord& t : recording->ticks)
    ASSERT_GT(Vector<Patient>(t.device[0].tip_patient_mm[0], t.device[0].tip_patient_mm[1],
                              t.device[0].tip_patient_mm[2])
                  .norm(),
              testing::kBoneRadius_mm - 6);
}

TEST(Simulate, TouchesTheCartilageOnTheBone) {
  const auto result = simulate(loaded_ball(3), press_script("shell", 0.6), {}, "");
  ASSERT_TRUE(result.ok()) << result.error().message();
  EXPECT_GE(result->holds[0].held_s, 0.5);
}

TEST(Simulate, UnknownStructureNamesTheLineAndTheKnownOnes) {
  const auto result = simulate(loaded_ball(), press_script("femur"), {}, "");
  ASSERT_FALSE(result.ok());
  EXPECT_EQ(result.error().where, "test script:1");
  EXPECT_NE(result.error().remedy.find("ball"), std::string::npos);
  EXPECT_EQ(result.error().remedy.find("fat"), std::string::npos) << "what is not felt cannot be pressed";
}

TEST(Simulate, ARotatedObjectIsStillHeld) {
  auto script = parse_script(
      "[[step]]\napproach = \"#5\"\n[[step]]\npress = 0.8\n[[step]]\nrotate = 8.0\naxis = [0.0, 0.0, "
      "1.0]\nseconds = 1.0\n"
      "[[step]]\nhold = 0.6\n[[step]]\nleave = true\n",
      "test script");
  ASSERT_TRUE(script.ok()) << script.error().message();
  const auto result = simulate(loaded_ball(), *script, {}, "");
  ASSERT_TRUE(result.ok());
  EXPECT_GE(result->holds[0].held_s, 1.5);
}

TEST(Simulate, MillsInAStraightLineToAPoint) {
  const auto milled = [](const std::string& motor) {
    const Script script = parse_script("[[step]]\napproach = \"ball\"\nlandmark = \"anterior\"\n" + motor +
                                           "[[step]]\nmill = [0, -13, 0]\nforce = 2\nspeed = 10\n"
                                           "[[step]]\nmill = [3, -13, 0]\nforce = 2\n"
                                           "[[step]]\nmotor = false\n[[step]]\nleave = true\n",
                                       "milling script")
                              .value();
    SimulationOptions options;
    options.max_force_N = 3;
    return simulate(testing::loaded_burr(), script, options, "").value();
  };
  const SimulationResult result = milled("[[step]]\nmotor = true\n");
  EXPECT_TRUE(result.problems.empty()) << result.problems.front();
  EXPECT_LE(result.max_force_N, 3);
  // the head of 2 mm radius has come 4 mm deep, and 3 mm to the side from there
  ASSERT_EQ(result.removed.size(), 1u);
  EXPECT_GT(result.removed[0].volume_mm3, 40);
  EXPECT_LT(result.removed[0].volume_mm3, 120);
  const SimulationResult still = milled("");
  ASSERT_EQ(still.problems.size(), 1u);
  EXPECT_NE(still.problems[0].find("the motor is not running"), std::string::npos) << still.problems[0];
}

TEST(ScriptedHand, WaitsForItsOwnStrokeAndForNoOtherVersion) {
  const LoadedScene loaded = testing::loaded_burr();
  const Script script =
      parse_script("[[step]]\nstroke = \"undo\"\n[[step]]\nstroke = \"redo\"\n", "undoing script").value();
  auto hand = ScriptedHand::create(*loaded.model, script);
  ASSERT_TRUE(hand.ok()) << hand.error().message();
  TickRecord tick;
  tick.model_version = 4;
  HandCommands commands;
  const auto ticks_until_requested = [&] {
    for (int n = 1; n < 1000; ++n) {
      (void)hand->next(tick, 1e-3, commands);
      if (std::exchange(commands.stroke, std::nullopt)) return n;
    }
    return 0;
  };
  ASSERT_GT(ticks_until_requested(), 0);
  // another edit of a tissue, and another cut
  commands.stroke_version.reset();
  for (; tick.model_version < 7; ++tick.model_version) (void)hand->next(tick, 1e-3, commands);
  EXPECT_EQ(hand->progress(), 0);
  commands.stroke_version = 8;
  (void)hand->next(tick, 1e-3, commands);
  EXPECT_EQ(hand->progress(), 0) << "which is not felt yet";
  tick.model_version = 8;
  (void)hand->next(tick, 1e-3, commands);
  EXPECT_EQ(hand->progress(), 0.5);
  // a stroke that does not exist
  ASSERT_GT(ticks_until_requested(), 0);
  commands.stroke_version = 0;
  tick.model_version = 9;
  (void)hand->next(tick, 1e-3, commands);
  ASSERT_EQ(hand->problems().size(), 1u);
  EXPECT_NE(hand->problems()[0].find("there is no stroke"), std::string::npos) << hand->problems()[0];
}

// Regression: the hand leads the tip by a millimetre or two, so its return path has to start behind the tip,
// not at a corner that only the hand reached; otherwise it stayed pressed against the obstacle for up to 25
// s.
TEST(ScriptedHand, ReturnsFromAnObstacle) {
  const LoadedScene loaded = loaded_ball();
  const Script script =
      parse_script("[[step]]\napproach = \"ball\"\nfrom = \"posterior\"\n", "script round the ball").value();
  for (double free_mm = 3; free_mm < 9; free_mm += 0.7) {
    auto hand = ScriptedHand::create(*loaded.model, script);
    ASSERT_TRUE(hand.ok()) << hand.error().message();
    HandCommands commands;
    TickRecord record;
    DeviceTick& device = record.device[0];
    Point<World> intention = hand->start(), tip = intention;
    const auto tick = [&] {
      const auto tip_patient = loaded.model->X_WorldPatient.inverse() * tip;
      for (int axis = 0; axis < 3; ++axis) {
        device.tip_world_mm[axis] = tip[axis];
        device.tip_patient_mm[axis] = device.proxy_patient_mm[axis] = tip_patient[axis];
      }
      intention = hand->next(record, 1e-3, commands).value();
    };
    while ((tip - hand->start()).norm() < free_mm) {
      tick();
      tip = intention;
    }

    // an obstacle that planning did not know of
    const Point<World> wall = tip;
    const Vector<World> forward = (tip - hand->start()).normalized();
    const Vector<Patient> normal = loaded.model->X_WorldPatient.inverse() * -forward;
    bool encountered = false, back = false;
    for (int n = 0; n < 400; ++n) {
      tick();
      const double over_mm = (intention - wall).dot(forward);
      tip = over_mm > 0 ? intention - forward * over_mm : intention;
      device.label = over_mm > 0 ? testing::kBone : LabelId{0};
      device.depth_mm = 0.2 * std::max(0.0, over_mm);
      for (int axis = 0; axis < 3; ++axis) device.normal_patient[axis] = over_mm > 0 ? normal[axis] : 0;
      encountered |= over_mm > 1;
      back |= encountered && over_mm < 0;
    }
    EXPECT_TRUE(encountered && back) << "stopped after " << free_mm << " mm";
  }
}

TEST(Simulate, InterruptedItLeavesARecordingThatReopens) {
  test::TemporaryFolder folder;
  std::atomic<bool> stop{false};
  const Progress progress([&](std::string_view stage, double) { stop = stage == "palpating"; }, &stop);
  const auto result = simulate(loaded_ball(), press_script("ball"), {}, folder / "run.h5", progress);
  ASSERT_FALSE(result.ok());
  EXPECT_EQ(result.error().kind, ErrorKind::kInterrupted);
  const auto recording = read_recording(folder / "run.h5");
  ASSERT_TRUE(recording.ok()) << recording.error().message();
  EXPECT_GE(recording->ticks.size(), 1000u);
  EXPECT_FALSE(recording->summary.has_value()) << "it was cut short";
}

}  // namespace
}  // namespace palpate
