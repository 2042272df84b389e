#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "loading/test_loading.h"
#include "palpate/palpation/palpation.h"
#include "palpate/servo/haptic_settings.h"

namespace palpate {
namespace {

using testing::loaded_ball;
using testing::press_script;

class ReplayTest : public ::testing::Test {
 protected:
  void SetUp() override {
    auto script = parse_script(
        "[[step]]\napproach = \"ball\"\n[[step]]\npress = 0.8\n[[step]]\nrotate = 5.0\nseconds = 0.5\n"
        "[[step]]\nslide = 2.0\ndirection = \"left\"\n[[step]]\nleave = true\n",
        "script");
    ASSERT_TRUE(script.ok()) << script.error().message();
    const auto simulated = simulate(loaded_, *script, {}, folder_ / "run.h5");
    ASSERT_TRUE(simulated.ok()) << simulated.error().message();
    run_hash_ = simulated->summary.run_hash;
    auto read = read_recording(folder_ / "run.h5");
    ASSERT_TRUE(read.ok()) << read.error().message();
    recording_ = std::move(*read);
  }
  test::TemporaryFolder folder_;
  LoadedScene loaded_ = loaded_ball();
  Recording recording_;
  std::uint64_t run_hash_ = 0;
};

TEST_F(ReplayTest, EveryTickAgrees) {
  const auto result = replay(recording_, loaded_.model);
  ASSERT_TRUE(result.ok());
  EXPECT_TRUE(result->identical) << result->difference;
  EXPECT_EQ(result->run_hash, run_hash_);
  EXPECT_EQ(result->ticks, recording_.ticks.size());
}

TEST_F(ReplayTest, ReplaysRunsWithSeveralMethods) {
  const auto script = parse_script(
      "[[step]]\napproach = \"ball\"\n[[step]]\npress = 0.8\n[[step]]\nmethod = \"smooth-sphere\"\n"
      "[[step]]\nhold = 0.3\n[[step]]\nmethod = \"stored-normals\"\n[[step]]\nhold = 0.3\n"
      "[[step]]\nleave = true\n",
      "script");
  ASSERT_TRUE(script.ok()) << script.error().message();
  SimulationOptions options;
  options.method = ForceMethod::kSpline;
  const auto simulated = simulate(loaded_, *script, options, folder_ / "methods.h5");
  ASSERT_TRUE(simulated.ok()) << simulated.error().message();
  EXPECT_EQ(simulated->summary.method_missing, 0u);
  EXPECT_GT(simulated->summary.blended, 100u);
  EXPECT_TRUE(simulated->problems.empty());

  const auto recording = read_recording(folder_ / "methods.h5");
  ASSERT_TRUE(recording.ok());
  std::vector<ForceMethod> methods;
  for (const TickRecord& record : recording->ticks)
    if (const auto method = static_cast<ForceMethod>(record.method);
        methods.empty() || methods.back() != method)
      methods.push_back(method);
  EXPECT_THAT(methods, ::testing::ElementsAre(ForceMethod::kSpline, ForceMethod::kSmoothSphere,
                                              ForceMethod::kStoredNormals));
  // the loaded model is not prepared for any of them
  const auto result = replay(*recording, loaded_.model);
  ASSERT_TRUE(result.ok()) << result.error().message();
  EXPECT_TRUE(result->identical) << result->difference;
  EXPECT_EQ(result->run_hash, simulated->summary.run_hash);
}

TEST_F(ReplayTest, NamesTheFirstTickThatDiffers) {
  double& x = recording_.ticks[777].device[0].tip_world_mm[0];
  x = std::nextafter(x, 1e9);
  const auto result = replay(recording_, loaded_.model);
  ASSERT_TRUE(result.ok());
  EXPECT_FALSE(result->identical);
  EXPECT_EQ(result->first_difference, 777u);
  EXPECT_FALSE(result->difference.empty());
  EXPECT_EQ(result->difference.find("different settings"), std::string::npos) << result->difference;
}

TEST_F(ReplayTest, SettingsThatWereOthersAreNamedWhereItDiffers) {
  const std::string here = haptic_settings_text();
  EXPECT_EQ(recording_.header.haptic_settings, here);
  recording_.header.haptic_settings.replace(here.find("output.ramp_in_s 0.5"), 20, "output.ramp_in_s 0.4");
  // equal outputs, so the different figures had no effect
  const auto same = replay(recording_, loaded_.model);
  ASSERT_TRUE(same.ok());
  EXPECT_TRUE(same->identical);
  recording_.ticks[777].device[0].force_N[0] += 1;
  const auto result = replay(recording_, loaded_.model);
  ASSERT_TRUE(result.ok());
  EXPECT_THAT(result->difference,
              ::testing::HasSubstr("recorded with different settings: output.ramp_in_s 0.4, here 0.5"));
}

TEST_F(ReplayTest, EveryInputOfATickMatters) {
  const auto differs_after = [&](auto change) {
    Recording changed = recording_;
    for (std::size_t t = changed.ticks.size() / 2; t < changed.ticks.size(); ++t) change(changed.ticks[t]);
    const auto result = replay(changed, loaded_.model);
    return result.ok() && !result->identical;
  };
  EXPECT_TRUE(differs_after([](TickRecord& t) { t.dt_s *= 1.001; }));
  EXPECT_TRUE(differs_after([](TickRecord& t) { t.switches ^= kSwitchFriction; }));
  EXPECT_TRUE(differs_after([](TickRecord& t) { t.switches ^= kSwitchViscosity; }));
  EXPECT_TRUE(differs_after([](TickRecord& t) { t.switches ^= kSwitchPassivity; }));
  EXPECT_TRUE(differs_after([](TickRecord& t) { t.switches |= kSwitchPaused; }));
  EXPECT_TRUE(differs_after([](TickRecord& t) { t.max_force_N = 0.1; }));
  EXPECT_TRUE(differs_after([](TickRecord& t) { t.rotation_target_wxyz = {1, 0, 0, 0.1}; }));
}

TEST_F(ReplayTest, EveryOutputIsCompared) {
  const auto difference_after = [&](auto change) {
    Recording changed = recording_;
    change(changed.ticks[321].device[0]);
    const auto result = replay(changed, loaded_.model);
    EXPECT_TRUE(result.ok() && !result->identical && result->first_difference == 321u);
    return result->difference;
  };
  using ::testing::HasSubstr;
  EXPECT_THAT(difference_after([](DeviceTick& d) { d.force_N[1] += 1; }), HasSubstr("force_N"));
  EXPECT_THAT(difference_after([](DeviceTick& d) { d.label ^= 1; }), HasSubstr("label"));
  EXPECT_THAT(difference_after([](DeviceTick& d) { d.depth_mm -= 0.5; }), HasSubstr("depth_mm"));
  EXPECT_THAT(difference_after([](DeviceTick& d) { d.flags ^= kFlagContact; }), HasSubstr("flags"));
  EXPECT_THAT(difference_after([](DeviceTick& d) { d.normal_patient[0] = 2; }), HasSubstr("normal_patient"));
}

TEST_F(ReplayTest, ReplaysATruncatedRecordingToItsEnd) {
  recording_.summary.reset();
  recording_.ticks.resize(500);
  const auto result = replay(recording_, loaded_.model);
  ASSERT_TRUE(result.ok());
  EXPECT_TRUE(result->identical);
  EXPECT_EQ(result->ticks, 500u);
}

TEST_F(ReplayTest, MissingTicksAreNoticed) {
  recording_.ticks.pop_back();
  const auto result = replay(recording_, loaded_.model);
  ASSERT_TRUE(result.ok());
  EXPECT_FALSE(result->identical);
}

TEST_F(ReplayTest, AnotherModelIsRefused) {
  const auto other = std::make_shared<Model>(*loaded_.model);
  other->content_hash = 43;
  EXPECT_EQ(replay(recording_, other).error().kind, ErrorKind::kBadInput);
}

TEST_F(ReplayTest, AMethodOfALaterVersionIsRefused) {
  recording_.ticks[3].method = 200;
  const auto result = replay(recording_, loaded_.model);
  ASSERT_FALSE(result.ok());
  EXPECT_NE(result.error().what.find("tick 3"), std::string::npos);
}

}  // namespace
}  // namespace palpate
