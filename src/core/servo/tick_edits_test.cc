#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>

#include "servo/test_ticked_loop.h"

namespace palpate {
namespace {

using testing::kBoneRadius_mm;
using testing::kMillisecond_s;
using testing::ProxyLoop;

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
  return std::make_shared<const Surface>(surface.distance_field(), surface.normal_field(),
                                         surface.max_gradient());
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

}  // namespace
}  // namespace palpate
