#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <thread>

#include "session/test_viewed.h"

namespace palpate {
namespace {

using ::testing::HasSubstr;
using testing::kViewedBone;
using testing::kViewedCartilage;
using testing::sent_N;
using testing::soon;
using testing::Viewed;

TEST_F(Viewed, PublishedSceneContainsNoPatientName) {
  start();
  const ViewedScene& scene = live_->scene();
  EXPECT_EQ(scene.side, "left");
  EXPECT_EQ(scene.modality, "mr") << "as the scene says";
  EXPECT_EQ(scene.labels, model_->labels);
  EXPECT_EQ(scene.scan, nullptr);
  ASSERT_EQ(scene.structures.size(), 3u);
  EXPECT_EQ(scene.structures[1].name, "shell");
  EXPECT_EQ(scene.structures[1].tissue, kViewedCartilage);
  ASSERT_EQ(scene.tissues.size(), 3u);
  EXPECT_EQ(scene.tissues[1].name, "cartilage");
  EXPECT_EQ(scene.tissues[1].rests_on, std::vector<int>{kViewedBone});
  EXPECT_FALSE(scene.tissues[2].touchable);
  EXPECT_EQ(scene.methods.size(), kForceMethods.size());
  EXPECT_EQ(scene.peak_force_N, 8);
  EXPECT_EQ(scene.max_force_range.min, 0.1);
  EXPECT_EQ(scene.max_force_range.max, 5) << "the scene's";
  // patient (1, 2, 3): the display's right is the patient's left, forward is superior, up is anterior
  const auto& X = scene.world_from_patient;
  EXPECT_EQ(X[0], (std::array{1.0, 0.0, 0.0, X[0][3]}));
  EXPECT_EQ(X[1], (std::array{0.0, 0.0, 1.0, X[1][3]}));
  EXPECT_EQ(X[2], (std::array{0.0, -1.0, 0.0, X[2][3]}));

  std::string words = scene.side + scene.modality + scene.tools[0].name + scene.device_name + scene.input;
  for (const auto& structure : scene.structures) words += structure.name;
  for (const auto& tissue : scene.tissues) words += tissue.name;
  EXPECT_THAT(words, ::testing::Not(HasSubstr("CANARY")));
}

TEST_F(Viewed, ABurrThatNoDeviceHoldsHasNoMotor) {
  tools_.emplace_back().burr = BurrSettings{};
  start();
  ASSERT_EQ(live_->scene().tools.size(), 1u) << "there is one device";
  EXPECT_FALSE(live_->scene().tools[0].cuts);
  SettingsRequest motor;
  motor.motor = true;
  const auto granted = live_->set(motor);
  ASSERT_FALSE(granted.ok());
  EXPECT_EQ(granted.error().where, "motor");
}

TEST_F(Viewed, ScanVoxelsDetermineHashAndModality) {
  const auto scene_of = [](float value) {
    Model model = testing::ball_model({2, 2, 2});
    auto scan = std::make_shared<Volume<float>>(model.labels->geometry());
    scan->voxels()[7] = value;
    model.scan = scan;
    DeviceInfo info;
    info.simulated = true;
    return LiveSession(
               LiveSessionParts{std::make_shared<const Model>(std::move(model)), {info}, {}, {}, "script"})
        .scene();
  };
  const ViewedScene air = scene_of(-1000), same = scene_of(-1000), water = scene_of(5);
  EXPECT_EQ(air.modality, "ct");
  EXPECT_EQ(water.modality, "unknown");
  EXPECT_EQ(air.content_hash, same.content_hash);
  EXPECT_NE(air.content_hash, water.content_hash);
}

TEST_F(Viewed, SettingsAreTakenAllOrNone) {
  start();
  const double half = std::sqrt(0.5);
  SettingsRequest request;
  request.method = "trilinear";
  request.friction = false;
  request.viscosity = false;
  request.passivity = true;
  request.paused = true;
  request.max_force_N = 1.5;
  request.rotation_wxyz = {1.2 * half, 0, 0, 1.2 * half};
  for (const auto& [where, spoil] :
       std::initializer_list<std::pair<std::string, std::function<void(SettingsRequest&)>>>{
           {"method", [](auto& r) { r.method = "telepathy"; }},
           {"max_force_N", [](auto& r) { r.max_force_N = 0.05; }},
           {"max_force_N", [](auto& r) { r.max_force_N = 5.01; }},
           {"max_force_N", [](auto& r) { r.max_force_N = std::nan(""); }},
           {"max_force_N", [](auto& r) { r.max_force_N = INFINITY; }},
           {"rotation_wxyz", [](auto& r) { r.rotation_wxyz = {0, 0, 0, 0}; }},
           {"rotation_wxyz", [](auto& r) { r.rotation_wxyz = {0, 0, 3, 0}; }},
           {"rotation_wxyz", [](auto& r) {
              r.rotation_wxyz = {1, 0, 0, std::nan("")};
            }}}) {
    SettingsRequest bad = request;
    spoil(bad);
    const Error error = error_of(bad);
    EXPECT_EQ(error.where, where) << error.what;
    EXPECT_FALSE(error.remedy.empty());
    const ViewedState state = live_->state();
    EXPECT_EQ(state.method, ForceMethod::kProxy);
    EXPECT_TRUE(state.friction && state.viscosity && !state.passivity && !state.paused);
    EXPECT_EQ(state.max_force_N, 3);
    EXPECT_EQ(state.rotation_target.w(), 1);
  }

  EXPECT_EQ(error_of(request).what, "no error");
  const ViewedState state = live_->state();
  EXPECT_EQ(state.method, ForceMethod::kTrilinear);
  EXPECT_TRUE(!state.friction && !state.viscosity && state.passivity && state.paused);
  EXPECT_EQ(state.max_force_N, 1.5);
  EXPECT_NEAR(state.rotation_target.w(), half, 1e-15);
  EXPECT_NEAR(state.rotation_target.z(), half, 1e-15);
  // and the loop applies it
  ASSERT_TRUE(soon([&] { return latest().max_force_N == 1.5; }));
  EXPECT_EQ(latest().method, index_of(ForceMethod::kTrilinear));
  EXPECT_TRUE(soon([&] { return std::abs(latest().rotation_applied_wxyz[3] - half) < 1e-9; }));
}

TEST_F(Viewed, TissuesAreTakenAllOrNone) {
  start();
  TissueRequest request;
  request.tissue = kViewedCartilage;
  request.changes[&ContactProperties::stiffness_N_per_mm] = 0.5;
  request.changes[&ContactProperties::static_friction] = 0.4;
  request.changes[&ContactProperties::friction] = 0.3;
  request.changes[&ContactProperties::viscosity_N_s_per_mm] = 0;
  for (const auto& [where, spoil] :
       std::initializer_list<std::pair<std::string, std::function<void(TissueRequest&)>>>{
           {"tissue", [](auto& r) { r.tissue = -1; }},
           {"tissue", [](auto& r) { r.tissue = 3; }},
           {"stiffness_N_per_mm", [](auto& r) { r.changes[&ContactProperties::stiffness_N_per_mm] = 20.01; }},
           {"stiffness_N_per_mm", [](auto& r) { r.changes[&ContactProperties::stiffness_N_per_mm] = 1.6; }},
           {"static_friction", [](auto& r) { r.changes[&ContactProperties::static_friction] = 0.2; }},
           {"friction", [](auto& r) { r.changes[&ContactProperties::friction] = -0.1; }},
           {"viscosity_N_s_per_mm",
            [](auto& r) { r.changes[&ContactProperties::viscosity_N_s_per_mm] = 0.2; }}}) {
    TissueRequest bad = request;
    spoil(bad);
    EXPECT_EQ(error_of(bad).where, where) << error_of(bad).what;
    EXPECT_EQ(live_->state().model_version, 1u);
    EXPECT_EQ(live_->state().tissues[1].stiffness_N_per_mm, 0.75);
    EXPECT_TRUE(changes().empty());
  }
  EXPECT_EQ(error_of(request).what, "no error");
  EXPECT_EQ(live_->state().model_version, 2u);
  const ContactProperties cartilage = live_->state().tissues[1];
  EXPECT_EQ(cartilage.stiffness_N_per_mm, 0.5);
  EXPECT_EQ(cartilage.static_friction, 0.4);
  EXPECT_EQ(cartilage.friction, 0.3);
  EXPECT_EQ(cartilage.viscosity_N_s_per_mm, 0);
  EXPECT_EQ(changes(), (std::vector<ModelChange>{{2, 1, {0.5, 0.4, 0.3, 0}}}));
  // a change to the current value creates no version
  EXPECT_EQ(error_of(request).what, "no error");
  EXPECT_EQ(live_->state().model_version, 2u);
  EXPECT_TRUE(soon([&] { return latest().model_version == 2; }));
}

TEST_F(Viewed, StiffnessChangeCausesNoForceStep) {
  start();
  ASSERT_NO_FATAL_FAILURE(press(2));
  ASSERT_TRUE(soon([&] { return std::abs(sent_N(latest()) - 1.5) < 0.02; })) << sent_N(latest());
  EXPECT_EQ(stiffness(), 0.75);
  (void)ticks();
  TissueRequest request;
  request.tissue = kViewedCartilage;
  // back and forth, each before the last change has been blended in
  for (const double requested : {0.4, 0.7, 0.1, 0.75, 0.3}) {
    request.changes[&ContactProperties::stiffness_N_per_mm] = requested;
    ASSERT_EQ(error_of(request).what, "no error");
    EXPECT_EQ(stiffness(), requested);
    std::this_thread::sleep_for(std::chrono::milliseconds(40));
  }
  // the force passes 0.6 N on its way to other values, too
  ASSERT_TRUE(soon([&] {
    const TickRecord tick = latest();
    return tick.model_version == 6 && std::abs(sent_N(tick) - 0.6) < 0.02;
  })) << sent_N(latest());
  const auto recorded_ticks = ticks();
  for (std::size_t t = 1; t < recorded_ticks.size(); ++t) {
    // a step of at most 1.3 N is blended in like a seam; a delayed thread renders none
    const double max_N = 1.3 * recorded_ticks[t].dt_s *
                             (1 / kContactSettings.stiffness_filter_s + 1.5 / kOutputSettings.blend_s) +
                         0.005;
    const std::uint32_t flags = recorded_ticks[t].device[0].flags | recorded_ticks[t - 1].device[0].flags;
    if ((flags & (kFaultFlags | kFlagStale | kFlagRamp | kFlagSlew)) != 0) continue;
    EXPECT_LE(std::abs(sent_N(recorded_ticks[t]) - sent_N(recorded_ticks[t - 1])), max_N)
        << recorded_ticks[t].tick;
  }
  EXPECT_EQ(recorded_ticks.back().model_version, 6u);
  EXPECT_TRUE(soon([&] { return loop_->collect() == 1; })) << "older versions are freed";
}

TEST_F(Viewed, ReportedStiffnessIsTheRenderedStiffness) {
  for (const double largest : {std::numeric_limits<double>::infinity(), 0.2}) {
    WorkspaceSettings workspace;
    workspace.scale = 2;
    workspace.force_gain = 0.25;
    start(true, workspace, largest);
    ASSERT_NO_FATAL_FAILURE(press(2));
    EXPECT_NEAR(stiffness(), std::min(0.5 * 0.75, largest), 1e-12);
    // a millimetre of the device is two of the patient
    ASSERT_TRUE(soon([&] { return std::abs(sent_N(latest()) - stiffness() * 1) < 0.02; }))
        << sent_N(latest()) << " " << stiffness();
    TearDown();
  }
}

TEST_F(Viewed, DirectMethodRequiresAFieldOfTheSameStiffness) {
  start();
  TissueRequest softer;
  softer.tissue = kViewedCartilage;
  softer.changes[&ContactProperties::stiffness_N_per_mm] = 0.5;
  SettingsRequest direct;
  direct.method = "b-spline";
  EXPECT_EQ(error_of(softer).what, "no error");
  EXPECT_EQ(error_of(direct).where, "method");
  EXPECT_EQ(live_->state().method, ForceMethod::kProxy);
  live_->next_method();
  EXPECT_EQ(live_->state().method, ForceMethod::kProxy) << "no other suits";

  softer.changes[&ContactProperties::stiffness_N_per_mm] = 0.75;
  EXPECT_EQ(error_of(softer).what, "no error");
  EXPECT_EQ(error_of(direct).what, "no error");
  softer.changes[&ContactProperties::stiffness_N_per_mm] = 0.5;
  EXPECT_EQ(error_of(softer).where, "stiffness_N_per_mm");
  EXPECT_THAT(error_of(softer).what, HasSubstr("b-spline"));
  softer.changes[&ContactProperties::stiffness_N_per_mm].reset();
  softer.changes[&ContactProperties::viscosity_N_s_per_mm] = 0.002;
  EXPECT_EQ(error_of(softer).what, "no error");
  live_->next_method();
  EXPECT_EQ(live_->state().method, ForceMethod::kGaussianSphere);
  EXPECT_TRUE(soon([&] { return latest().method == index_of(ForceMethod::kGaussianSphere); }));
  EXPECT_EQ(latest().device[0].flags & kFlagMethodMissing, 0u);
}

}  // namespace
}  // namespace palpate
