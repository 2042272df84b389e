// Whatever a caller hands over, making and changing a model gives an error or a model, and never ends the
// program.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <string>

#include "base/test_seed.h"
#include "palpate/model/changed_model.h"
#include "palpate/model/make_model.h"
#include "palpate/servo/servo.h"

namespace palpate {
namespace {

using ::testing::HasSubstr;

const double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// a block of bone in the middle of a small volume
ModelParts block(const std::function<void(GridGeometry&)>& change = {}) {
  GridGeometry grid;
  grid.dims = {10, 10, 10};
  Volume<LabelId> labels(grid);
  for (int k = 2; k < 8; ++k)
    for (int j = 2; j < 8; ++j)
      for (int i = 2; i < 8; ++i) labels.at(i, j, k) = 1;
  if (change) {
    const auto voxels = labels.voxels();
    change(grid);
    labels = Volume<LabelId>(grid, voxels);
  }
  ModelParts parts;
  parts.labels = label_bricks(labels);
  parts.segments.push_back({1, "block", {}, 0, 1});
  Tissue bone;
  bone.name = "bone";
  parts.tissues = {bone};
  parts.tissue_of_label = {-1, 0};
  return parts;
}

// location of the error, or "none"
std::string fault_of(ModelParts parts) {
  const auto made = make_model(std::move(parts));
  if (made.ok()) return "none";
  EXPECT_EQ(made.error().kind, ErrorKind::kBadInput);
  EXPECT_FALSE(made.error().what.empty());
  return made.error().where;
}
std::string fault_after(const std::function<void(ModelParts&)>& change) {
  ModelParts parts = block();
  change(parts);
  return fault_of(std::move(parts));
}

TEST(CheckParts, MissingLabelsAndInvalidTissueIndicesAreRejected) {
  EXPECT_EQ(fault_of(block()), "none");
  EXPECT_EQ(fault_of({}), "labels");
  EXPECT_EQ(fault_after([](ModelParts& p) { p.tissue_of_label = {-1, 1}; }), "tissue_of_label[1]");
  EXPECT_EQ(fault_after([](ModelParts& p) { p.tissue_of_label = {-1, -2}; }), "tissue_of_label[1]");
  EXPECT_EQ(fault_after([](ModelParts& p) { p.tissue_of_label = {0, 0}; }), "tissue_of_label[0]");
  EXPECT_EQ(fault_after([](ModelParts& p) { p.tissue_of_label.resize(70'000, -1); }), "tissue_of_label");
  EXPECT_EQ(fault_after([](ModelParts& p) { p.tissues[0].rests_on = {7}; }), "tissues[0]");
  EXPECT_EQ(fault_after([](ModelParts& p) { p.tools.clear(); }), "tools");
  EXPECT_EQ(fault_after([](ModelParts& p) { p.tools.resize(kMaxDevices + 1); }), "tools");
  EXPECT_EQ(fault_after([](ModelParts& p) { p.labels = std::make_shared<const Bricks<LabelId>>(); }), "dims");
}

TEST(CheckParts, DegenerateGridIsRejected) {
  for (const double spacing_mm : {0.0, -1.0, kNaN, kInfinity})
    EXPECT_EQ(fault_of(block([&](GridGeometry& grid) { grid.spacing_mm[1] = spacing_mm; })), "spacing_mm")
        << spacing_mm;
  EXPECT_EQ(fault_of(block([](GridGeometry& grid) { grid.direction.setZero(); })), "direction");
  EXPECT_EQ(fault_of(block([](GridGeometry& grid) { grid.origin = Point<Patient>(0, kNaN, 0); })), "origin");
}

TEST(CheckParts, NonFinitePropertiesAndToolsAreRejected) {
  for (const double value : {-1.0, kNaN, kInfinity}) {
    for (const ContactProperty& property : kContactProperties)
      EXPECT_EQ(fault_after([&](ModelParts& p) { p.tissues[0].*property.value = value; }), "tissues[0]");
    EXPECT_EQ(fault_after([&](ModelParts& p) { p.tools[0].radius_mm = value; }), "tools[0]");
    EXPECT_EQ(fault_after([&](ModelParts& p) { p.sigma_mm = value; }), "method_settings");
  }
  EXPECT_EQ(fault_after([](ModelParts& p) { p.tissues[0].stiffness_N_per_mm = 0; }), "tissues[0]");
  EXPECT_EQ(fault_after([](ModelParts& p) { p.tissues[0].puncture_N = kNaN; }), "tissues[0]");
  EXPECT_EQ(fault_after([](ModelParts& p) { p.max_force_N = kNaN; }), "max_force_N");
  EXPECT_EQ(fault_after([](ModelParts& p) { p.tools[0].points_mm.clear(); }), "tools[0]");
  EXPECT_EQ(fault_after([](ModelParts& p) { p.tools[0].points_mm.resize(5); }), "tools[0]");
  EXPECT_EQ(fault_after([](ModelParts& p) { p.tools[0].points_mm[0][2] = kNaN; }), "tools[0]");
  EXPECT_EQ(fault_after([](ModelParts& p) {
              p.tools[0].capsules = {{{0, 0, 0}, {0, 0, 0}, 1}};
            }),
            "tools[0]");
  EXPECT_EQ(fault_after([](ModelParts& p) { p.tools[0].burr = BurrSettings{}; }), "tools[0]") << "no radius";
  const auto burr = [](const std::function<void(BurrSettings&)>& change) {
    return fault_after([&](ModelParts& p) {
      p.tools[0].radius_mm = 2;
      p.tools[0].burr = BurrSettings{};
      change(*p.tools[0].burr);
    });
  };
  EXPECT_EQ(burr([](BurrSettings&) {}), "none");
  EXPECT_EQ(burr([](BurrSettings& b) { b.pedal = 32; }), "tools[0]");
  EXPECT_EQ(burr([](BurrSettings& b) { b.spindle.setZero(); }), "tools[0]");
  EXPECT_EQ(burr([](BurrSettings& b) { b.revolutions_per_s = kNaN; }), "tools[0]");
  EXPECT_EQ(burr([](BurrSettings& b) { b.length_mm = 5; }), "tools[0]") << "no radius of its end";
}

TEST(CheckParts, NullModelIsRejected) {
  const ForceMethod proxy = ForceMethod::kProxy;
  EXPECT_FALSE(prepared_for(nullptr, {&proxy, 1}).ok());
  EXPECT_FALSE(next_version({}, {.version = 2, .tissue = 0}).ok());

  const auto made = make_model(block());
  ASSERT_TRUE(made.ok()) << made.error().message();
  const auto model = prepared_for(*made, {&proxy, 1});
  ASSERT_TRUE(model.ok()) << model.error().message();
  EXPECT_FALSE(next_version({*model, nullptr}, {.version = 2, .tissue = 0}).ok());
  EXPECT_FALSE(next_version({*model, *model}, current_values(**model, 12)).ok());
  const ModelChange cut{.version = 2, .tissue = ModelChange::kCut};
  const auto refused = [&](const Cut& one) {
    const auto next = next_version({*model, *model}, cut, {&one, 1});
    return !next.ok() && next.error().kind == ErrorKind::kBadInput;
  };
  const Point<Patient> at(5, 5, 8), nowhere(0, kNaN, 0);
  EXPECT_FALSE(refused({0, {at, at, 2}}));
  EXPECT_TRUE(refused({kMaxDevices, {at, at, 2}}));
  EXPECT_TRUE(refused({0, {at, nowhere, 2}}));
  EXPECT_TRUE(refused({0, {at, Point<Patient>(1e300, 0, 0), 2}}));
  for (const double radius_mm : {0.0, -1.0, kNaN, kInfinity, 1e6})
    EXPECT_TRUE(refused({0, {at, at, radius_mm}})) << radius_mm;
}

// random values from ordinary to hostile, in every number of the parts
TEST(CheckParts, RandomPartsGiveAUsableModelOrAnError) {
  const unsigned seed = test::test_seed();
  std::mt19937_64 random(seed);
  const auto number = [&](double usual) {
    constexpr std::array kHostile{0.0, -1.0, 1e-300, 1e300, 5e-324, 1e9, -1e9};
    switch (random() % 12) {
      case 0:
        return kNaN;
      case 1:
        return random() % 2 == 0 ? kInfinity : -kInfinity;
      case 2:
        return kHostile[random() % kHostile.size()];
      default:
        return usual;
    }
  };
  int models = 0;
  for (int n = 0; n < 300; ++n) {
    ModelParts parts = block([&](GridGeometry& grid) {
      if (random() % 4 != 0) return;
      for (int axis = 0; axis < 3; ++axis) grid.spacing_mm[axis] = number(1);
      grid.direction(0, 0) = number(1);
      grid.origin = Point<Patient>(number(0), 0, 0);
    });
    Tissue& tissue = parts.tissues[0];
    if (random() % 4 == 0)
      for (const ContactProperty& property : kContactProperties)
        tissue.*property.value = number(tissue.*property.value);
    if (random() % 4 == 0) tissue.puncture_N = number(1);
    if (random() % 4 == 0) parts.tools[0].radius_mm = number(1);
    if (random() % 4 == 0) parts.max_force_N = number(3);
    if (random() % 4 == 0) parts.ramp_width_mm = number(2);
    if (random() % 4 == 0) parts.no_go = {{"wall", NoGoSphere{Point<Patient>(), number(3)}, number(1), 1}};
    if (random() % 8 == 0) parts.reported_distances.structures = {static_cast<LabelId>(random() % 3)};
    if (random() % 8 == 0)
      parts.no_go.push_back({"label", NoGoStructure{static_cast<LabelId>(random() % 3)}, 1});
    if (random() % 8 == 0) parts.tissue_of_label.push_back(static_cast<std::int16_t>(random()));
    const auto made = make_model(std::move(parts));
    if (!made.ok()) {
      EXPECT_FALSE(made.error().what.empty());
      continue;
    }
    const ForceMethod methods[] = {ForceMethod::kProxy, ForceMethod::kTrilinear};
    const auto model = prepared_for(*made, methods);
    if (!model.ok()) continue;
    ++models;
    Parameters parameters;
    parameters.method = ForceMethod::kProxy;
    SessionState state;
    Wrench wrench;
    TickRecord record;
    for (int tick_number = 0; tick_number < 40; ++tick_number) {
      DeviceState device;
      device.tip =
          (*model)->X_WorldPatient * Point<Patient>(number(5), number(5), number(9.0 - 0.1 * tick_number));
      if (random() % 8 == 0) device.R_WorldTool.w() = number(1);
      tick(**model, parameters, {&device, 1}, number(1e-3), state, {&wrench, 1}, record);
      ASSERT_TRUE(wrench.force_N.all_finite()) << "seed " << seed;
      ASSERT_LE(wrench.force_N.norm(), 3 * (1 + 1e-9)) << "seed " << seed;
    }
  }
  EXPECT_GT(models, 30);
}

}  // namespace
}  // namespace palpate
