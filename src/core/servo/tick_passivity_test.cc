#include <gtest/gtest.h>

#include <algorithm>
#include <functional>

#include "servo/test_ticked_loop.h"

namespace palpate {
namespace {

using testing::kBoneRadius_mm;
using testing::kMillisecond_s;
using testing::ProxyLoop;
using testing::TickedLoop;

// repeated presses and releases at a constant speed; returns the work of the force on the tip
double generated_mJ(ProxyLoop& loop, double speed_mm_s) {
  loop.parameters.friction = loop.parameters.viscosity = false;
  double given_mJ = 0;
  const double stride_mm = speed_mm_s * kMillisecond_s;
  double x_mm = kBoneRadius_mm + 10.5 * stride_mm;
  for (int n = 0; n < 400; ++n) {
    const double displacement_mm = n % 40 < 20 ? -stride_mm : stride_mm;
    given_mJ += loop.wrench.force_N.x() * displacement_mm;
    x_mm += displacement_mm;
    loop.at({x_mm, 0, 0});
  }
  return given_mJ;
}

TEST(Tick, PassivityReducesTheForceByUncoveredEnergyAndFlagsIt) {
  ProxyLoop free, kept;
  kept.parameters.passivity = true;
  for (ProxyLoop* loop : {&free, &kept}) loop->parameters.device[0].position_step_mm = 0.03;
  const double free_mJ = generated_mJ(free, 100), controlled_mJ = generated_mJ(kept, 100);
  EXPECT_NEAR(free_mJ, 10 * 1.5 * 0.1, 0.3) << "F v T of every press";
  EXPECT_LT(controlled_mJ, 0.15 * free_mJ);

  // last tick of a press that is being released
  EXPECT_EQ(free.record.switches & kSwitchPassivity, 0);
  EXPECT_LT(free.record.device[0].energy_mJ, -0.8 * free_mJ) << "observed in any case";
  bool acted = false;
  kept.lead({kBoneRadius_mm + 1, 0, 0}, {kBoneRadius_mm - 1, 0, 0}, 20);
  for (int n = 1; n <= 20; ++n) {
    kept.at({kBoneRadius_mm - 1 + 0.1 * n, 0, 0});
    const DeviceTick& device = kept.record.device[0];
    EXPECT_EQ(device.damping_N_s_per_m > 0, (device.flags & kFlagPassivity) != 0) << n;
    acted = acted || (device.flags & kFlagPassivity) != 0;
  }
  EXPECT_TRUE(acted);
}

TEST(Tick, ObjectRotationIsNotObservedAsEnergy) {
  // the tip moves with the ball, pressed in by a millimetre, while the world rotates
  ProxyLoop loop;
  loop.parameters.passivity = true;
  loop.lead({kBoneRadius_mm + 1, 0, 0}, {kBoneRadius_mm - 1, 0, 0}, 100);
  const double before_mJ = loop.record.device[0].energy_mJ;
  EXPECT_NEAR(before_mJ, 0.5 * 1.5, 0.05) << "what the spring holds";
  loop.parameters.rotation_target = Eigen::Quaterniond(Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitZ()));
  for (int n = 0; n < 100; ++n) {
    // position after this tick's rotation
    const double part = std::min(1.0, (n + 1) * kMillisecond_s / kRotationSettings.interval_s);
    const auto turn = Rotation<World, World>::about(Eigen::Vector3d::UnitZ(), 0.3 * part);
    loop.at(Point<World>((turn * Vector<World>(kBoneRadius_mm - 1, 0, 0)).eigen()));
  }
  EXPECT_NEAR(loop.record.device[0].energy_mJ, before_mJ, 0.02) << "1.5 N over 4.2 mm";
}

TEST(Tick, PassivityStateIsResetWithTheContact) {
  const std::pair<const char*, std::function<void(TickedLoop&, DeviceState&)>> losses[] = {
      {"pause", [](TickedLoop& loop, DeviceState&) { loop.parameters.paused = true; }},
      {"clutch", [](TickedLoop&, DeviceState& device) { device.status = kDeviceClutched; }},
      {"jump", [](TickedLoop&, DeviceState& device) { device.tip += Vector<World>(0, 20, 0); }},
      {"not finite", [](TickedLoop&, DeviceState& device) { device.tip = Point<World>(0, std::nan(""), 0); }},
      {"emergency stop", [](TickedLoop& loop, DeviceState&) { loop.parameters.emergency_stop = true; }}};
  for (const auto& [name, lose] : losses) {
    SCOPED_TRACE(name);
    ProxyLoop loop;
    loop.parameters.passivity = true;
    loop.lead({kBoneRadius_mm + 1, 0, 0}, {kBoneRadius_mm - 1, 0, 0}, 100);
    ASSERT_GT(loop.record.device[0].energy_mJ, 0.5);
    DeviceState device;
    device.tip = Point<World>(kBoneRadius_mm - 1, 0, 0);
    lose(loop, device);
    // until the force has faded out
    for (int n = 0; n < 110; ++n) loop.at(device);
    EXPECT_EQ(loop.record.device[0].energy_mJ, 0);
    EXPECT_EQ(loop.record.device[0].flags & kFlagPassivity, 0u);
  }
}

TEST(Tick, FadingForceNeverIncreases) {
  for (const bool clutched : {false, true}) {
    SCOPED_TRACE(clutched);
    ProxyLoop loop;
    loop.parameters.passivity = true;
    // 0.8 N per encoder step, softened to 0.15 N while energy is owed
    loop.parameters.device[0].force_gain = 10;
    loop.parameters.device[0].position_step_mm = 0.055;
    DeviceState device;
    device.tip = Point<World>(kBoneRadius_mm - 0.1, 0, 0);
    loop.lead({kBoneRadius_mm + 1, 0, 0}, device.tip, 100);
    loop.state.device[0].passivity.energy_mJ = -10;
    for (int n = 0; n < 10; ++n) loop.at(device);
    double before_N = loop.wrench.force_N.norm();
    ASSERT_GT(before_N, 0.1);
    ASSERT_LT(before_N, 0.5 * loop.record.device[0].unclamped_force_N);
    if (clutched)
      device.status = kDeviceClutched;
    else
      loop.parameters.paused = true;
    for (int n = 0; n < 110; ++n) {
      loop.at(device);
      EXPECT_LE(loop.wrench.force_N.norm(), before_N + 1e-12) << n;
      before_N = loop.wrench.force_N.norm();
    }
    EXPECT_EQ(before_N, 0);
  }
}

TEST(Tick, SwitchingThePassivityControllerBlends) {
  ProxyLoop loop;
  const Point<World> tip(kBoneRadius_mm - 1, 0, 0);
  loop.lead({kBoneRadius_mm + 1, 0, 0}, tip, 100);
  for (const bool on : {true, false}) {
    loop.parameters.passivity = on;
    loop.at(tip);
    EXPECT_TRUE(loop.record.device[0].flags & kFlagBlend);
    for (int n = 0; n < 150; ++n) loop.at(tip);
    EXPECT_FALSE(loop.record.device[0].flags & kFlagBlend);
  }
}

}  // namespace
}  // namespace palpate
