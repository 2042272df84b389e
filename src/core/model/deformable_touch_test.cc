#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <numbers>
#include <span>
#include <utility>
#include <vector>

#include "palpate/model/make_model.h"
#include "palpate/servo/servo.h"
#include "palpate/tissue/soft_tissue_solver.h"

/// Contact of large tools, and of two tools, with deformable tissue: the complete tick with the elastic
/// solver.
namespace palpate {
namespace {

/// Ticks of four solver frames.
constexpr int kSettled = 64;
constexpr double kVoxel_mm = 0.8, kThickness_mm = 36, kModulus_kPa = 20, kPoissonsRatio = 0.45;

// Soft tissue 64 mm wide and 36 mm thick, with the surface at z = 0, between two voxels. The solver's box
// ends within it, so that it is a half-space to the tools.
std::shared_ptr<const Model> thick_block(double radius_mm) {
  static std::shared_ptr<const Model> prepared;
  if (prepared == nullptr) {
    constexpr int kAcross = 80, kSoft = static_cast<int>(kThickness_mm / kVoxel_mm), kAir = 20;
    GridGeometry grid;
    grid.dims = {kAcross, kAcross, kSoft + kAir};
    grid.spacing_mm = {kVoxel_mm, kVoxel_mm, kVoxel_mm};
    const double middle_mm = -0.5 * (kAcross - 1) * kVoxel_mm;
    grid.origin = Point<Patient>(middle_mm, middle_mm, (0.5 - kSoft) * kVoxel_mm);
    Volume<LabelId> labels(grid);
    for (int k = 0; k < kSoft; ++k)
      for (int j = 0; j < kAcross; ++j)
        for (int i = 0; i < kAcross; ++i) labels.at(i, j, k) = 1;
    ModelParts parts;
    parts.labels = label_bricks(labels);
    parts.segments = {{1, "tissue", {}, 0, 1}};
    Tissue soft;
    soft.name = "tissue";
    soft.stiffness_N_per_mm = 0.2;
    soft.elastic = ElasticConstants{kModulus_kPa, kPoissonsRatio};
    parts.tissues = {soft};
    parts.tissue_of_label = {-1, 0};
    parts.tissue_law = TissueLaw::kElastic;
    Tool tool;
    tool.radius_mm = kMaxToolRadius_mm;
    parts.tools = {tool};
    auto made = make_model(std::move(parts));
    PALPATE_CHECK(made.ok());
    const ForceMethod proxy = ForceMethod::kProxy;
    prepared = prepared_for(*made, {&proxy, 1}).value();
  }
  auto model = std::make_shared<Model>(*prepared);
  model->tools[0].radius_mm = radius_mm;
  return model;
}

/// Spheres that are pressed into the block at 1 kHz.
class PressingTools {
 public:
  struct Sphere {
    double x_mm = 0, depth_mm = -3;  ///< Depth of its lowest point below the undeformed surface
  };
  PressingTools(double radius_mm, std::size_t count, bool passivity = false)
      : devices(count), model_(thick_block(radius_mm)), radius_mm_(radius_mm) {
    parameters_.method = ForceMethod::kProxy;
    parameters_.friction = parameters_.viscosity = false;
    parameters_.passivity = passivity;
    // the force ramp of the output stage is over
    for (auto& hand : state_.device) hand.output.gain = 1;
    tick_once();
  }
  std::vector<Sphere> devices;

  void tick_once() {
    if (solver_.advance(*model_, &record_)) parameters_.compliance = solver_.frame();
    std::array<DeviceState, kMaxDevices> states;
    std::array<Wrench, kMaxDevices> wrenches;
    for (std::size_t d = 0; d < devices.size(); ++d)
      states[d].tip =
          model_->X_WorldPatient * Point<Patient>(devices[d].x_mm, -0.2, radius_mm_ - devices[d].depth_mm);
    tick(*model_, parameters_, std::span(states).first(devices.size()), 1e-3, state_,
         std::span(wrenches).first(devices.size()), record_);
  }
  void stay(int ticks) {
    for (int n = 0; n < ticks; ++n) tick_once();
  }
  const DeviceTick& of(std::size_t device) const { return record_.device[device]; }
  /// Force on a tool in the patient's axes.
  Vector<Patient> force_N(std::size_t device) const {
    const auto& force = record_.device[device].force_N;
    return model_->X_WorldPatient.inverse() * Vector<World>(force[0], force[1], force[2]);
  }

