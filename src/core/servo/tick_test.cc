#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <random>

#include "contact/test_model.h"
#include "palpate/servo/servo.h"

namespace palpate {
namespace {

using testing::ball_model;
using testing::kBone;
using testing::kBoneRadius_mm;
using testing::kCartilage;

constexpr double kMillisecond_s = 1e-3;

// a single device, ticked at given tip positions, with an output stage that does not ramp, slew or damp
// unless a test configures it
struct TickedLoop {
  Model model = ball_model();
  Parameters parameters;
  SessionState state;
  TickRecord record;
  Wrench wrench;

  TickedLoop() {
    state.device[0].output.gain = 1;
    parameters.passivity = false;
    parameters.device[0].limits.slew_N_per_s = std::numeric_limits<double>::infinity();
    parameters.device[0].limits.peak_torque_Nmm = 1000;
  }
  void at(const DeviceState& device) {
    tick(model, parameters, {&device, 1}, kMillisecond_s, state, {&wrench, 1}, record);
  }
  void at(const Point<World>& tip) {
    DeviceState device;
    device.tip = tip;
    at(device);
  }
  // farther than the jump threshold of one tick
  void set_down_at(const Point<World>& tip) {
    state.device[0].has_previous = false;
    at(tip);
  }
};

TEST(Tick, PushesOutAlongTheAnalyticNormalWithTheAnalyticForce) {
  TickedLoop loop;
  loop.parameters.friction = loop.parameters.viscosity = false;
  loop.parameters.max_force_N = 100;
  const double full_N = loop.model.methods[0]->full_force_N();
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  for (int i = 0; i < 200; ++i) {
    const Vector<World> n = Vector<World>(normal(random), normal(random), normal(random)).normalized();
    const double distance_mm = -0.6 + 0.006 * i;
    loop.set_down_at(Point<World>() + n * (kBoneRadius_mm + distance_mm));
    const double expected_N = full_N * testing::ramp(distance_mm, 1.0);
    EXPECT_GT(loop.wrench.force_N.normalized().dot(n), std::cos(0.05))
        << "central differences over 0.9 mm of a 1 mm ramp, at " << distance_mm << " mm";
    EXPECT_NEAR(loop.wrench.force_N.norm(), expected_N, 0.06 * full_N);
    EXPECT_EQ(loop.record.device[0].label, kBone);
    EXPECT_TRUE(loop.record.device[0].flags & kFlagContact);
  }
}

TEST(Tick, ForceSlopeAtTheSurfaceEqualsTissueStiffness) {
  TickedLoop loop;
  loop.parameters.friction = loop.parameters.viscosity = false;
  loop.parameters.max_force_N = 100;
  loop.at(Point<World>(kBoneRadius_mm - 0.1, 0, 0));
  const double deeper_N = loop.wrench.force_N.x();
  loop.at(Point<World>(kBoneRadius_mm + 0.1, 0, 0));
  // trilinear interpolation flattens the ramp's steepest part a little
  EXPECT_NEAR((deeper_N - loop.wrench.force_N.x()) / 0.2, 1.5, 0.15);
}

TEST(Tick, ForceRotatesWithTheObject) {
  // the ball is displaced from the pivot to break the symmetry: the contact must rotate rigidly with it
  TickedLoop still, turned;
  still.parameters.friction = still.parameters.viscosity = false;
  still.model.X_WorldPatient = Transform<World, Patient>(still.model.X_WorldPatient.linear(), {4, 1, -2});
  turned.parameters = still.parameters;
  turned.model.X_WorldPatient = still.model.X_WorldPatient;
  const auto R = Rotation<World, World>::about(Eigen::Vector3d(1, 2, -1).normalized(), 0.7);
  turned.parameters.rotation_target = R.quaternion();
  for (int n = 0; n < 400; ++n) turned.at(Point<World>(40, 0, 0));  // until the rotation is complete
  for (int i = 0; i < 50; ++i) {
    const Point<World> tip(4 + kBoneRadius_mm * std::cos(0.1 * i), 1 + kBoneRadius_mm * std::sin(0.1 * i),
                           -2 + 0.1 * i);
    still.set_down_at(tip);
    turned.set_down_at(Point<World>((R * Vector<World>(tip.eigen())).eigen()));
    EXPECT_LT((turned.wrench.force_N - R * still.wrench.force_N).norm(), 1e-9);
    EXPECT_NEAR(turned.record.device[0].depth_mm, still.record.device[0].depth_mm, 1e-9);
  }
}

TEST(Tick, RotationCommandCausesNoForceStep) {
  TickedLoop loop;
  loop.parameters.friction = loop.parameters.viscosity = false;
  // displaced from the pivot, so that a rotation moves the surface under the stationary tip
  loop.model.X_WorldPatient = Transform<World, Patient>(loop.model.X_WorldPatient.linear(), {10, 0, 0});
  const Point<World> tip(10, kBoneRadius_mm, 0);
  loop.at(tip);
  Vector<World> previous = loop.wrench.force_N;
  double largest_step_N = 0, total_N = 0;
  for (int command = 1; command <= 5; ++command) {
    loop.parameters.rotation_target =
        Rotation<World, World>::about(Eigen::Vector3d::UnitZ(), -0.01 * command).quaternion();
    for (int n = 0; n < 100; ++n) {
      loop.at(tip);
      largest_step_N = std::max(largest_step_N, (loop.wrench.force_N - previous).norm());
      previous = loop.wrench.force_N;
    }
    total_N = std::max(total_N, (loop.wrench.force_N).norm());
  }
  EXPECT_LT(largest_step_N, 0.01) << "a command of 0.1 mm at 1.5 N/mm is spread over 100 ticks";
  const Eigen::Quaterniond rotation = loop.state.rotation_applied,
                           requested = loop.parameters.rotation_target;
  EXPECT_NEAR(rotation.angularDistance(requested), 0, 1e-12) << "and arrives";
}

TEST(Tick, InvalidRotationCommandIsIgnoredAndFlagged) {
  TickedLoop loop;
  const auto R = Rotation<World, World>::about(Eigen::Vector3d::UnitY(), 0.2);
  loop.parameters.rotation_target = R.quaternion();
  for (int n = 0; n < 150; ++n) loop.at(Point<World>(kBoneRadius_mm, 0, 0));
  EXPECT_FALSE(loop.record.device[0].flags & kFlagRotationIgnored);
  for (const double w : {0.0, 1e-300, 1e200, HUGE_VAL, std::nan("")}) {
    loop.parameters.rotation_target = Eigen::Quaterniond(w, 0, 0, 0);
    for (int n = 0; n < 150; ++n) loop.at(Point<World>(kBoneRadius_mm, 0, 0));
    EXPECT_TRUE(loop.record.device[0].flags & kFlagRotationIgnored) << w;
    EXPECT_NEAR(loop.state.rotation_applied.angularDistance(R.quaternion()), 0, 1e-12) << w;
    EXPECT_GT(loop.wrench.force_N.norm(), 0.1) << "what is touched is still felt";
  }
}

TEST(Tick, DeepInsideCountsAsContactWithoutForce) {
  TickedLoop loop;
  for (int n = 0; n < 30; ++n) loop.at(Point<World>(0, 0, 0));
  EXPECT_EQ(loop.wrench.force_N, Vector<World>());
  EXPECT_EQ(loop.record.device[0].label, kBone);
  EXPECT_TRUE(loop.record.device[0].flags & kFlagContact);
}

TEST(Tick, VelocityIsRelativeToTheObject) {
  // a tip that moves with the turning object does not move relative to it
  TickedLoop loop;
  const auto turn_at = [](double t) {
    return Rotation<World, World>::about(Eigen::Vector3d::UnitZ(), 0.5 * t);
  };
  double t = 0;
  for (int command = 0; command < 10; ++command) {
    loop.parameters.rotation_target = turn_at(t + 0.1).quaternion();
    for (int n = 0; n < 100; ++n) {
      t += kMillisecond_s;
      loop.at(Point<World>((turn_at(t) * Vector<World>(0, kBoneRadius_mm, 0)).eigen()));
    }
  }
  const auto& v = loop.record.device[0].velocity_patient_mm_s;
  EXPECT_LT(std::hypot(v[0], v[1], v[2]), 1e-6) << "the tip itself moves at 7.5 mm/s";
}

TEST(Tick, ForceIsClampedToTheLimitAndFlagged) {
  TickedLoop loop;
  loop.parameters.max_force_N = 0.8;
  for (double x = 20; x > 5; x -= 0.05) {
    loop.at(Point<World>(x, 0.3, 0));
    ASSERT_LE(loop.wrench.force_N.norm(), 0.8);
    const bool above = loop.record.device[0].unclamped_force_N > 0.8;
    EXPECT_EQ((loop.record.device[0].flags & kFlagClamped) != 0, above);
  }
}

TEST(Tick, NonFinitePosesGiveZeroForce) {
  TickedLoop loop;
  loop.at(Point<World>(kBoneRadius_mm, 0, 0));
  for (const double bad : {std::nan(""), HUGE_VAL, -HUGE_VAL}) {
    loop.at(Point<World>(0, bad, 0));
    EXPECT_EQ(loop.wrench.force_N, Vector<World>());
    EXPECT_TRUE(loop.record.device[0].flags & kFlagNotFinite);
  }
  // the velocity window is reset: the jump back is not motion; the force ramps in
  loop.at(Point<World>(kBoneRadius_mm, 0, 0));
  EXPECT_EQ(loop.record.device[0].velocity_patient_mm_s, (std::array<double, 3>{}));
  EXPECT_TRUE(loop.record.device[0].flags & kFlagRamp);
  for (int n = 0; n < 600; ++n) loop.at(Point<World>(kBoneRadius_mm, 0, 0));
  EXPECT_GT(loop.wrench.force_N.norm(), 0.1);
}

TEST(Tick, JumpZeroesTheForceThenRampsIn) {
  TickedLoop loop;
  loop.at(Point<World>(kBoneRadius_mm, 0, 0));
  EXPECT_GT(loop.wrench.force_N.norm(), 0.1);
  loop.at(Point<World>(kBoneRadius_mm - 10.1, 0, 0));
  EXPECT_EQ(loop.wrench.force_N, Vector<World>());
  EXPECT_TRUE(loop.record.device[0].flags & kFlagJump);
  loop.at(Point<World>(kBoneRadius_mm, 0, 0));
  loop.at(Point<World>(kBoneRadius_mm, 0, 0));
  EXPECT_FALSE(loop.record.device[0].flags & kFlagJump);
  EXPECT_LT(loop.wrench.force_N.norm(), 0.01);
  EXPECT_EQ(loop.record.device[0].velocity_patient_mm_s, (std::array<double, 3>{})) << "no speed of 10 m/s";
  // the threshold applies to the device's displacement: 4 mm at scale 4 are 16 mm in the patient
  loop.parameters.device[0].scale = 4;
  loop.set_down_at(Point<World>(kBoneRadius_mm, 0, 0));
  loop.at(Point<World>(kBoneRadius_mm + 16, 0, 0));
  EXPECT_FALSE(loop.record.device[0].flags & kFlagJump);
  loop.at(Point<World>(kBoneRadius_mm + 57, 0, 0));
  EXPECT_TRUE(loop.record.device[0].flags & kFlagJump);
  loop.parameters.device[0].scale = 1;
  loop.set_down_at(Point<World>(kBoneRadius_mm, 0, 0));
  // the fastest hand motion is not a jump
  for (int n = 0; n < 40; ++n) {
    loop.at(Point<World>(kBoneRadius_mm + 3 * n, 0, 0));
    EXPECT_FALSE(loop.record.device[0].flags & kFlagJump) << n;
  }
}

TEST(Tick, PauseFadesOutAndBackIn) {
  TickedLoop loop;
  const Point<World> tip(kBoneRadius_mm, 0, 0);
  loop.at(tip);
  const double full_N = loop.wrench.force_N.norm();
  double previous_N = full_N;
  loop.parameters.paused = true;
  for (int n = 0; n < 150; ++n) {
    loop.at(tip);
    EXPECT_TRUE(loop.record.device[0].flags & kFlagPaused);
    EXPECT_NEAR(loop.wrench.force_N.norm(), previous_N, 0.0101 * full_N) << "no step";
    previous_N = loop.wrench.force_N.norm();
  }
  EXPECT_EQ(previous_N, 0);
  loop.parameters.paused = false;
  for (int n = 0; n < 510; ++n) {
    loop.at(tip);
    EXPECT_NEAR(loop.wrench.force_N.norm(), previous_N, 0.0021 * full_N) << "no step";
    previous_N = loop.wrench.force_N.norm();
  }
  EXPECT_NEAR(previous_N, full_N, 1e-12);
}

TEST(Tick, NonFiniteForceDoesNotPersistInTheState) {
  TickedLoop loop;
  const Point<World> tip(kBoneRadius_mm, 0, 0);
  loop.at(tip);
  const double full_N = loop.model.methods[0]->full_force_N();
  testing::set_full_force(loop.model, std::nan(""));
  loop.at(tip);
  EXPECT_EQ(loop.wrench.force_N, Vector<World>());
  // a new version repairs the model: a blend that starts from a non-finite force would stay non-finite
  testing::set_full_force(loop.model, full_N);
  ++loop.model.version;
  loop.at(tip);
  EXPECT_FALSE(loop.record.device[0].flags & kFlagNotFinite);
}

TEST(Tick, EmergencyStopAndStatusFaultsZeroTheForceAtOnce) {
  TickedLoop loop;
  DeviceState device;
  device.tip = Point<World>(kBoneRadius_mm, 0, 0);
  const auto expect_off = [&](std::uint32_t flag) {
    loop.at(device);
    EXPECT_EQ(loop.wrench.force_N, Vector<World>());
    EXPECT_TRUE(loop.record.device[0].flags & flag);
    loop.state.device[0].output.gain = 1;
  };
  loop.at(device);
  ASSERT_GT(loop.wrench.force_N.norm(), 0.1);
  loop.parameters.emergency_stop = true;
  expect_off(kFlagEmergencyStop);
  EXPECT_TRUE(loop.record.switches & kSwitchEmergencyStop);
  loop.parameters.emergency_stop = false;
  device.status = kDeviceFault;
  expect_off(kFlagDeviceFault);
  device.status = kDeviceHalted;
  expect_off(kFlagHalted);
  device.status = 0;
  device.age_s = 0.02;
  expect_off(kFlagStale);
}

TEST(Tick, GainsScaleTheForceBeforeTheLimit) {
  TickedLoop one, two;
  one.parameters.max_force_N = two.parameters.max_force_N = 2;
  two.parameters.device[0].force_gain = 2;
  two.parameters.device[0].scale = 4;
  one.model.tools[0].points_mm = two.model.tools[0].points_mm = {{0, 3, 0}};
  one.at(Point<World>(kBoneRadius_mm, -3, 0));
  two.at(Point<World>(kBoneRadius_mm, -3, 0));
  ASSERT_GT(one.wrench.torque_Nmm.norm(), 0.1);
  // the output stage clamps force and torque by the same factor
  const double clamp = std::min(1.0, 2 / two.record.device[0].unclamped_force_N);
  EXPECT_NEAR(two.record.device[0].unclamped_force_N, 2 * one.record.device[0].unclamped_force_N, 1e-12);
  EXPECT_LT((two.wrench.force_N - one.wrench.force_N * 2 * clamp).norm(), 1e-9);
  EXPECT_LT((two.wrench.torque_Nmm - one.wrench.torque_Nmm * (2.0 / 4) * clamp).norm(), 1e-9);
}

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

// a loop that uses the proxy method
struct ProxyLoop : TickedLoop {
  explicit ProxyLoop(double cartilage_mm = 0) {
    model = testing::with_exact_surfaces(ball_model({0.6, 0.6, 0.9}, 1.0, cartilage_mm), cartilage_mm);
    parameters.method = ForceMethod::kProxy;
    parameters.max_force_N = 100;
  }
  void lead(const Point<World>& from, const Point<World>& to, int ticks) {
    for (int n = 1; n <= ticks; ++n) at(from + (to - from) * (static_cast<double>(n) / ticks));
  }
};

TEST(Tick, ProxyRendersTheTissueStiffness) {
  ProxyLoop loop;
  loop.parameters.friction = loop.parameters.viscosity = false;
  loop.lead({kBoneRadius_mm + 3, 0, 0}, {kBoneRadius_mm - 2, 0, 0}, 100);
  const DeviceTick& device = loop.record.device[0];
  EXPECT_NEAR(loop.wrench.force_N.x(), 2 * 1.5, 0.03);
  EXPECT_LT(std::hypot(loop.wrench.force_N.y(), loop.wrench.force_N.z()), 0.05);
  EXPECT_EQ(device.label, kBone);
  EXPECT_TRUE(device.flags & kFlagContact);
  EXPECT_EQ(device.flags & (kFlagInside | kFlagWedged | kFlagMethodMissing), 0u);
  EXPECT_NEAR(device.depth_mm, 2, 0.02);
  const auto& proxy = device.proxy_patient_mm;
  EXPECT_NEAR(Vector<Patient>(proxy[0], proxy[1], proxy[2]).norm(), kBoneRadius_mm, 0.03);
}

TEST(Tick, RecordedNormalIsWithinTheFrictionConeOfTheForce) {
  // Terraces of 0.7 mm with the normals of the slope, as smoothed normals are: the proxy rests on the
  // terraces' edges. And a notch between two walls.
  const auto slope_mm = [](const Eigen::Vector3d& p) {
    return (p.z() - 0.0875 * p.x()) / std::hypot(1, 0.0875);
  };
  const auto terraces_mm = [](const Eigen::Vector3d& p) {
    const double at = 0.0875 * p.x() / 0.7;
    return 0.9 * (p.z() - 0.7 * (std::floor(at) + std::clamp(8 * (at - std::floor(at)) - 3.5, 0.0, 1.0)));
  };
  const auto notch_mm = [](const Eigen::Vector3d& p) {
    return std::max(p.z() - std::abs(p.x()), -30.0) / std::sqrt(2.0);
  };
  for (const double coefficient : {0.0, 0.025, 0.3})
    for (const bool notch : {false, true}) {
      SCOPED_TRACE(std::to_string(coefficient) + (notch ? ", notch" : ", terraces"));
      ProxyLoop loop;
      loop.parameters.viscosity = false;
      loop.parameters.friction = coefficient > 0;
      const GridGeometry& grid = loop.model.labels->geometry();
      const auto position = notch ? testing::sampled_distance(grid, notch_mm, 4)
                                  : testing::sampled_distance(grid, terraces_mm, 4);
      const auto normals = notch ? position : testing::sampled_distance(grid, slope_mm, 4);
      loop.model.surfaces = {
          {{1.5, coefficient, coefficient},
           std::make_shared<const Surface>(position, normals, testing::steepest_of(position))}};
      loop.model.label_of_surface = {kBone};
      const auto at = [&](double x, double y, double z) {
        DeviceState device;
        device.tip = loop.model.X_WorldPatient * Point<Patient>(x, y, z);
        loop.at(device);
      };
      at(-6, 0, 3);
      for (int n = 0; n < 400; ++n) at(-6, 0, 3 - 0.01 * n);
      double farthest = 0;
      for (int n = 0; n < 12'000; ++n) {
        const double x = -6 + 0.001 * n;
        at(x, 0.5 * std::sin(0.003 * n), (notch ? std::abs(x) : 0.0875 * x) - 1);
        const auto& observed = loop.record.device[0];
        const Vector<Patient> normal(observed.normal_patient[0], observed.normal_patient[1],
                                     observed.normal_patient[2]);
        const Vector<Patient> force = loop.model.X_WorldPatient.inverse() * loop.wrench.force_N;
        if (force.norm() < 0.1) continue;
        ASSERT_NEAR(normal.norm(), 1, 1e-9);
        farthest = std::max(farthest, force.cross(normal).norm() / force.dot(normal));
        ASSERT_GT(force.dot(normal), 0);
      }
      EXPECT_LT(farthest, coefficient + 0.001) << "tangential over normal force";
    }
}

TEST(Tick, ProxyReportsTheLabelUnderTheContact) {
  ProxyLoop loop(3);
  loop.lead({kBoneRadius_mm + 6, 0, 0}, {kBoneRadius_mm + 2, 0, 0}, 100);
  EXPECT_EQ(loop.record.device[0].label, kCartilage);
  EXPECT_NEAR(loop.wrench.force_N.x(), 1 * 0.75, 0.05) << "cartilage's own stiffness";
}

TEST(Tick, ProxyReportsTheStructureOfADisplacedSurface) {
  // Model of bone bordering a skin that can be punctured: its surface in the outer layer follows the
  // structures' surfaces. Where it was smoothed there may be no felt voxel under it.
  ProxyLoop loop;
  ContactSurface outer = loop.model.surfaces[0];
  outer.structure = 0;
  loop.model.surfaces[0].surface = nullptr;
  loop.model.surfaces.push_back(outer);
  loop.model.labels = label_bricks(Volume<LabelId>(loop.model.labels->geometry()));
  ASSERT_EQ(loop.model.label_of_surface.size(), 1u);
  loop.lead({kBoneRadius_mm + 6, 0, 0}, {kBoneRadius_mm - 0.5, 0, 0}, 100);
  EXPECT_GT(loop.wrench.force_N.x(), 0.3);
  EXPECT_EQ(loop.record.device[0].label, kBone);
}

TEST(Tick, ReportsTheStructuresAlongThePenetrationPath) {
  ProxyLoop loop(3);
  const DeviceTick& device = loop.record.device[0];
  loop.lead({kBoneRadius_mm + 6, 0, 0}, {kBoneRadius_mm + 4, 0, 0}, 100);
  EXPECT_EQ(device.path_label[0], 0) << "nothing is touched";
  loop.lead({kBoneRadius_mm + 4, 0, 0}, {kBoneRadius_mm + 2, 0, 0}, 100);
  EXPECT_EQ(device.path_label[0], kCartilage);
  EXPECT_NEAR(device.path_depth_mm[0], 1, 0.02);
  EXPECT_NEAR(device.path_share[0], 1, 1e-12);
  EXPECT_EQ(device.path_label[1], 0);
  // by a direct method the touched structure accounts for the whole force
  loop.parameters.method = ForceMethod::kTrilinear;
  loop.at({kBoneRadius_mm + 2, 0, 0});
  EXPECT_EQ(device.path_label[0], device.label);
  EXPECT_EQ(device.path_depth_mm[0], device.depth_mm);
  EXPECT_EQ(device.path_share[0], 1);
}

TEST(Tick, ProxyIsUncoupledForATipInsideAtStartOrAfterAPause) {
  ProxyLoop loop;
  loop.at({kBoneRadius_mm - 1, 0, 0});
  EXPECT_TRUE(loop.record.device[0].flags & kFlagInside);
  EXPECT_EQ(loop.wrench.force_N, Vector<World>());
  loop.lead({kBoneRadius_mm - 1, 0, 0}, {kBoneRadius_mm + 1, 0, 0}, 50);
  EXPECT_FALSE(loop.record.device[0].flags & kFlagInside);
  loop.lead({kBoneRadius_mm + 1, 0, 0}, {kBoneRadius_mm - 1, 0, 0}, 50);
  EXPECT_GT(loop.wrench.force_N.x(), 1);
  // paused in contact: the surface point of first contact is forgotten
  loop.parameters.paused = true;
  for (int n = 0; n < 300; ++n) loop.at({kBoneRadius_mm - 1, 0, 0});
  loop.parameters.paused = false;
  for (int n = 0; n < 600; ++n) loop.at({kBoneRadius_mm - 1, 0, 0});
  EXPECT_TRUE(loop.record.device[0].flags & kFlagInside);
  EXPECT_EQ(loop.wrench.force_N, Vector<World>());
}

TEST(Tick, SetDownTipHasNoContactJumpOrForceRamp) {
  // within and beyond the displacement of a jump; on the far side of the ball, where no proxy could follow
  for (const double x_mm : {kBoneRadius_mm + 7, -kBoneRadius_mm - 3}) {
    for (const bool set_down : {true, false}) {
      SCOPED_TRACE(::testing::Message() << x_mm << " mm, set down " << set_down);
      ProxyLoop loop;
      loop.lead({kBoneRadius_mm + 3, 0, 0}, {kBoneRadius_mm - 2, 0, 0}, 100);
      ASSERT_TRUE(loop.record.device[0].flags & kFlagContact);
      DeviceState device;
      device.tip = {x_mm, 0, 0};
      device.status = set_down ? std::uint32_t{kDeviceSetDown} : 0u;
      loop.at(device);
      const DeviceTick& tick = loop.record.device[0];
      EXPECT_EQ((tick.flags & kFlagJump) != 0, !set_down && x_mm < 0);
      if (!set_down) continue;
      EXPECT_EQ(tick.flags & (kFlagContact | kFlagInside | kFlagRamp), 0u);
      EXPECT_EQ(loop.wrench.force_N, Vector<World>());
      EXPECT_NEAR(tick.proxy_patient_mm[0], x_mm, 1e-9);
      EXPECT_EQ(tick.velocity_patient_mm_s, (std::array<double, 3>{}));
      loop.lead({x_mm, 0, 0}, {std::copysign(kBoneRadius_mm - 1, x_mm), 0, 0}, 100);
      EXPECT_GT(std::copysign(1.0, x_mm) * loop.wrench.force_N.x(), 1);
      EXPECT_EQ(tick.flags & kFlagRamp, 0u);
    }
  }
  // inside of the ball the side of the surface is unknown
  ProxyLoop loop;
  loop.lead({kBoneRadius_mm + 3, 0, 0}, {kBoneRadius_mm - 2, 0, 0}, 100);
  DeviceState device;
  device.tip = {kBoneRadius_mm - 2, 0, 0};
  device.status = kDeviceSetDown;
  loop.at(device);
  EXPECT_TRUE(loop.record.device[0].flags & kFlagInside);
  EXPECT_EQ(loop.wrench.force_N, Vector<World>());
}

TEST(Tick, ProxySticksToARotatingObject) {
  ProxyLoop loop;
  for (ContactSurface& surface : loop.model.surfaces) {
    surface.static_friction = 2;
    surface.friction = 1.9;
  }
  const Point<World> tip(kBoneRadius_mm - 1, 0, 0);
  loop.lead({kBoneRadius_mm + 2, 0, 0}, tip, 100);
  const auto stuck = loop.record.device[0].proxy_patient_mm;
  // four degrees about the up axis: the surface point moves away under the tip by about a millimetre
  loop.parameters.rotation_target = Eigen::Quaterniond(Eigen::AngleAxisd(0.07, Eigen::Vector3d::UnitZ()));
  for (int n = 0; n < 10'000; ++n) loop.at(tip);
  const auto now = loop.record.device[0].proxy_patient_mm;
  for (int axis = 0; axis < 3; ++axis) EXPECT_NEAR(now[axis], stuck[axis], 1e-3) << "mm";
  EXPECT_GT(loop.wrench.force_N.y(), 0.5) << "dragged along with the object";
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

TEST(Tick, ProxyInsideNewSurfacesIsUncoupled) {
  ProxyLoop loop;
  loop.lead({kBoneRadius_mm + 2, 0, 0}, {kBoneRadius_mm - 1, 0, 0}, 100);
  ASSERT_GT(loop.wrench.force_N.x(), 1);
  // new bone encloses the tip
  const GridGeometry& grid = loop.model.labels->geometry();
  const SignedField grown = testing::sampled_distance(
      grid, [](const Eigen::Vector3d& p) { return p.norm() - kBoneRadius_mm - 3; }, 4);
  loop.model.surfaces[0].surface = std::make_shared<const Surface>(grown, grown, testing::steepest_of(grown));
  ++loop.model.version;
  for (int n = 0; n < 200; ++n) loop.at({kBoneRadius_mm - 1, 0, 0});
  EXPECT_TRUE(loop.record.device[0].flags & kFlagInside);
  EXPECT_EQ(loop.wrench.force_N, Vector<World>());
  EXPECT_EQ(loop.record.device[0].proxy_patient_mm, loop.record.device[0].tip_patient_mm);
}

// the same shape, prepared again
std::shared_ptr<const Surface> anew(const Surface& surface) {
  return std::make_shared<const Surface>(surface.position(), surface.normal(), surface.max_gradient());
}

ContactSurface ball_beside(const Model& model, const Eigen::Vector3d& centre, double radius_mm) {
  const SignedField field = testing::sampled_distance(
      model.labels->geometry(), [&](const Eigen::Vector3d& p) { return (p - centre).norm() - radius_mm; }, 4);
  ContactSurface surface = model.surfaces[0];
  surface.surface = std::make_shared<const Surface>(field, field, testing::steepest_of(field));
  return surface;
}

// inserts a surface before those of bone and shell
void become_touchable(const ContactSurface& surface, Model& model) {
  model.surfaces.insert(model.surfaces.begin(), surface);
  model.label_of_surface.insert(model.label_of_surface.begin(), testing::kFat);
}

// edits of the model that do not affect the contact
struct Edit {
  const char* name;
  std::function<void(Model&)> make;
  double bone_N_per_mm = 1.5;
  bool makes_soft = false;  // the shell in contact becomes puncturable
};

const Edit kEdits[] = {
    {"nothing", [](Model&) {}},
    {"the shell's stiffness", [](Model& model) { model.surfaces[1].stiffness_N_per_mm = 0.3; }},
    {"the bone's stiffness", [](Model& model) { model.surfaces[0].stiffness_N_per_mm = 0.9; }, 0.9},
    {"friction", [](Model& model) { model.surfaces[0].static_friction = 3; }},
    {"a shell that is never gone through",
     [](Model& model) { model.surfaces[1].puncture_N = std::numeric_limits<double>::infinity(); }},
    {"a shell that is gone through more easily", [](Model& model) { model.surfaces[1].puncture_N = 0.01; },
     1.5, true},
    {"surfaces prepared anew",
     [](Model& model) {
       for (ContactSurface& surface : model.surfaces) surface.surface = anew(*surface.surface);
     }},
    {"another order",
     [](Model& model) {
       std::swap(model.surfaces[0], model.surfaces[1]);
       std::swap(model.label_of_surface[0], model.label_of_surface[1]);
     }},
    {"something else begins to be felt",
     [](Model& model) {
       become_touchable(ball_beside(model, {-25, 0, 0}, 2), model);
     }},
    {"the shell is another one, far away",
     [](Model& model) {
       const SignedField field = testing::sampled_distance(
           model.labels->geometry(),
           [](const Eigen::Vector3d& p) {
             return std::min(p.norm() - kBoneRadius_mm - 3, (p - Eigen::Vector3d(-20, 0, 0)).norm() - 4);
           },
           4);
       model.surfaces[1].surface = std::make_shared<const Surface>(field, field, testing::steepest_of(field));
     }},
};

// bone with a 3 mm shell that is punctured at 0.5 N
ProxyLoop wrapped_bone() {
  ProxyLoop loop(3);
  loop.model.surfaces[1].surface = ball_beside(loop.model, {0, 0, 0}, kBoneRadius_mm + 3).surface;
  loop.model.surfaces[1].puncture_N = 0.5;
  loop.parameters.viscosity = false;
  return loop;
}

// through the shell and one millimetre into the bone
ProxyLoop through_the_shell() {
  static const ProxyLoop pressed = [] {
    ProxyLoop loop = wrapped_bone();
    loop.lead({kBoneRadius_mm + 6, 0, 0}, {kBoneRadius_mm - 1, 0, 0}, 200);
    for (int n = 0; n < 100; ++n) loop.at({kBoneRadius_mm - 1, 0, 0});
    return loop;
  }();
  return pressed;
}

TEST(Tick, LocalEditKeepsContactAndPunctures) {
  for (const Edit& edit : kEdits) {
    SCOPED_TRACE(edit.name);
    ProxyLoop loop = through_the_shell();
    ASSERT_NEAR(loop.wrench.force_N.x(), 1.5, 0.03);
    const auto proxy = loop.record.device[0].proxy_patient_mm;
    edit.make(loop.model);
    ++loop.model.version;
    for (int n = 0; n < 300; ++n) {
      loop.at({kBoneRadius_mm - 1, 0, 0});
      ASSERT_FALSE(loop.record.device[0].flags & (kFlagInside | kFlagRuptured | kFlagWedged)) << n;
      ASSERT_GT(loop.wrench.force_N.x(), 0.8) << n;
    }
    EXPECT_NEAR(loop.wrench.force_N.x(), edit.bone_N_per_mm, 0.03);
    for (int axis = 0; axis < 3; ++axis)
      EXPECT_NEAR(loop.record.device[0].proxy_patient_mm[static_cast<std::size_t>(axis)],
                  proxy[static_cast<std::size_t>(axis)], 1e-3);
    // on the way out it behaves as before: the shell closes behind the tip
    loop.lead({kBoneRadius_mm - 1, 0, 0}, {kBoneRadius_mm + 6, 0, 0}, 200);
    EXPECT_EQ(loop.state.device[0].proxy.punctured.count(), 0u);
  }
}

TEST(Tick, LocalEditKeepsAProxySticking) {
  const ProxyLoop untouched(3);
  for (const Edit& edit : kEdits) {
    if (edit.makes_soft) continue;
    SCOPED_TRACE(edit.name);
    ProxyLoop loop = untouched;
    loop.parameters.viscosity = false;
    for (ContactSurface& surface : loop.model.surfaces) {
      surface.static_friction = 2;
      surface.friction = 0.1;
    }
    const Point<World> tip(kBoneRadius_mm + 2, 0.8, 0);
    loop.lead({kBoneRadius_mm + 5, 0, 0}, {kBoneRadius_mm + 2, 0, 0}, 100);
    loop.lead({kBoneRadius_mm + 2, 0, 0}, tip, 100);
    ASSERT_TRUE(loop.state.device[0].proxy.sticking);
    const Point<Patient> stuck = loop.state.device[0].proxy.position;
    edit.make(loop.model);
    ++loop.model.version;
    for (int n = 0; n < 300; ++n) loop.at(tip);
    EXPECT_TRUE(loop.state.device[0].proxy.sticking);
    EXPECT_LT((loop.state.device[0].proxy.position - stuck).norm(), 1e-3);
  }
}

TEST(Tick, EditKeepsTheContactOfEveryDevice) {
  // the first device has punctured the shell, the second is in contact with it, the third is far from
  // everything
  ProxyLoop loop = wrapped_bone();
  std::array<DeviceState, 3> devices;
  std::array<Wrench, 3> wrenches;
  for (std::size_t d = 1; d < 3; ++d) {
    loop.parameters.device[d] = loop.parameters.device[0];
    loop.state.device[d].output.gain = 1;
  }
  const auto tick_at = [&](double part) {
    devices[0].tip = Point<World>(kBoneRadius_mm + 6 - 7 * part, 0, 0);
    devices[1].tip = Point<World>(0, kBoneRadius_mm + 6 - 3.5 * part, 0);
    devices[2].tip = Point<World>(0, 0, kBoneRadius_mm + 6);
    tick(loop.model, loop.parameters, devices, kMillisecond_s, loop.state, wrenches, loop.record);
  };
  for (int n = 1; n <= 300; ++n) tick_at(std::min(1.0, n / 200.0));
  for (const Edit& edit : kEdits) {
    if (edit.makes_soft) continue;
    SCOPED_TRACE(edit.name);
    Model edited = loop.model;
    edit.make(edited);
    edited.version = loop.model.version + 1;
    std::swap(loop.model, edited);
    for (int n = 0; n < 200; ++n) tick_at(1);
    // reverting is an edit too
    edited.version = loop.model.version + 1;
    std::swap(loop.model, edited);
    for (int n = 0; n < 200; ++n) tick_at(1);
    for (std::size_t d = 0; d < 3; ++d) EXPECT_FALSE(loop.record.device[d].flags & kFlagInside) << d;
    EXPECT_NEAR(wrenches[0].force_N.x(), 1.5, 0.03);
    EXPECT_EQ(wrenches[2].force_N, Vector<World>());
    EXPECT_NEAR(wrenches[1].force_N.y(), 0.5 * 0.75, 0.03);
  }
}

TEST(Tick, UntouchableTissueReleasesTheProxyAndKeepsOtherPunctures) {
  ProxyLoop loop = through_the_shell();
  const Point<World> tip(kBoneRadius_mm - 1, 0, 0);
  // the shell's surface takes the bone's index
  loop.model.surfaces.erase(loop.model.surfaces.begin());
  loop.model.label_of_surface.erase(loop.model.label_of_surface.begin());
  loop.model.tissues[0].touchable = false;
  ++loop.model.version;
  for (int n = 0; n < 300; ++n) {
    loop.at(tip);
    ASSERT_FALSE(loop.record.device[0].flags & kFlagInside) << n;
  }
  EXPECT_EQ(loop.wrench.force_N, Vector<World>()) << "no surface between tip and proxy";
  EXPECT_TRUE(loop.state.device[0].proxy.punctured[0]) << "the tip is still inside the shell";
  EXPECT_FALSE(loop.state.device[0].proxy.punctured[1]);
}

TEST(Tick, PermanentHolePersistsWhenItsSurfaceIndexChanges) {
  ProxyLoop loop = wrapped_bone();
  loop.model.surfaces[1].stays_open = true;
  const std::uint64_t without = loop.state.hash(1);
  const Point<World> outside(kBoneRadius_mm + 6, 0, 0), within(kBoneRadius_mm + 1, 0, 0);
  loop.lead(outside, within, 200);
  ASSERT_EQ(loop.state.holes.all().size(), 1u);
  EXPECT_EQ(loop.state.holes.all()[0].structure, 1);
  EXPECT_NE(loop.state.hash(1), without);
  loop.lead(within, outside, 200);
  // the shell's surface takes the bone's index
  loop.model.surfaces.erase(loop.model.surfaces.begin());
  loop.model.label_of_surface.erase(loop.model.label_of_surface.begin());
  loop.model.tissues[0].touchable = false;
  ++loop.model.version;
  loop.at(outside);
  ASSERT_EQ(loop.state.holes.all().size(), 1u);
  EXPECT_EQ(loop.state.holes.all()[0].structure, 0);
  double max_N = 0;
  for (int n = 0; n < 200; ++n) {
    loop.at(outside + (within - outside) * (n / 200.0));
    ASSERT_FALSE(loop.record.device[0].flags & kFlagRuptured) << n;
    max_N = std::max(max_N, loop.wrench.force_N.norm());
  }
  EXPECT_LT(max_N, 0.1);
  // elsewhere the shell still resists
  loop.lead(within, outside, 200);
  loop.lead(outside, {0, kBoneRadius_mm + 6, 0}, 400);
  loop.lead({0, kBoneRadius_mm + 6, 0}, {0, kBoneRadius_mm + 2.7, 0}, 200);
  EXPECT_GT(loop.wrench.force_N.y(), 0.15);
  EXPECT_TRUE(loop.state.device[0].proxy.punctured.none());
}

TEST(Tick, NewTouchableTissueAroundTheProxyUncouplesIt) {
  ProxyLoop loop = through_the_shell();
  become_touchable(ball_beside(loop.model, {kBoneRadius_mm, 0, 0}, 2), loop.model);
  ++loop.model.version;
  for (int n = 0; n < 300; ++n) loop.at({kBoneRadius_mm - 1, 0, 0});
  EXPECT_TRUE(loop.record.device[0].flags & kFlagInside);
  EXPECT_EQ(loop.wrench.force_N, Vector<World>());
}

TEST(Tick, LoweredPunctureForceAppliesFromTheNextTick) {
  ProxyLoop loop(3);
  loop.lead({kBoneRadius_mm + 6, 0, 0}, {kBoneRadius_mm + 2, 0, 0}, 200);
  ASSERT_NEAR(loop.wrench.force_N.x(), 0.75, 0.05);
  loop.model.surfaces[1].puncture_N = 0.5;
  ++loop.model.version;
  loop.at({kBoneRadius_mm + 2, 0, 0});
  EXPECT_TRUE(loop.record.device[0].flags & kFlagRuptured);
}

// a replay prepares the scene again
TEST(Tick, RebuiltEqualSurfacesCountAsUnchanged) {
  ProxyLoop once = wrapped_bone(), again = once;
  for (ContactSurface& surface : again.model.surfaces) surface.surface = anew(*surface.surface);
  int edits = 0;
  for (int n = 0; n < 400; ++n) {
    const Point<World> tip(kBoneRadius_mm + 6 - 0.035 * std::min(n, 200), 0.002 * n, 0);
    for (ProxyLoop* loop : {&once, &again}) {
      if (n % 40 == 20) {
        loop->model.surfaces[1].stiffness_N_per_mm = 0.75 - 0.001 * n;
        ++loop->model.version;
      }
      loop->at(tip);
    }
    edits += n % 40 == 20;
    ASSERT_EQ(once.record.state_hash, again.record.state_hash) << n;
  }
  EXPECT_EQ(edits, 10);
  EXPECT_TRUE(once.state.device[0].proxy.punctured[1]);
}

TEST(Tick, ChangeFromDirectMethodInContactInitialisesTheProxyAtTheNearestSurface) {
  ProxyLoop loop;
  loop.parameters.friction = loop.parameters.viscosity = false;
  loop.parameters.method = ForceMethod::kTrilinear;
  const Point<World> tip(kBoneRadius_mm - 1, 0, 0);
  loop.lead({kBoneRadius_mm + 3, 0, 0}, tip, 100);
  loop.parameters.method = ForceMethod::kProxy;
  double previous_N = loop.wrench.force_N.norm(), largest_step_N = 0;
  for (int n = 0; n < 300; ++n) {
    loop.at(tip);
    EXPECT_FALSE(loop.record.device[0].flags & kFlagInside);
    largest_step_N = std::max(largest_step_N, std::abs(loop.wrench.force_N.norm() - previous_N));
    previous_N = loop.wrench.force_N.norm();
  }
  EXPECT_NEAR(loop.wrench.force_N.x(), 1.5, 0.03);
  EXPECT_LT(largest_step_N, 0.05);
}

TEST(Tick, NoProxyIsInitialisedWhereTheDirectMethodExertsNoForce) {
  ProxyLoop loop;
  loop.parameters.viscosity = false;
  loop.parameters.method = ForceMethod::kTrilinear;
  for (int n = 0; n < 200; ++n) loop.at({1, 0, 0});
  ASSERT_EQ(loop.wrench.force_N, Vector<World>());
  loop.parameters.method = ForceMethod::kProxy;
  for (int n = 0; n < 200; ++n) loop.at({1, 0, 0});
  EXPECT_TRUE(loop.record.device[0].flags & kFlagInside);
  EXPECT_EQ(loop.wrench.force_N, Vector<World>());
}

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

TEST(Tick, UnpreparedMethodIsFlaggedAndFallsBackToTrilinear) {
  TickedLoop with, without;
  without.parameters.method = ForceMethod::kSmoothSphere;
  const Point<World> tip(kBoneRadius_mm, 0, 0);
  with.at(tip);
  without.at(tip);
  EXPECT_EQ(with.record.device[0].flags & kFlagMethodMissing, 0u);
  EXPECT_NE(without.record.device[0].flags & kFlagMethodMissing, 0u);
  EXPECT_EQ(without.wrench.force_N, with.wrench.force_N);
  EXPECT_EQ(without.record.method, static_cast<std::uint8_t>(ForceMethod::kSmoothSphere)) << "the input";
  // the force source does not change, so nothing blends
  without.parameters.method = ForceMethod::kTrilinear;
  without.at(tip);
  EXPECT_EQ(without.record.device[0].flags & (kFlagMethodMissing | kFlagBlend), 0u);
}

TEST(Tick, OutsideTheVolumeIsFreeSpaceAndFlagged) {
  TickedLoop loop;
  for (const Point<World>& tip :
       {Point<World>(35, 0, 0), Point<World>(0, -1e9, 0), Point<World>(0, 0, 1e300)}) {
    loop.set_down_at(tip);
    EXPECT_EQ(loop.wrench.force_N, Vector<World>());
    EXPECT_TRUE(loop.record.device[0].flags & kFlagOutside);
  }
}

TEST(Tick, ViscosityActsDeepInsideWhereTheNormalVanishes) {
  TickedLoop loop;
  for (int n = 0; n < 30; ++n) loop.at(Point<World>(0.02 * n, 0, 0));
  EXPECT_EQ(loop.record.device[0].normal_patient, (std::array<double, 3>{}));
  // bone's viscosity at 20 mm/s
  EXPECT_NEAR(loop.wrench.force_N.x(), -20 * loop.model.tissues[0].viscosity_N_s_per_mm, 1e-6);
}

TEST(Tick, SeveralPointsGiveATorqueAboutTheTip) {
  TickedLoop loop;
  loop.parameters.friction = loop.parameters.viscosity = false;
  loop.model.tools[0].points_mm = {{0, 0, 0}, {10, 0, 0}};
  DeviceState device;
  // the second point, rotated towards +y, touches the top of the ball; the tip is in free space
  device.tip = Point<World>(0, kBoneRadius_mm + 10, 0);
  device.R_WorldTool = Eigen::AngleAxisd(-M_PI / 2, Eigen::Vector3d::UnitZ());
  loop.at(device);
  EXPECT_GT(loop.wrench.force_N.y(), 0.5);
  const Vector<World> arm(0, -10, 0);
  EXPECT_LT((loop.wrench.torque_Nmm - arm.cross(loop.wrench.force_N)).norm(), 1e-9);
}

TEST(Tick, DevicesDoNotDisturbEachOther) {
  TickedLoop alone;
  TickedLoop both;
  std::array<DeviceState, 2> devices;
  std::array<Wrench, 2> wrenches;
  both.state.device[1].output.gain = 1;
  both.parameters.device[1] = alone.parameters.device[0];
  for (int n = 0; n < 50; ++n) {
    const Point<World> tip(kBoneRadius_mm, 0.05 * n, 0);
    alone.at(tip);
    devices[0].tip = Point<World>(-kBoneRadius_mm, 0, 0.1 * n);
    devices[1].tip = tip;
    tick(both.model, both.parameters, devices, kMillisecond_s, both.state, wrenches, both.record);
    EXPECT_EQ(wrenches[1].force_N, alone.wrench.force_N);
  }
}

TEST(Tick, StateHashIsRepeatableAndCoversEveryInput) {
  const auto run = [](double nudge, bool friction) {
    TickedLoop loop;
    loop.parameters.friction = friction;
    for (int n = 0; n < 40; ++n) loop.at(Point<World>(kBoneRadius_mm, 0.1 * n + (n == 20 ? nudge : 0), 0));
    return loop.record.state_hash;
  };
  EXPECT_EQ(run(0, true), run(0, true));
  EXPECT_NE(run(0, true), run(0, false));
  TickedLoop a, b;
  a.at(Point<World>(1, 2, 3));
  b.at(Point<World>(1, 2, std::nextafter(3.0, 4.0)));
  EXPECT_NE(a.record.state_hash, b.record.state_hash);
}

TEST(Tick, RecordContainsEveryInput) {
  TickedLoop loop;
  loop.parameters.viscosity = false;
  loop.parameters.passivity = true;
  loop.parameters.max_force_N = 1.25;
  loop.parameters.rotation_target = Rotation<World, World>::about(Eigen::Vector3d::UnitX(), 0.3).quaternion();
  loop.model.version = 9;
  DeviceParameters& own = loop.parameters.device[0];
  own = {1.5, 0.75, {8, 1.4, 300, 5, 900}, 2.5, 0.03, 0.02, 0.004};
  DeviceState device;
  device.tip = Point<World>(1, 2, 3);
  device.R_WorldTool = Rotation<World, World>::about(Eigen::Vector3d::UnitY(), 0.1).quaternion();
  device.velocity_mm_s = Vector<World>(4, 5, 6);
  device.angular_velocity_rad_s = Vector<World>(7, 8, 9);
  device.gripper_rad = 0.25;
  device.buttons = 5;
  device.status = kDeviceClutched;
  device.age_s = 1e-3;
  tick(loop.model, loop.parameters, {&device, 1}, 2e-3, loop.state, {&loop.wrench, 1}, loop.record);
  const DeviceTick& in = loop.record.device[0];
  EXPECT_EQ(in.velocity_world_mm_s, (std::array<double, 3>{4, 5, 6}));
  EXPECT_EQ(in.angular_velocity_world_rad_s, (std::array<double, 3>{7, 8, 9}));
  EXPECT_EQ(in.gripper_rad, 0.25);
  EXPECT_EQ(in.status, kDeviceClutched);
  EXPECT_EQ(in.age_s, 1e-3);
  EXPECT_EQ(in.force_gain, 1.5);
  EXPECT_EQ(in.scale, 0.75);
  EXPECT_EQ(in.peak_force_N, 8);
  EXPECT_EQ(in.continuous_force_N, 1.4);
  EXPECT_EQ(in.peak_torque_Nmm, 300);
  EXPECT_EQ(in.peak_gripper_N, 5);
  EXPECT_EQ(in.slew_N_per_s, 900);
  EXPECT_EQ(in.max_stiffness_N_per_mm, 2.5);
  EXPECT_EQ(in.position_step_mm, 0.03);
  EXPECT_EQ(in.max_damping_N_s_per_mm, 0.02);
  EXPECT_EQ(in.delay_s, 0.004);
  EXPECT_EQ(loop.record.device[0].tip_world_mm, (std::array<double, 3>{1, 2, 3}));
  EXPECT_EQ(loop.record.device[0].orientation_wxyz[0], device.R_WorldTool.w());
  EXPECT_EQ(loop.record.device[0].buttons, 5u);
  EXPECT_EQ(loop.record.switches, kSwitchFriction | kSwitchPassivity);
  EXPECT_EQ(loop.record.max_force_N, 1.25);
  EXPECT_EQ(loop.record.dt_s, 2e-3);
  EXPECT_EQ(loop.record.model_version, 9u);
  EXPECT_EQ(loop.record.rotation_target_wxyz[1], loop.parameters.rotation_target.x());
}

TEST(Tick, InvalidDurationSendsZeroAndKeepsTheState) {
  TickedLoop loop;
  // in contact, during a blend, with energy in the observer
  loop.parameters.passivity = true;
  loop.set_down_at(Point<World>(kBoneRadius_mm + 1, 0, 0));
  for (int n = 0; n < 20; ++n) loop.at(Point<World>(kBoneRadius_mm - 0.05 * n, 0, 0));
  loop.parameters.friction = false;
  loop.at(Point<World>(kBoneRadius_mm - 1, 0, 0));
  ASSERT_GT(loop.wrench.force_N.norm(), 0);
  const std::uint64_t before = loop.state.hash(1);

  DeviceState device;
  device.tip = Point<World>(kBoneRadius_mm - 1, 0, 0);
  for (const double dt_s : {-1.0, -1e-300, HUGE_VAL, -HUGE_VAL, std::nan("")}) {
    loop.wrench.force_N = {7, 7, 7};
    loop.record.device[0].label = 99;
    tick(loop.model, loop.parameters, {&device, 1}, dt_s, loop.state, {&loop.wrench, 1}, loop.record);
    EXPECT_EQ(loop.wrench.force_N, Vector<World>()) << dt_s;
    EXPECT_EQ(loop.state.hash(1), before) << dt_s;
    EXPECT_EQ(loop.record.state_hash, before) << dt_s;
    EXPECT_EQ(loop.record.device[0].flags, kFlagNotFinite) << dt_s;
    EXPECT_EQ(loop.record.device[0].label, 0) << dt_s;
    EXPECT_EQ(loop.record.tick, loop.state.tick) << dt_s;
  }
  loop.at(device);
  EXPECT_GT(loop.wrench.force_N.norm(), 0);
}

TEST(Tick, InvalidDeviceCountWrenchesOrModelSendZero) {
  TickedLoop loop;
  const std::uint64_t before = loop.state.hash(1);
  std::array<DeviceState, kMaxDevices + 1> devices;
  std::array<Wrench, kMaxDevices + 1> wrenches;
  const auto refused = [&](const Model& model, std::size_t states, std::size_t outputs) {
    wrenches.fill({{7, 7, 7}, {7, 7, 7}, 7});
    tick(model, loop.parameters, {devices.data(), states}, kMillisecond_s, loop.state,
         {wrenches.data(), outputs}, loop.record);
    for (std::size_t n = 0; n < outputs; ++n) EXPECT_EQ(wrenches[n].force_N, Vector<World>());
    EXPECT_EQ(loop.state.hash(1), before);
  };
  refused(loop.model, 0, 0);
  refused(loop.model, 0, 1);
  refused(loop.model, 2, 1);
  refused(loop.model, kMaxDevices + 1, kMaxDevices + 1);
  refused(Model(), 1, 1);
}

}  // namespace
}  // namespace palpate
