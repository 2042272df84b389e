#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "servo/test_ticked_loop.h"

namespace palpate {
namespace {

using testing::ball_model;
using testing::kBone;
using testing::kBoneRadius_mm;
using testing::kMillisecond_s;
using testing::ProxyLoop;
using testing::TickedLoop;

// change of the force source while the tip is stationary
struct Change {
  const char* name;
  std::function<void(TickedLoop&)> apply;
};

TEST(Tick, ForceSourceChangeCausesNoForceStep) {
  const Change changes[] = {
      {"model",
       [](TickedLoop& loop) {
         testing::set_full_force(loop.model, 1.7 * loop.model.methods[0]->full_force_N());
         ++loop.model.version;
       }},
      {"gain", [](TickedLoop& loop) { loop.parameters.device[0].force_gain = 0.4; }},
      {"viscosity", [](TickedLoop& loop) { loop.parameters.viscosity = false; }},
      {"friction", [](TickedLoop& loop) { loop.parameters.friction = false; }},
      {"b-spline", [](TickedLoop& loop) { loop.parameters.method = ForceMethod::kSpline; }},
      {"smooth sphere", [](TickedLoop& loop) { loop.parameters.method = ForceMethod::kSmoothSphere; }},
  };
  const Model model = testing::with_every_method(ball_model());
  for (const Change& change : changes) {
    // sliding along the surface, so that friction and viscosity act
    TickedLoop stored, changed;
    stored.model = changed.model = model;
    stored.model.tissues[0].viscosity_N_s_per_mm = changed.model.tissues[0].viscosity_N_s_per_mm = 0.01;
    double largest_step_N = 0, undisturbed_N = 0, apart_N = 0;
    Vector<World> previous, previous_stored;
    for (int n = 0; n < 400; ++n) {
      const double angle = 1e-3 * n;
      const Point<World> tip(kBoneRadius_mm * std::cos(angle), kBoneRadius_mm * std::sin(angle), 0);
      if (n == 200) change.apply(changed);
      stored.at(tip);
      changed.at(tip);
      if (n > 100) {
        largest_step_N = std::max(largest_step_N, (changed.wrench.force_N - previous).norm());
        undisturbed_N = std::max(undisturbed_N, (stored.wrench.force_N - previous_stored).norm());
        apart_N = std::max(apart_N, (changed.wrench.force_N - stored.wrench.force_N).norm());
      }
      previous = changed.wrench.force_N;
      previous_stored = stored.wrench.force_N;
      // one tick tolerance for rounding
      if (n != 299) {
        ASSERT_EQ((changed.record.device[0].flags & kFlagBlend) != 0, n >= 200 && n < 299)
            << change.name << n;
      }
    }
    ASSERT_GT(apart_N, 0.02) << change.name << " must change something";
    // the blend is a smooth step over 0.1 s: at its steepest 1.5 times the mean slope
    EXPECT_LT(largest_step_N, 1.2 * undisturbed_N + 1.6 * apart_N * kMillisecond_s / kOutputSettings.blend_s)
        << change.name;

    // the final force is the one that the change alone produces
    TickedLoop from_the_start;
    from_the_start.model = model;
    from_the_start.model.tissues[0].viscosity_N_s_per_mm = 0.01;
    change.apply(from_the_start);
    for (int n = 0; n < 400; ++n)
      from_the_start.at(
          Point<World>(kBoneRadius_mm * std::cos(1e-3 * n), kBoneRadius_mm * std::sin(1e-3 * n), 0));
    EXPECT_EQ(from_the_start.wrench.force_N, changed.wrench.force_N) << change.name;
  }
}

TEST(Tick, AnyMethodChangeCausesNoForceStep) {
  // the tip is stationary, so that only the method changes the force
  const Model model = testing::with_every_method(ball_model({0.6, 0.6, 0.9}, 1.0, 3));
  for (const ForceMethodInfo& from : kDirectMethods) {
    TickedLoop loop;
    loop.model = model;
    loop.parameters.method = from.method;
    for (const ForceMethodInfo& to : kDirectMethods) {
      SCOPED_TRACE(std::string(from.name) + " to " + std::string(to.name));
      const Point<World> tip(kBoneRadius_mm + 1.1, 0.2, -0.3);
      loop.parameters.method = from.method;
      for (int n = 0; n < 150; ++n) loop.at(tip);
      const Vector<World> before = loop.wrench.force_N;
      EXPECT_EQ(loop.record.device[0].flags & kFlagBlend, 0u);

      loop.parameters.method = to.method;
      Vector<World> previous = before;
      double largest_step_N = 0;
      for (int n = 0; n < 150; ++n) {
        loop.at(tip);
        EXPECT_EQ(loop.record.method, static_cast<std::uint8_t>(to.method));
        largest_step_N = std::max(largest_step_N, (loop.wrench.force_N - previous).norm());
        previous = loop.wrench.force_N;
      }
      EXPECT_LE(largest_step_N,
                1.6 * (previous - before).norm() * kMillisecond_s / kOutputSettings.blend_s + 1e-12);
      // same force as if that method had been used from the start
      TickedLoop fresh;
      fresh.model = model;
      fresh.parameters.method = to.method;
      fresh.at(tip);
      EXPECT_EQ(previous, fresh.wrench.force_N);
    }
  }
}

TEST(Tick, EndlessForceSourceChangesDoNotFreezeTheForce) {
  // a switch that toggles in every tick, as a malicious viewer could cause, while the tip leaves the bone
  ProxyLoop loop;
  const Point<World> pressed(kBoneRadius_mm - 1, 0, 0), free(kBoneRadius_mm + 5, 0, 0);
  loop.lead({kBoneRadius_mm + 2, 0, 0}, pressed, 200);
  const double before_N = loop.wrench.force_N.norm();
  ASSERT_GT(before_N, 0.5);
  for (int n = 0; n < 300; ++n) {
    loop.parameters.viscosity = !loop.parameters.viscosity;
    loop.at(pressed + (free - pressed) * std::min(1.0, n / 50.0));
  }
  EXPECT_LT(loop.wrench.force_N.norm(), 0.05 * before_N);
}

TEST(Tick, ChangeFromDirectMethodToProxyCausesNoForceStep) {
  ProxyLoop loop;
  loop.parameters.method = ForceMethod::kTrilinear;
  const Point<World> tip(kBoneRadius_mm + 0.2, 0, 0);
  for (int n = 0; n < 200; ++n) loop.at(tip);
  const double before_N = loop.wrench.force_N.norm();
  ASSERT_GT(before_N, 0.5) << "the ramp begins in front of the surface";
  loop.parameters.method = ForceMethod::kProxy;
  double previous_N = before_N, largest_step_N = 0;
  for (int n = 0; n < 200; ++n) {
    loop.at(tip);
    largest_step_N = std::max(largest_step_N, std::abs(loop.wrench.force_N.norm() - previous_N));
    previous_N = loop.wrench.force_N.norm();
  }
  EXPECT_EQ(previous_N, 0) << "the surface is not reached yet";
  EXPECT_LE(largest_step_N, 1.6 * before_N * kMillisecond_s / kOutputSettings.blend_s);
}

// floor at z = 0: bone for x < 1, cartilage with a third of its stiffness for x > -1; they overlap, so that
// corners rounded by voxels leave no groove
Model seamed_floor() {
  Model model = testing::with_exact_surfaces(ball_model());
  const GridGeometry& grid = model.labels->geometry();
  const auto side = [&](double sign) {
    const SignedField field = testing::sampled_distance(
        grid, [sign](const Eigen::Vector3d& p) { return std::max(p.z(), sign * p.x() - 1); }, 4);
    return std::make_shared<const Surface>(field, field, testing::steepest_of(field));
  };
  ContactSurface bone = model.surfaces[0], cartilage = bone;
  bone.surface = side(1);
  cartilage.surface = side(-1);
  cartilage.stiffness_N_per_mm = bone.stiffness_N_per_mm / 3;
  model.surfaces = {bone, cartilage};
  model.label_of_surface = {kBone, kBone};
  return model;
}

TEST(Tick, NoEventCausesAStepOfTheProxyForce) {
  // 1 mm below the floor, across the seam from 1.5 to 0.5 N/mm at 50 mm/s, and stationary during changes
  ProxyLoop loop;
  loop.model = seamed_floor();
  loop.parameters.passivity = true;
  loop.parameters.viscosity = false;
  loop.parameters.device[0].limits.slew_N_per_s = 2000;
  const auto below = [&](double x_mm, double depth_mm) {
    return loop.model.X_WorldPatient * Point<Patient>(x_mm, 0, -depth_mm);
  };
  Vector<World> previous;
  const auto largest_step_N = [&](int ticks, const std::function<Point<World>(int)>& at) {
    double largest_N = 0;
    for (int n = 0; n < ticks; ++n) {
      loop.at(at(n));
      largest_N = std::max(largest_N, (loop.wrench.force_N - previous).norm());
      previous = loop.wrench.force_N;
    }
    return largest_N;
  };
  const auto resting = [&](int) { return below(5, 1); };
  const auto expect_no_step = [](const char* what, double largest_N, double max_N) {
    RecordProperty(what, std::to_string(largest_N));
    std::printf("largest change of force in a tick, %s: %.4f N\n", what, largest_N);
    EXPECT_LT(largest_N, max_N) << what;
  };
  largest_step_N(200, [&](int n) { return below(-5, -1 + 0.01 * n); });
  ASSERT_NEAR(previous.norm(), 1.5, 0.05) << "1 mm below bone";
  expect_no_step("seam", largest_step_N(200, [&](int n) { return below(-5 + 0.05 * n, 1); }), 0.12);
  EXPECT_NEAR(previous.norm(), 0.5, 0.05) << "1 mm below cartilage";

  loop.parameters.rotation_target = Eigen::Quaterniond(Eigen::AngleAxisd(0.02, Eigen::Vector3d::UnitZ()));
  expect_no_step("rotation", largest_step_N(300, resting), 0.02);
  loop.parameters.device[0].force_gain = 2;
  expect_no_step("gain", largest_step_N(300, resting), 0.02);
  loop.parameters.friction = false;
  expect_no_step("friction", largest_step_N(300, resting), 0.02);
  loop.parameters.passivity = false;
  expect_no_step("controller", largest_step_N(300, resting), 0.02);
  loop.parameters.device[0].max_stiffness_N_per_mm = 0.5;
  expect_no_step("most stiffness", largest_step_N(300, resting), 0.04);
  ++loop.model.version;
  expect_no_step("model", largest_step_N(300, resting), 0.02);
  EXPECT_FALSE(loop.record.device[0].flags & kFlagInside) << "free of the new surfaces";
  EXPECT_NEAR(previous.norm(), 0.5, 0.05);
  loop.parameters.paused = true;
  expect_no_step("pause", largest_step_N(300, resting), 0.02);
}

}  // namespace
}  // namespace palpate