 private:
  std::shared_ptr<const Model> model_;
  double radius_mm_;
  Parameters parameters_;
  SessionState state_;
  TickRecord record_;
  VirtualClockSoftTissueSolver solver_{1000};
};

// Hertz's force of a sphere; N per mm^1.5
double hertz_N_per_mm15(double radius_mm) {
  return 4.0 / 3 * contact_modulus_N_per_mm2({kModulus_kPa, kPoissonsRatio}) * std::sqrt(radius_mm);
}

class DeformableTouch : public ::testing::TestWithParam<double> {};

TEST_P(DeformableTouch, BeginsAtTheSurfaceWithTheHertzForce) {
  constexpr double kStep_mm = 0.01, kPerceived_N = 1e-3, kPressed_mm = 1;
  const double limit_mm = 0.1 * kVoxel_mm, radius_mm = GetParam();
  PressingTools tool(radius_mm, 1);
  const DeviceTick& reported = tool.of(0);
  double touched_mm = -1, perceived_mm = -1;
  for (double depth_mm = -0.3; depth_mm < kPressed_mm; depth_mm += kStep_mm) {
    tool.devices[0].depth_mm = depth_mm;
    tool.tick_once();
    if (touched_mm < -0.5 && (reported.flags & kFlagContact) != 0) touched_mm = depth_mm;
    if (perceived_mm < -0.5 && reported.unclamped_force_N > kPerceived_N) perceived_mm = depth_mm;
    if ((reported.flags & kFlagContact) != 0) {
      ASSERT_EQ(reported.label, 1);
      ASSERT_EQ(reported.contact_label[0], 1);
    }
  }
  EXPECT_NEAR(touched_mm, 0, limit_mm);
  EXPECT_NEAR(perceived_mm, 0, limit_mm);
  tool.devices[0].depth_mm = kPressed_mm;
  tool.stay(kSettled);
  EXPECT_NEAR(tool.force_N(0).norm() / (hertz_N_per_mm15(radius_mm) * std::pow(kPressed_mm, 1.5)), 1, 0.07);
}

INSTANTIATE_TEST_SUITE_P(Radii, DeformableTouch, ::testing::Values(4.0, 6.0, 12.0),
                         [](const auto& one) { return "R" + std::to_string(static_cast<int>(one.param)); });

constexpr double kPairRadius_mm = 3;

// Forces of two spheres on a half-space: Hertz's law at the depth less the other's Boussinesq displacement.
std::array<double, 2> superposed_N(const std::array<double, 2>& depth_mm, double separation_mm) {
  const double mutual_mm_per_N =
      1 / (std::numbers::pi * contact_modulus_N_per_mm2({kModulus_kPa, kPoissonsRatio}) * separation_mm);
  std::array<double, 2> force_N{};
  for (int n = 0; n < 200; ++n)
    for (const std::size_t d : {0, 1}) {
      const double left_mm = std::max(0.0, depth_mm[d] - mutual_mm_per_N * force_N[1 - d]);
      force_N[d] = hertz_N_per_mm15(kPairRadius_mm) * std::pow(left_mm, 1.5);
    }
  return force_N;
}

TEST(NeighbouringTools, ForceLossMatchesBoussinesqSuperposition) {
  constexpr double kDepth_mm = 1;
  PressingTools tools(kPairRadius_mm, 2);
  tools.devices[0] = {-3.5, kDepth_mm};
  tools.stay(kSettled);
  const double alone_N = tools.force_N(0).norm(), hertz_N = superposed_N({kDepth_mm, -1}, 7)[0];
  EXPECT_NEAR(alone_N / hertz_N, 1, 0.05);
  for (const double separation_mm : {6.0, 7.0, 10.0, 18.0}) {
    tools.devices[0].x_mm = -0.5 * separation_mm;
    for (const double deeper_mm : {0.0, 1.0}) {
      tools.devices[1] = {0.5 * separation_mm, kDepth_mm + deeper_mm};
      tools.stay(kSettled);
      const auto expected_N = superposed_N({kDepth_mm, kDepth_mm + deeper_mm}, separation_mm);
      // relative to the forces without the other tool, which the first check compares with Hertz
      EXPECT_NEAR(tools.force_N(0).norm() / alone_N, expected_N[0] / hertz_N, 0.05) << separation_mm;
      EXPECT_GT(tools.force_N(0).x(), 0) << "the dent of the other tool attracts it";
    }
  }
  // the first one, 1 mm deep, loses more than a third to another one 2 mm deep
  tools.devices = {{-3.5, kDepth_mm}, {3.5, -1}};
  tools.stay(kSettled);
  const double first_N = tools.force_N(0).norm();
  tools.devices[1].depth_mm = 2;
  tools.stay(kSettled);
  EXPECT_LT(tools.force_N(0).norm(), 0.67 * first_N);
  EXPECT_NE(tools.of(0).flags & kFlagContact, 0u);
  tools.devices[1].depth_mm = -1;
  tools.stay(kSettled);
  EXPECT_NEAR(tools.force_N(0).norm(), first_N, 0.01 * first_N);
}

TEST(NeighbouringTools, ReturnNoMoreEnergyThanBothHandsPutIn) {
  PressingTools tools(kPairRadius_mm, 2);
  tools.devices = {{-3.5, -0.2}, {3.5, -0.2}};
  tools.stay(40);
  double given_mJ = 0, most_mJ = 0;
  const auto lead = [&](std::size_t device, double along_mm, double down_mm) {
    constexpr int kSteps = 300;
    for (int n = 0; n < kSteps; ++n) {
      tools.devices[device].x_mm += along_mm / kSteps;
      tools.devices[device].depth_mm += down_mm / kSteps;
      const Vector<Patient> before_N = tools.force_N(device);
      tools.tick_once();
      const Vector<Patient> mean_N = (before_N + tools.force_N(device)) * 0.5;
      given_mJ += Vector<Patient>(along_mm, 0, -down_mm).dot(mean_N) / kSteps;
      most_mJ = std::max(most_mJ, -given_mJ);
    }
  };
  lead(0, 0, 1.7);
  lead(1, 0, 1.7);
  lead(0, -3, 0);
  lead(1, 0, -1.7);
  lead(0, 3, 0);
  lead(0, 0, -1.7);
  EXPECT_GT(most_mJ, 0.05);
  EXPECT_NEAR(given_mJ, 0, 0.02 * most_mJ);
}

// A neighbour that comes and goes leaves the passivity observer of the other tool as it was.
TEST(NeighbouringTools, WorkOfANeighbourIsNotCountedAsGeneratedEnergy) {
  constexpr double kDepth_mm = 2, kStep_mm = 0.02;
  PressingTools both(kPairRadius_mm, 2, true), alone(kPairRadius_mm, 2, true);
  for (PressingTools* tools : {&both, &alone}) {
    tools->devices = {{-3.5, -0.1}, {3.5, -0.1}};
    tools->stay(20);
    const auto lead = [tools](std::size_t device, double to_mm) {
      double& depth_mm = tools->devices[device].depth_mm;
      const double step_mm = std::copysign(kStep_mm, to_mm - depth_mm);
      while (std::abs(to_mm - depth_mm) > kStep_mm) {
        depth_mm += step_mm;
        tools->tick_once();
      }
    };
    lead(0, kDepth_mm);
    if (tools == &both) {
      lead(1, kDepth_mm);
      lead(1, -0.1);
    }
  }
  both.stay(kSettled);
  alone.stay(kSettled);
  const double energy_mJ = alone.of(0).energy_mJ;
  EXPECT_GT(energy_mJ, 0.01);
  EXPECT_NEAR(both.of(0).energy_mJ, energy_mJ, 0.02 * energy_mJ);
}

}  // namespace
}  // namespace palpate
