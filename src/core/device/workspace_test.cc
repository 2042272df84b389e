#include <gtest/gtest.h>

#include <cmath>
#include <iostream>
#include <limits>
#include <random>

#include "palpate/device/device_parameters.h"
#include "palpate/device/rendered_stiffness.h"
#include "palpate/device/simulated_device.h"
#include "palpate/device/workspace.h"

namespace palpate {
namespace {

constexpr unsigned kSeed = 20261120;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

class Dice {
 public:
  double between(double low, double high) { return std::uniform_real_distribution(low, high)(engine_); }
  Eigen::Vector3d vector(double size) {
    return {between(-size, size), between(-size, size), between(-size, size)};
  }
  Eigen::Quaterniond rotation() {
    return Eigen::Quaterniond(Eigen::Vector4d(between(-1, 1), between(-1, 1), between(-1, 1), between(-1, 1)))
        .normalized();
  }
  // log-uniform: a half is as likely as two
  double factor() { return std::exp(between(std::log(kMinScale), std::log(kMaxScale))); }

  WorkspaceSettings settings() {
    return {factor(), factor(), between(-180, 180), Point<World>(vector(300)), -1};
  }
  DeviceInfo info() {
    DeviceInfo info;
    info.R_WorldDevice = Rotation<World, Device>(rotation());
    info.workspace = {Point<Device>(vector(100)), Point<Device>(vector(100))};
    return info;
  }

