#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "servo/test_ticked_loop.h"

namespace palpate {
namespace {

using testing::kBone;
using testing::kBoneRadius_mm;
using testing::kMillisecond_s;
using testing::ProxyLoop;

// force on a tip that rested 1 mm deep and then moves outwards at a constant speed, after a dropout of the
// given duration
double returned_N(double speed_mm_s, double dropout_s, double moved_s, double bears_N_s_per_mm = kNoValue) {
  ProxyLoop loop;
  loop.parameters.friction = loop.parameters.viscosity = false;
  loop.parameters.max_force_N = 100;
  loop.parameters.device[0].max_damping_N_s_per_mm = bears_N_s_per_mm;
  double depth_mm = -0.5;
  const auto at = [&](double age_s) {
    DeviceState device;
    device.tip = Point<World>(kBoneRadius_mm - depth_mm, 0, 0);
    device.age_s = age_s;
    loop.at(device);
  };
  for (int n = 0; n < 1000; ++n) {
    depth_mm = std::min(1.0, depth_mm + 0.01);
    at(0);
  }
  for (int n = 1; n <= std::lround(dropout_s / kMillisecond_s); ++n) at(n * kMillisecond_s);
  for (int n = 0; n < std::lround(moved_s / kMillisecond_s); ++n) {
    depth_mm -= speed_mm_s * kMillisecond_s;
    at(0);
  }
  return loop.wrench.force_N.x();
}

TEST(Tick, RecoveryDamperLimitsSinkingAndReboundAfterAShortDropout) {
  constexpr double kDropout_s = 15e-3, kMoved_s = 30e-3;
  const double damping_N_s_per_mm = kOutputSettings.return_damping_N_s_per_m * 1e-3;
  for (const double speed_mm_s : {-20.0, -5.0, 0.0, 5.0, 15.0}) {
    SCOPED_TRACE(speed_mm_s);
    const double without_N = returned_N(speed_mm_s, 0, kMoved_s);
    EXPECT_NEAR(returned_N(speed_mm_s, kDropout_s, kMoved_s), without_N - damping_N_s_per_mm * speed_mm_s,
                1e-6);
    EXPECT_NEAR(returned_N(speed_mm_s, kDropout_s, kMoved_s, 0.002), without_N - 0.002 * speed_mm_s, 1e-6)
        << "no more than the device bears";
    EXPECT_NEAR(returned_N(speed_mm_s, 9e-3, kMoved_s), without_N, 1e-6) << "nothing was lost";
    EXPECT_LT(returned_N(speed_mm_s, 21e-3, kMoved_s), 0.1 * without_N + 1e-6) << "by the ramp";
  }
  // slow motion, for the whole recovery time
  EXPECT_NEAR(returned_N(1, kDropout_s, kOutputSettings.return_s + 5e-3),
              returned_N(1, 0, kOutputSettings.return_s + 5e-3), 1e-6)
      << "for a tenth of a second";
  // close to leaving contact, the damper neither pulls nor exceeds the contact force
  EXPECT_GE(returned_N(32, kDropout_s, kMoved_s), 0);
}

TEST(Tick, DampingIsClampedToTheDeviceLimit) {
  // out of contact at 40 mm/s, with and without damping: the proxy's tissue viscosity and coupling, the
  // trilinear method's tissue viscosity and its friction along the surface
  constexpr double kSpeed_mm_s = 40, kDepth_mm = 1.2;
  const ProxyLoop fresh;
  const auto damping_of = [&](ForceMethod method, double viscosity, double coupling, double along,
                              double largest, const Vector<World>& displacement, double gain = 1,
                              double scale = 1) {
    Vector<World> force_N[2];
    for (const bool damped : {false, true}) {
      ProxyLoop loop = fresh;
      Tissue& bone = loop.model.tissues[0];
      bone.viscosity_N_s_per_mm = damped ? viscosity : 0;
      bone.friction_damping_N_s_per_mm = damped ? along : 0;
      bone.friction = 1;
      bone.friction_max_N = 100;
      loop.model.method_settings.coupling_damping_N_s_per_mm = damped ? coupling : 0;
      loop.parameters.method = method;
      loop.parameters.friction = method != ForceMethod::kProxy;
      loop.parameters.device[0].max_damping_N_s_per_mm = largest;
      loop.parameters.device[0].force_gain = gain;
      loop.parameters.device[0].scale = scale;
      // down to the start of the path, then along it
      const Point<World> end(kBoneRadius_mm - kDepth_mm, 0, 0);
      const Point<World> begin = end - displacement * (30 * kSpeed_mm_s * kMillisecond_s);
      loop.lead(begin + Vector<World>(4, 0, 0), begin, 100);
      loop.lead(begin, end, 30);
      force_N[damped] = loop.wrench.force_N;
    }
    // at the device: N per device mm/s
    return -(force_N[1] - force_N[0]).dot(displacement) / (kSpeed_mm_s / scale);
  };
  const Vector<World> out(1, 0, 0), along(0, 1, 0);
  for (const double max_value : {0.012, 0.03}) {
    SCOPED_TRACE(max_value);
    EXPECT_NEAR(damping_of(ForceMethod::kProxy, 0.05, 0, 0, max_value, along), max_value, 1e-4);
    EXPECT_NEAR(damping_of(ForceMethod::kProxy, 0.05, 0.004, 0, max_value, out * -1.0), max_value, 1e-3);
    EXPECT_NEAR(damping_of(ForceMethod::kProxy, 0, 0.05, 0, max_value, out * -1.0), max_value, 1e-3);
    // a direct method's field has not reached its full value there
    EXPECT_LE(damping_of(ForceMethod::kTrilinear, 0.05, 0, 0, max_value, along), max_value);
    EXPECT_GT(damping_of(ForceMethod::kTrilinear, 0.05, 0, 0, max_value, along), 0.8 * max_value);
    EXPECT_NEAR(damping_of(ForceMethod::kTrilinear, 0.005, 0, 0.06, max_value, along), max_value, 1e-3);
  }
  // clamped by the damping rendered at the device
  EXPECT_NEAR(damping_of(ForceMethod::kProxy, 0.05, 0, 0, 0.012, along, 0.5, 3), 0.012, 1e-4);
  EXPECT_NEAR(damping_of(ForceMethod::kProxy, 0.002, 0, 0, 0.012, along, 0.5, 3), 0.003, 1e-4)
      << "less is whole";
  // unknown damping clamps nothing; the same for recordings without it
  for (const double unknown : {kNoValue, 0.0, -1.0})
    EXPECT_NEAR(damping_of(ForceMethod::kProxy, 0.05, 0, 0, unknown, along), 0.05, 1e-4);
}

TEST(Tick, PuncturedStructureRendersItsViscosity) {
  ProxyLoop loop;
  loop.model.surfaces[0].puncture_N = 1;
  loop.parameters.friction = false;
  loop.lead({kBoneRadius_mm + 2, 0, 0}, {kBoneRadius_mm - 4, 0, 0}, 200);
  for (int n = 0; n < 50; ++n) loop.at({kBoneRadius_mm - 4, 0, 0});
  EXPECT_EQ(loop.wrench.force_N, Vector<World>()) << "it rests";
  const double displacement_mm = 4;
  loop.lead({kBoneRadius_mm - 4, 0, 0}, {kBoneRadius_mm - 4 - displacement_mm, 0, 0}, 40);
  const double drag_N = loop.model.tissues[0].viscosity_N_s_per_mm * displacement_mm / (40 * kMillisecond_s);
  EXPECT_NEAR(loop.wrench.force_N.x(), drag_N, 0.1 * drag_N);
  EXPECT_EQ(loop.record.device[0].label, kBone);
  EXPECT_EQ(loop.record.device[0].path_label[0], kBone);
}

TEST(Tick, NegativeStiffnessCountsAsZero) {
  for (const ForceMethod method : {ForceMethod::kProxy, ForceMethod::kTrilinear}) {
    ProxyLoop loop;
    loop.parameters.friction = loop.parameters.viscosity = false;
    loop.parameters.method = method;
    loop.parameters.device[0].max_stiffness_N_per_mm = -1;
    loop.lead({kBoneRadius_mm + 2, 0, 0}, {kBoneRadius_mm - 1, 0, 0}, 100);
    EXPECT_EQ(loop.wrench.force_N, Vector<World>());
  }
}

TEST(Tick, CouplingDampingBuildsUpWithTheSpringAndNeverPullsInward) {
  ProxyLoop spring, damped;
  damped.model.method_settings.coupling_damping_N_s_per_mm = 0.01;
  for (ProxyLoop* loop : {&spring, &damped}) loop->parameters.friction = loop->parameters.viscosity = false;
  constexpr double kSpeed_mm_s = 100;
  double previous_N = 0, x_mm = kBoneRadius_mm + 2;
  for (int n = 0; n < 80; ++n) {
    SCOPED_TRACE(n);
    const bool in = n < 40;
    x_mm += in ? -0.1 : 0.1;
    spring.at({x_mm, 0, 0});
    damped.at({x_mm, 0, 0});
    const double spring_N = spring.wrench.force_N.x(), damped_N = damped.wrench.force_N.x();
    EXPECT_GE(damped_N, 0);
    EXPECT_EQ(damped_N > 0, spring_N > 0 && damped_N > 0);
    // growth of the spring's and the damper's force over the 10 ms window; a reversal changes the damper's by
    // twice as much
    EXPECT_LT(std::abs(damped_N - previous_N), 1.5 * 0.1 + 2 * 0.01 * kSpeed_mm_s / 10 + 0.05);
    if (n >= 35 && n < 40) {
      EXPECT_NEAR(damped_N - spring_N, 0.01 * kSpeed_mm_s, 0.05) << "B v";
    }
    if (n >= 52 && spring_N > 1.2) {
      EXPECT_NEAR(damped_N - spring_N, -0.01 * kSpeed_mm_s, 0.05);
    }
    previous_N = damped_N;
  }
  EXPECT_EQ(previous_N, 0);
}

}  // namespace
}  // namespace palpate
