#include "palpate/stability/limited_stiffness.h"

#include <gtest/gtest.h>

#include "loading/test_loading.h"
#include "palpate/palpation/palpation.h"

namespace palpate {
namespace {

LoadedScene ball_of(double stiffness_N_per_mm) {
  LoadedScene loaded = testing::loaded_ball();
  Model model = *loaded.model;
  for (Tissue& tissue : model.tissues)
    tissue.stiffness_N_per_mm = std::min(tissue.stiffness_N_per_mm, stiffness_N_per_mm);
  model.tissues[0].stiffness_N_per_mm = stiffness_N_per_mm;
  loaded.model = std::make_shared<const Model>(std::move(model));
  return loaded;
}

TEST(LimitedStiffness, SoftSceneIsNotClamped) {
  const auto limited = limited_stiffness(*ball_of(1).model, {}, ForceMethod::kProxy,
                                         *find_plant_device("premium-1.5"), 1000, 0);
  ASSERT_TRUE(limited.ok());
  EXPECT_EQ(limited->requested_N_per_mm, 1);
  EXPECT_GT(limited->max_N_per_mm, 1);
  EXPECT_EQ(limited->clamped, "");
}

TEST(LimitedStiffness, ClampsToTheRecommendationWithAMessage) {
  const PlantDevice premium = *find_plant_device("premium-1.5");
  WorkspaceSettings workspace;
  workspace.scale = 2;
  workspace.force_gain = 0.5;
  const auto limited =
      limited_stiffness(*ball_of(6).model, workspace, ForceMethod::kProxy, premium, 1000, 1e-3);
  ASSERT_TRUE(limited.ok());
  EXPECT_EQ(limited->requested_N_per_mm, 6);
  EXPECT_EQ(limited->max_N_per_mm, *recommended_stiffness_N_per_mm(premium, 1000, 1e-3));
  for (const char* part : {"'bone' asks for 6 N/mm", "scale 2 x force gain 0.5", "limited to 0.713",
                           "premium-1.5 at 1000 Hz with 1 ms of delay", "any hand: 0.01"})
    EXPECT_NE(limited->clamped.find(part), std::string::npos) << limited->clamped;
}

TEST(LimitedStiffness, PointsThatTouchTogetherAddUpButNotForTheProxy) {
  const PlantDevice premium = *find_plant_device("premium-1.5");
  Model model = *ball_of(1.5).model;
  model.tools[0].points_mm.assign(4, Eigen::Vector3d::Zero());
  const auto directly = limited_stiffness(model, {}, ForceMethod::kTrilinear, premium, 1000, 0);
  const auto by_proxy = limited_stiffness(model, {}, ForceMethod::kProxy, premium, 1000, 0);
  ASSERT_TRUE(directly.ok() && by_proxy.ok());
  EXPECT_EQ(directly->requested_N_per_mm, 6);
  EXPECT_NE(directly->clamped.find("4 points): limited to 2.04"), std::string::npos) << directly->clamped;
  EXPECT_EQ(by_proxy->requested_N_per_mm, 1.5);
  EXPECT_EQ(by_proxy->clamped, "");
  EXPECT_EQ(by_proxy->max_N_per_mm, directly->max_N_per_mm) << "the method may change";
}

TEST(LimitedStiffness, ClampsToTheVendorsRatingWithAMessage) {
  PlantDevice premium = *find_plant_device("premium-1.5");
  const double by_hand = *recommended_stiffness_N_per_mm(premium, 1000, 1e-3);
  ASSERT_GT(by_hand, 0.5);
  struct Case {
    double vouched, requested, most;
    const char* says;
  };
  for (const Case& one :
       {Case{0.5, 6, 0.5, "limited to 0.5, the maximum that the vendor of premium-1.5 guarantees"},
        Case{0.5, 0.6, 0.5, "'bone' asks for 0.6 N/mm"}, Case{0.5, 0.4, 0.5, nullptr},
        Case{50, 6, by_hand, "the maximum that is stable with"}, Case{1e-3, 6, 1e-3, "limited to 0.001"},
        Case{kNoValue, 6, by_hand, "the maximum that is stable with"}}) {
    SCOPED_TRACE(one.vouched);
    premium.stiffness_N_per_mm = one.vouched;
    for (const ForceMethod method : {ForceMethod::kProxy, ForceMethod::kTrilinear}) {
      const auto limited = limited_stiffness(*ball_of(one.requested).model, {}, method, premium, 1000, 1e-3);
      ASSERT_TRUE(limited.ok());
      EXPECT_LE(limited->max_N_per_mm, one.most);
      if (one.says == nullptr) {
        EXPECT_EQ(limited->clamped, "");
      } else {
        EXPECT_EQ(limited->max_N_per_mm, one.most);
        EXPECT_NE(limited->clamped.find(one.says), std::string::npos) << limited->clamped;
      }
    }
  }
}

TEST(LimitedStiffness, TheoreticalBoundIsBelowTheRecommendation) {
  // otherwise a scene's stiffness could be reduced without a message
  for (const char* name : {"premium-1.5", "touch"})
    for (const double rate_hz : {250.0, 1000.0, 10000.0}) {
      const PlantDevice device = *find_plant_device(name);
      const auto limited =
          limited_stiffness(*ball_of(1e-3).model, {}, ForceMethod::kProxy, device, rate_hz, 1e-3);
      ASSERT_TRUE(limited.ok());
      EXPECT_LT(limited->max_N_per_mm, *recommended_stiffness_N_per_mm(device, rate_hz, 1e-3));
    }
}

TEST(LimitedDamping, ClampsToTheStableDampingWithAMessage) {
  const PlantDevice premium = *find_plant_device("premium-1.5");
  Model model = *ball_of(1).model;
  WorkspaceSettings workspace;
  workspace.scale = 2;
  const auto limited = [&] { return limited_damping(model, workspace, premium, 1000, 1e-3); };
  EXPECT_EQ(limited().max_N_s_per_mm, recommended_damping_N_s_per_mm(premium, 1000, 1e-3));
  EXPECT_EQ(limited().clamped, "");
  model.tissues[0].viscosity_N_s_per_mm = 0.05;
  for (const char* part : {"'bone' asks for 0.1 N s/mm", "0.05 x scale 2 x force gain 1", "limited to 0.014",
                           "the maximum for premium-1.5 at 1000 Hz with 1 ms of delay"})
    EXPECT_NE(limited().clamped.find(part), std::string::npos) << limited().clamped;
  model.tissues[0].touchable = false;
  EXPECT_EQ(limited().clamped, "") << "what is not felt";
  model.method_settings.coupling_damping_N_s_per_mm = 0.06;
  EXPECT_NE(limited().clamped.find("the proxy's coupling asks for 0.12"), std::string::npos)
      << limited().clamped;
}

TEST(LimitedDamping, IsReportedRecordedAndReplayed) {
  LoadedScene loaded = ball_of(0.5);
  Model model = *loaded.model;
  model.tissues[0].viscosity_N_s_per_mm = 0.05;
  loaded.model = std::make_shared<const Model>(std::move(model));
  Script script = testing::press_script("ball");
  script.delay_s = 1e-3;
  test::TemporaryFolder folder;
  const auto result = simulate(loaded, script, {}, folder / "viscous.h5");
  ASSERT_TRUE(result.ok()) << result.error().message();
  ASSERT_FALSE(result->problems.empty());
  EXPECT_NE(result->problems.front().find("N s/mm of damping"), std::string::npos)
      << result->problems.front();
  const auto recording = read_recording(folder / "viscous.h5");
  ASSERT_TRUE(recording.ok());
  const double largest =
      recommended_damping_N_s_per_mm(*find_plant_device(script.device), script.rate_hz, 1e-3);
  for (const TickRecord& record : recording->ticks) {
    ASSERT_EQ(record.device[0].max_damping_N_s_per_mm, largest);
    ASSERT_EQ(record.device[0].delay_s, 1e-3);
  }
  const auto again = replay(*recording, loaded.model);
  ASSERT_TRUE(again.ok()) << again.error().message();
  EXPECT_TRUE(again->identical) << again->difference;
}

TEST(LimitedStiffness, RendersAStiffSurfaceWithinTheDeviceLimit) {
  const LoadedScene loaded = ball_of(20);
  Script script = testing::press_script("ball");
  script.delay_s = 1e-3;
  for (const ForceMethod method : {ForceMethod::kProxy, ForceMethod::kTrilinear}) {
    SCOPED_TRACE(name_of(method));
    SimulationOptions options;
    options.method = method;
    test::TemporaryFolder folder;
    const auto result = simulate(loaded, script, options, folder / "stiff.h5");
    ASSERT_TRUE(result.ok()) << result.error().message();
    ASSERT_FALSE(result->problems.empty());
    EXPECT_NE(result->problems.front().find("limited to 0.713"), std::string::npos)
        << result->problems.front();
    const auto recording = read_recording(folder / "stiff.h5");
    ASSERT_TRUE(recording.ok());
    double deepest_mm = 0, max_N = 0;
    for (const TickRecord& record : recording->ticks) {
      const DeviceTick& device = record.device[0];
      EXPECT_NEAR(device.max_stiffness_N_per_mm, 0.713, 0.01);
      if (!(device.depth_mm > 0.2)) continue;
      deepest_mm = std::max(deepest_mm, device.depth_mm);
      max_N = std::max(max_N, device.unclamped_force_N / device.depth_mm);
    }
    if (method == ForceMethod::kProxy) {
      EXPECT_NEAR(max_N, 0.713, 0.02);
    }
    EXPECT_GT(deepest_mm, 0.2);
    EXPECT_TRUE(replay(*recording, loaded.model)->identical);
  }
}

}  // namespace
}  // namespace palpate