 private:
  std::mt19937 engine_{kSeed};
};

DeviceSample at(const Point<Device>& tip, std::uint32_t buttons = 0) {
  DeviceSample sample;
  sample.tip = tip;
  sample.buttons = buttons;
  return sample;
}

TEST(Workspace, RoundTripIsExact) {
  std::cout << "seed " << kSeed << "\n";
  Dice dice;
  for (int n = 0; n < 500; ++n) {
    const DeviceInfo info = dice.info();
    const WorkspaceSettings settings = dice.settings();
    WorkspaceMapping mapping(info, settings);
    const Point<Device> tip(dice.vector(200));
    const Point<World> world = mapping.to_world(at(tip), 0).tip;
    EXPECT_LT((mapping.to_device(world) - tip).norm(), 1e-9);
    // lengths grow by the scale, and the centre of the workspace lies at home
    const Point<Device> other(dice.vector(200));
    EXPECT_NEAR((mapping.to_world(at(other), 0).tip - world).norm(), settings.scale * (other - tip).norm(),
                1e-9);
    const Point<Device> centre = info.workspace->low + (info.workspace->high - info.workspace->low) * 0.5;
    EXPECT_LT((mapping.to_world(at(centre), 0).tip - *settings.home).norm(), 1e-9);
  }
}

TEST(Workspace, DefaultSettingsPlaceTheDeviceAtTheOrigin) {
  WorkspaceMapping mapping(DeviceInfo{}, WorkspaceSettings{});
  EXPECT_EQ(mapping.to_world(at(Point<Device>(1, -2, 3)), 0).tip, Point<World>(1, -2, 3));
}

TEST(Workspace, VendorAxesMapToRightForwardUp) {
  // by the meaning of each vendor's axes to the person in front of the device
  struct Maker {
    Rotation<World, Device> R_WorldDevice;
    Vector<Device> right, away, up;
  };
  const std::array<Maker, 3> vendors{
      {{openhaptics_axes(), {1, 0, 0}, {0, 0, -1}, {0, 1, 0}},      // right, up, towards the user
       {force_dimension_axes(), {0, 1, 0}, {-1, 0, 0}, {0, 0, 1}},  // towards the user, right, up
       {haply_axes(), {1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}};           // right, forward, up
  const auto near = [](const Vector<World>& a, const Vector<World>& b) { return (a - b).norm() < 1e-15; };
  for (const Maker& vendor : vendors) {
    DeviceInfo info;
    info.R_WorldDevice = vendor.R_WorldDevice;
    WorkspaceMapping mapping(info, {});
    const auto guided = [&](const Vector<Device>& v) {
      return mapping.to_world(at(Point<Device>() + v), 0).tip - Point<World>();
    };
    EXPECT_TRUE(near(guided(vendor.right), {1, 0, 0}));
    EXPECT_TRUE(near(guided(vendor.away), {0, 1, 0}));
    EXPECT_TRUE(near(guided(vendor.up), {0, 0, 1}));
    // an upward force pushes the hand up
    EXPECT_LT((mapping.to_device(Wrench{Vector<World>(0, 0, 2), {}}).force_N - vendor.up * 2).norm(), 1e-14);
  }
  // as documented in device.h
  const Vector<Device> v(1, 2, 3);
  EXPECT_TRUE(near(openhaptics_axes() * v, {1, -3, 2}));
  EXPECT_TRUE(near(force_dimension_axes() * v, {2, -1, 3}));
}

TEST(Workspace, YawRotatesTheDeviceAboutUp) {
  WorkspaceSettings settings;
  settings.yaw_deg = 90;
  WorkspaceMapping mapping(DeviceInfo{}, settings);
  // anticlockwise from above: the device's right becomes forward
  const Point<World> tip = mapping.to_world(at(Point<Device>(5, 0, 2)), 0).tip;
  EXPECT_LT((tip - Point<World>(0, 5, 2)).norm(), 1e-14);
}

TEST(Workspace, DeviceWorkIsPatientWorkTimesGainOverScale) {
  // the tool as a rigid body: force and torque do work on velocity and rotation, both scaled by the same
  // factor, and unchanged where gain and scale are equal
  Dice dice;
  for (int n = 0; n < 500; ++n) {
    WorkspaceSettings settings = dice.settings();
    if (n % 5 == 0) settings.force_gain = settings.scale;
    WorkspaceMapping mapping(dice.info(), settings);
    DeviceSample sample = at(Point<Device>(dice.vector(50)));
    sample.velocity_mm_s = Vector<Device>(dice.vector(300));
    sample.angular_velocity_rad_s = Vector<Device>(dice.vector(5));
    const DeviceState state = mapping.to_world(sample, 0);
    const Vector<World> force_N(dice.vector(5)), torque_Nmm(dice.vector(100));

    const double g = settings.force_gain, s = settings.scale;
    const DeviceCommand command = mapping.to_device(Wrench{force_N * g, torque_Nmm * (g / s)});
    const double patient = force_N.dot(state.velocity_mm_s) + torque_Nmm.dot(state.angular_velocity_rad_s);
    const double device =
        command.force_N.dot(sample.velocity_mm_s) + command.torque_Nmm.dot(sample.angular_velocity_rad_s);
    EXPECT_NEAR(device, g / s * patient, 1e-9 * (1 + std::abs(device)));
    if (n % 5 == 0) {
      EXPECT_NEAR(device, patient, 1e-9 * (1 + std::abs(device)));
    }
  }
}

TEST(Workspace, VelocityEqualsTheTipDisplacementRate) {
  Dice dice;
  WorkspaceMapping mapping(dice.info(), dice.settings());
  DeviceSample sample = at(Point<Device>(dice.vector(50)));
  sample.velocity_mm_s = Vector<Device>(dice.vector(300));
  const DeviceState state = mapping.to_world(sample, 0);
  constexpr double kStep_s = 1e-3;
  const Point<World> next = mapping.to_world(at(sample.tip + sample.velocity_mm_s * kStep_s), 0).tip;
  EXPECT_LT(((next - state.tip) / kStep_s - state.velocity_mm_s).norm(), 1e-6);
}

TEST(Workspace, ToolRotatesWithTheDevice) {
  // an axis of the tool in World is the axis in the device's frame, transformed to World
  Dice dice;
  for (int n = 0; n < 50; ++n) {
    const DeviceInfo info = dice.info();
    const WorkspaceSettings settings = dice.settings();
    WorkspaceMapping mapping(info, settings);
    DeviceSample sample = at(Point<Device>());
    sample.R_DeviceTool = dice.rotation();
    const Eigen::Vector3d axis = dice.vector(1);
    const Point<World> from = mapping.to_world(sample, 0).tip;
    const Point<World> to = mapping.to_world(at(Point<Device>(sample.R_DeviceTool * axis)), 0).tip;
    EXPECT_LT((mapping.to_world(sample, 0).R_WorldTool * axis - (to - from).eigen() / settings.scale).norm(),
              1e-9);
  }
}

// A hand presses slowly against a linear wall of K N/mm in World; the slope of its force over the device's
// displacement is the rendered stiffness.
double measured_stiffness_N_per_mm(const PlantDevice& device, const PlantHand& hand, const DeviceInfo& axes,
                                   const WorkspaceSettings& settings, double wall_N_per_mm) {
  const Vector<World> outward = Vector<World>(1, 2, -2) / 3;
  const Point<World> surface = *settings.home + outward * 4;
  DeviceInfo info = axes;
  info.workspace = SimulatedDevice(device, hand).info().workspace;
  WorkspaceMapping mapping(info, settings);
  const Point<Device> start = mapping.to_device(surface);
  const Vector<Device> inward = (mapping.to_device(surface - outward) - start).normalized();

  SimulatedDevice plant(device, hand);
  plant.reset(start);
  constexpr double kStep_s = 1e-3, kSpeed_mm_s = 4;
  constexpr int kSettled = 500, kEnd = 2000;
  double n = 0, sx = 0, sy = 0, sxx = 0, sxy = 0;
  DeviceCommand command;
  for (int i = 1; i <= kEnd; ++i) {
    plant.intend(start + inward * (kSpeed_mm_s * kStep_s * i));
    plant.advance(command, kStep_s);
    const Point<World> tip = mapping.to_world(plant.read(), 0).tip;
    const double depth_mm = std::max(0.0, (surface - tip).dot(outward));
    command = mapping.to_device(Wrench{outward * (wall_N_per_mm * depth_mm * settings.force_gain), {}});
    if (i <= kSettled) continue;
    // the force is the stretch of the hand's spring; the slope of the regression line is independent of
    // friction, which is constant on the way in
    const double distance_mm = (plant.true_tip() - start).dot(inward);
    const double force_N = hand.stiffness_N_per_m * 1e-3 * (plant.intention() - plant.true_tip()).dot(inward);
    n += 1, sx += distance_mm, sy += force_N, sxx += distance_mm * distance_mm, sxy += distance_mm * force_N;
  }
  return (n * sxy - sx * sy) / (n * sxx - sx * sx);
}

TEST(Workspace, RenderedStiffnessIsScaleTimesGainTimesStiffness) {
  struct Case {
    double scale, gain, yaw_deg, wall_N_per_mm;
  };
  const PlantDevice premium = *find_plant_device("premium-1.5");
  const PlantHand hand = *find_plant_hand("firm-grip");
  DeviceInfo axes;
  axes.R_WorldDevice = openhaptics_axes();
  for (const Case& c : {Case{1, 1, 0, 0.5}, Case{2, 0.5, 30, 0.5}, Case{0.25, 3, -90, 0.8},
                        Case{4, 0.05, 170, 1.5}, Case{0.2, 1, 45, 1.5}, Case{0.5, 4, 10, 0.3}}) {
    const WorkspaceSettings settings{c.scale, c.gain, c.yaw_deg, Point<World>(20, -10, 5), -1};
    const double expected = c.scale * c.gain * c.wall_N_per_mm;
    EXPECT_NEAR(RenderedStiffness(settings).at_device(c.wall_N_per_mm), expected, 1e-12);
    const double measured = measured_stiffness_N_per_mm(premium, hand, axes, settings, c.wall_N_per_mm);
    EXPECT_NEAR(measured, expected, 0.01 * expected) << "scale " << c.scale << " gain " << c.gain;
  }
}

// ---- clutch ----

class Clutch : public ::testing::Test {
 protected:
  static constexpr std::uint32_t kHeld = 1u << 3;
  static WorkspaceSettings settings() { return {1.7, 1, 33, Point<World>(5, 6, 7), 3}; }
  DeviceState guided(const Point<Device>& tip, std::uint32_t buttons) {
    return mapping_.to_world(at(tip, buttons), 0);
  }
  WorkspaceMapping mapping_{DeviceInfo{}, settings()};
};

TEST_F(Clutch, KeepsTheTipBitIdenticalAndResumesWithoutAJump) {
  Dice dice;
  Point<Device> hand(dice.vector(40));
  Point<World> before = guided(hand, 0).tip;
  for (int n = 0; n < 2000; ++n) {
    // pressed for seven samples out of twenty-one; other buttons have no effect
    const bool is_pressed = n / 7 % 3 == 1, was_pressed = is_pressed && n % 7 > 0;
    const Vector<Device> step(dice.vector(2));
    hand += step;
    const DeviceState state = guided(hand, is_pressed ? kHeld | 1u : 1u);
    EXPECT_EQ(state.status, is_pressed ? kDeviceClutched : 0u);
    EXPECT_EQ(state.buttons, is_pressed ? kHeld | 1u : 1u);
    // a step of the hand moves the tip by its length times the scale, or not at all
    if (was_pressed) {
      EXPECT_EQ(state.tip, before) << n;
    } else {
      EXPECT_NEAR((state.tip - before).norm(), settings().scale * step.norm(), 1e-9) << n;
    }
    before = state.tip;
  }
}

TEST_F(Clutch, IgnoresNonFiniteTips) {
  const Point<World> start = guided(Point<Device>(1, 2, 3), 0).tip;
  const Point<Device> lost(kNan, 0, 0);
  // pressed on a lost sample, or lost while held: passed on unchanged and not stored
  EXPECT_FALSE(guided(lost, kHeld).tip.all_finite());
  EXPECT_EQ(guided(lost, kHeld).status, kDeviceClutched);
  EXPECT_LT((guided(Point<Device>(1, 2, 3), kHeld).tip - start).norm(), 1e-12);
  EXPECT_LT((guided(Point<Device>(9, 9, 9), kHeld).tip - start).norm(), 1e-12);
  EXPECT_FALSE(guided(Point<Device>(0, std::numeric_limits<double>::infinity(), 0), kHeld).tip.all_finite());
  EXPECT_LT((guided(Point<Device>(-4, 9, 9), kHeld).tip - start).norm(), 1e-12);
  // released on a lost sample
  EXPECT_FALSE(guided(lost, 0).tip.all_finite());
  EXPECT_LT((guided(Point<Device>(-4, 9, 9), 0).tip - start).norm(), 1e-12);
}

TEST_F(Clutch, InverseMappingIncludesTheClutchOffset) {
  // a simulated hand gets the correct position behind a clutch too
  guided(Point<Device>(1, 2, 3), 0);
  guided(Point<Device>(1, 2, 3), kHeld);
  guided(Point<Device>(-30, 8, 1), kHeld);
  const Point<World> tip = guided(Point<Device>(-30, 8, 1), 0).tip;
  EXPECT_LT((mapping_.to_device(tip) - Point<Device>(-30, 8, 1)).norm(), 1e-12);
}

TEST(Workspace, InvalidClutchButtonIsIgnored) {
  for (const int button : {-1, -7, 32, 33, 1000, std::numeric_limits<int>::min()}) {
    WorkspaceSettings settings;
    settings.clutch_button = button;
    WorkspaceMapping mapping(DeviceInfo{}, settings);
    for (const double x : {1.0, 2.0}) {
      const DeviceState state = mapping.to_world(at(Point<Device>(x, 0, 0), 0xffffffffu), 0);
      EXPECT_EQ(state.tip, Point<World>(x, 0, 0)) << button;
      EXPECT_EQ(state.status, 0u) << button;
    }
  }
  WorkspaceSettings settings;
  settings.clutch_button = 31;
  WorkspaceMapping mapping(DeviceInfo{}, settings);
  EXPECT_EQ(mapping.to_world(at(Point<Device>(), 1u << 31), 0).status, kDeviceClutched);
}

// ---- pass-through ----

TEST(Workspace, PassesFaultButtonsGripperAndUnknownValues) {
  WorkspaceSettings settings;
  settings.clutch_button = 0;
  WorkspaceMapping mapping(DeviceInfo{}, settings);
  DeviceSample sample = at(Point<Device>(), 5);
  sample.fault = true;
  sample.gripper_rad = 0.3;
  const DeviceState state = mapping.to_world(sample, 0);
  EXPECT_EQ(state.status, kDeviceFault | kDeviceClutched);
  EXPECT_EQ(state.buttons, 5u);
  EXPECT_EQ(state.gripper_rad, 0.3);
  const DeviceState unknown = mapping.to_world(at(Point<Device>()), 0);
  EXPECT_TRUE(std::isnan(unknown.velocity_mm_s.x()));
  EXPECT_TRUE(std::isnan(unknown.angular_velocity_rad_s.z()));
  EXPECT_TRUE(std::isnan(unknown.gripper_rad));
  EXPECT_EQ(mapping.to_device(Wrench{{}, {}, 1.5}).gripper_N, 1.5);
}

TEST(Workspace, AgeIsTheTimeSinceThePoseWasSampled) {
  WorkspaceMapping mapping(DeviceInfo{}, {});
  DeviceSample sample;
  sample.taken_ns = 5'000'000'000;
  EXPECT_EQ(mapping.to_world(sample, 5'003'000'000).age_s, 3e-3);
  EXPECT_EQ(mapping.to_world(sample, 5'000'000'000).age_s, 0);
  // another clock: negative age, which the output stage treats as no state
  EXPECT_EQ(mapping.to_world(sample, 4'000'000'000).age_s, -1);
  for (const std::int64_t wild :
       {std::numeric_limits<std::int64_t>::min(), std::numeric_limits<std::int64_t>::max()}) {
    sample.taken_ns = wild;
    const double age_s = mapping.to_world(sample, 4'000'000'000).age_s;
    EXPECT_EQ(std::signbit(age_s), wild > 0);
    EXPECT_GT(std::abs(age_s), 9e9);
  }
}

TEST(Workspace, PatientFrameSampleMapsToTheObject) {
  const Transform<World, Patient> X(
      Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix(),
      Eigen::Vector3d(5, -6, 7));
  DeviceSample sample = at(Point<Device>(10, 20, 30));
  sample.R_DeviceTool = Eigen::AngleAxisd(0.4, Eigen::Vector3d::UnitX());
  sample.velocity_mm_s = {1, 0, 0};
  sample.fault = true;
  sample.taken_ns = 1'000'000;
  const DeviceState state = state_in_patient(sample, X, 3'000'000);
  EXPECT_LT((state.tip - X * Point<Patient>(10, 20, 30)).norm(), 1e-12);
  const Eigen::Matrix3d turned = X.linear() * sample.R_DeviceTool.toRotationMatrix();
  EXPECT_LT((state.R_WorldTool.toRotationMatrix() - turned).norm(), 1e-12);
  EXPECT_LT((state.velocity_mm_s - X * Vector<Patient>(1, 0, 0)).norm(), 1e-12);
  EXPECT_EQ(state.status, kDeviceFault);
  EXPECT_NEAR(state.age_s, 2e-3, 1e-12);
  // its work is not scaled, whatever the scene's settings
  DeviceInfo info;
  info.in_patient = true;
  WorkspaceSettings settings;
  settings.scale = 4;
  settings.force_gain = 0.5;
  EXPECT_EQ(device_parameters(info, settings).scale, 1);
  EXPECT_EQ(device_parameters(info, settings).force_gain, 1);
}

}  // namespace
}  // namespace palpate
