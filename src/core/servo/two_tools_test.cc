#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <memory>
#include <vector>

#include "contact/test_model.h"
#include "palpate/servo/servo.h"
#include "palpate/tissue/carving.h"

/// Tests of devices with different tools, in the complete tick.
namespace palpate {
namespace {

using testing::kBoneRadius_mm;

Tool probe_of_ball() {
  Tool probe;
  probe.radius_mm = 1.5;
  probe.capsules = {{{0, 0, 0}, {0, 0, 30}, 1}};
  return probe;
}

Tool burr_of_ball() {
  Tool burr;
  burr.radius_mm = 2;
  burr.burr = BurrSettings{.spindle = Eigen::Vector3d(1, 0, 0)};
  return burr;
}

/// Devices moved over a ball of bone by the test, and a session that carves.
struct GuidedHands {
  std::shared_ptr<const Model> model;
  std::shared_ptr<const Carving> carving;
  Parameters parameters;
  SessionState state;
  TickRecord record;
  std::vector<DeviceState> devices;
  std::vector<Wrench> wrenches;

  explicit GuidedHands(std::vector<Tool> tools) : devices(tools.size()), wrenches(tools.size()) {
    Model made = testing::with_exact_surfaces(testing::ball_model({1, 1, 1}));
    made.tools = std::move(tools);
    model = std::make_shared<const Model>(std::move(made));
    carving = std::make_shared<const Carving>(*model);
    parameters.method = ForceMethod::kProxy;
    parameters.motor = true;
    parameters.max_force_N = 10;
    for (auto& hand : state.device) hand.output.gain = 1;
  }
  // position `clear_mm` above the ball, rotated from its top to one side
  Point<World> above(double clear_mm, double turned_rad) const {
    const double r = kBoneRadius_mm + clear_mm;
    return model->X_WorldPatient * Point<Patient>(r * std::sin(turned_rad), 0, r * std::cos(turned_rad));
  }
  void tick_once() { tick(*model, parameters, devices, 1e-3, state, wrenches, record); }
  // carves as a session does; returns the number of cuts
  std::size_t carve() {
    std::vector<Cut> cuts;
    for (std::size_t d = 0; d < devices.size(); ++d)
      for (const Cut& cut : finished_cuts(state.device[d].burr, static_cast<std::uint32_t>(d)))
        cuts.push_back(cut);
    if (cuts.empty()) return 0;
    carving = carving->with(cuts);
    model = carving->applied_to(*model);
    return cuts.size();
  }
};

TEST(TwoTools, EachToolHasTheForceItHasAlone) {
  GuidedHands both({probe_of_ball(), burr_of_ball()}), probe({probe_of_ball()}), burr({burr_of_ball()});
  std::size_t cuts = 0;
  for (int n = 0; n < 600; ++n) {
    const double in_mm = std::min(3.0, 0.01 * n), along = 2e-4 * n;
    both.devices[0].tip = probe.devices[0].tip = both.above(2 - 0.5 * in_mm, 2 + along);
    both.devices[1].tip = burr.devices[0].tip = both.above(2.5 - in_mm, along);
    both.devices[0].R_WorldTool = probe.devices[0].R_WorldTool =
        Eigen::AngleAxisd(1e-3 * n, Eigen::Vector3d::UnitX());
    if (n % 20 == 0) {
      const std::size_t carved = both.carve();
      ASSERT_EQ(burr.carve(), carved);
      cuts += carved;
    }
    for (GuidedHands* guided : {&both, &probe, &burr}) guided->tick_once();
    const DeviceTick &of_probe = both.record.device[0], &of_burr = both.record.device[1];
    ASSERT_EQ(both.wrenches[0].force_N, probe.wrenches[0].force_N) << n;
    ASSERT_EQ(both.wrenches[0].torque_Nmm, probe.wrenches[0].torque_Nmm) << n;
    ASSERT_EQ(of_probe.proxy_patient_mm, probe.record.device[0].proxy_patient_mm) << n;
    ASSERT_EQ(of_probe.contact_part, probe.record.device[0].contact_part) << n;
    ASSERT_EQ(of_probe.flags, probe.record.device[0].flags) << n;
    ASSERT_EQ(both.wrenches[1].force_N, burr.wrenches[0].force_N) << n;
    ASSERT_EQ(of_burr.proxy_patient_mm, burr.record.device[0].proxy_patient_mm) << n;
    ASSERT_EQ(of_burr.flags, burr.record.device[0].flags) << n;
    ASSERT_EQ(both.state.device[1].burr.removed_mm3, burr.state.device[0].burr.removed_mm3) << n;
    ASSERT_EQ(both.state.strokes, burr.state.strokes) << n;
  }
  EXPECT_GT(cuts, 5u) << "precondition: something was cut";
  EXPECT_GT(both.wrenches[0].force_N.norm(), 0.5);
  EXPECT_GT(burr.wrenches[0].force_N.norm(), 0.1);
}

TEST(TwoTools, OnlyTheBurrRemovesMaterial) {
  for (const bool burr_is_first : {false, true}) {
    SCOPED_TRACE(burr_is_first);
    const std::size_t with_burr = burr_is_first ? 0 : 1, with_probe = 1 - with_burr;
    std::vector<Tool> tools(2, probe_of_ball());
    tools[with_burr] = burr_of_ball();
    GuidedHands guided(std::move(tools));
    // side by side, with the motor's switch on
    for (int n = 0; n < 400; ++n) {
      guided.devices[with_burr].tip = guided.above(2.2 - 0.01 * n, 0);
      guided.devices[with_probe].tip = guided.above(2.2 - 0.005 * n, 0.4);
      if (n % 20 == 0) guided.carve();
      guided.tick_once();
      ASSERT_EQ(guided.state.device[with_probe].burr.sweep_count, 0);
    }
    EXPECT_GT(guided.wrenches[with_probe].force_N.norm(), 0.3);
    EXPECT_EQ(guided.state.device[with_probe].burr.removed_mm3, 0);
    EXPECT_GT(guided.state.device[with_burr].burr.removed_mm3, 2);
    EXPECT_GT(guided.carving->sweeps(with_burr), 0u);
    EXPECT_EQ(guided.carving->sweeps(with_probe), 0u);
  }
}

TEST(TwoTools, ProbeEntersTheHoleCutByTheBurr) {
  GuidedHands guided({probe_of_ball(), burr_of_ball()});
  guided.devices[0].tip = guided.above(20, 0);
  for (int n = 0; n < 1500; ++n) {
    guided.devices[1].tip = guided.above(2.2 - std::min(3.5, 0.005 * n), 0);
    if (n % 20 == 0) guided.carve();
    guided.tick_once();
  }
  guided.devices[1].tip = guided.above(20, 0);
  guided.parameters.motor = false;
  guided.tick_once();
  guided.carve();
  // enters where there was bone, which it would have touched from 1.5 mm above
  for (int n = 0; n < 300; ++n) {
    guided.devices[0].tip = guided.above(20 - std::min(18.8, 0.1 * n), 0);
    guided.tick_once();
  }
  EXPECT_EQ(guided.wrenches[0].force_N.norm(), 0);
  GuidedHands uncut({probe_of_ball(), burr_of_ball()});
  for (int n = 0; n < 300; ++n) {
    uncut.devices[0].tip = uncut.above(20 - std::min(18.8, 0.1 * n), 0);
    uncut.devices[1].tip = uncut.above(20, 0);
    uncut.tick_once();
  }
  EXPECT_GT(uncut.wrenches[0].force_N.norm(), 0.1);
}

TEST(TwoTools, SwitchRunsEveryBurrAndAPedalItsOwn) {
  Tool other = burr_of_ball(), one = burr_of_ball();
  one.burr->pedal = 1;
  other.burr->pedal = 4;
  const auto cut_mm3 = [&](bool motor, std::uint32_t first, std::uint32_t second) {
    GuidedHands guided({one, other, probe_of_ball()});
    guided.parameters.motor = motor;
    guided.devices[0].buttons = first;
    guided.devices[1].buttons = second;
    // a probe has no pedal, whatever its device's buttons
    guided.devices[2].buttons = ~0u;
    for (int n = 0; n < 150; ++n) {
      for (std::size_t d = 0; d < 3; ++d)
        guided.devices[d].tip = guided.above(2.2 - 0.01 * n, 2.0 * static_cast<double>(d));
      guided.tick_once();
    }
    EXPECT_EQ(guided.state.strokes, motor || first == 1u << 1 || second == 1u << 4 ? 1u : 0u);
    return std::array{guided.state.device[0].burr.removed_mm3, guided.state.device[1].burr.removed_mm3};
  };
  const auto by_switch = cut_mm3(true, 0, 0);
  EXPECT_GT(by_switch[0], 0.1);
  EXPECT_GT(by_switch[1], 0.1);
  const auto by_first = cut_mm3(false, 1u << 1, 1u << 1);
  EXPECT_EQ(by_first[0], by_switch[0]);
  EXPECT_EQ(by_first[1], 0);
  const auto by_second = cut_mm3(false, 1u << 4, 1u << 4);
  EXPECT_EQ(by_second[0], 0);
  EXPECT_EQ(by_second[1], by_switch[1]);
  EXPECT_EQ(cut_mm3(false, 0, 0), (std::array{0.0, 0.0}));
}

TEST(TwoTools, StrokeLastsFromTheFirstMotorStartToTheLastStop) {
  Tool burr = burr_of_ball();
  burr.burr->pedal = 0;
  GuidedHands guided({burr, burr, probe_of_ball()});
  for (auto& device : guided.devices) device.tip = guided.above(10, 0);
  guided.parameters.motor = false;
  const auto strokes = [&](std::uint32_t first, std::uint32_t second) {
    guided.devices[0].buttons = first;
    guided.devices[1].buttons = second;
    guided.devices[2].buttons = 1;
    guided.tick_once();
    return guided.state.strokes;
  };
  EXPECT_EQ(strokes(0, 0), 0u) << "the probe's device has no motor";
  EXPECT_EQ(strokes(1, 0), 1u);
  EXPECT_EQ(strokes(1, 1), 1u);
  EXPECT_EQ(strokes(0, 1), 1u) << "one is on all the time";
  EXPECT_EQ(strokes(0, 0), 1u);
  EXPECT_EQ(strokes(0, 1), 2u);
}

TEST(TwoTools, DevicesBeyondTheToolListUseTheFirstTool) {
  Model model;
  EXPECT_FALSE(model.has_burr());
  model.tools = {burr_of_ball(), probe_of_ball()};
  EXPECT_TRUE(model.has_burr());
  EXPECT_EQ(&model.tool_of(0), &model.tools[0]);
  EXPECT_EQ(&model.tool_of(1), &model.tools[1]);
  EXPECT_EQ(&model.tool_of(2), &model.tools[0]);
  EXPECT_EQ(&model.tool_of(3), &model.tools[0]);
}

}  // namespace
}  // namespace palpate
