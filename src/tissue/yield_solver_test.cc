#include "palpate/tissue/yield_solver.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <vector>

#include "haptics/test_proxy_surfaces.h"
#include "palpate/tissue/carved_cells.h"
#include "palpate/tissue/carving.h"
#include "palpate/tissue/elastic_contact.h"
#include "palpate/tissue/elastic_solver.h"
#include "tissue/test_soft_block.h"

namespace palpate {
namespace {

using testing::pressed_at;
using testing::soft_block;
using testing::tool_at;

double settled_compliance(const Model& model, const TickRecord& felt) {
  YieldSolver solver;
  for (int n = 0; n < 12; ++n) solver.solve(model, felt);
  return solver.frame().spot[0].compliance_mm_per_N;
}

TEST(YieldSolver, KnowsWhatIsUnderAToolThatComes) {
  const auto model = soft_block(false);
  YieldSolver solver;
  const YieldFrame& frame = solver.solve(*model, tool_at({2, 1, 6}));
  EXPECT_EQ(frame.number, 1u);
  const YieldSpot& spot = frame.spot[0];
  ASSERT_TRUE(spot.is_known());
  EXPECT_LT((spot.at - Point<Patient>(2, 1, 0)).norm(), 0.01);
  EXPECT_EQ(spot.patch_radius_mm, 4.5);
  EXPECT_NEAR(spot.modulus_N_per_mm2, 0.0125, 0.0125 * 0.05);
  // a layer of 20 mm on a plate gives less than a half space, and not by much under so small a patch
  const double half_space = 0.6 / (4.5 * 0.01 / (1 - 0.45 * 0.45));
  EXPECT_LT(spot.compliance_mm_per_N, half_space);
  EXPECT_GT(spot.compliance_mm_per_N, 0.75 * half_space);
  EXPECT_FALSE(frame.spot[1].is_known());
}

TEST(YieldSolver, GivesOnOneFrameAfterAnotherWhatItWouldGiveInTheEnd) {
  const auto model = soft_block(true);
  const TickRecord still = pressed_at(0, 0);
  YieldSolver solver;
  const double first = solver.solve(*model, still).spot[0].compliance_mm_per_N;
  const double end = settled_compliance(*model, still);
  EXPECT_NEAR(first / end, 1, 0.01);
  solver.solve(*model, still);
  EXPECT_NEAR(solver.frame().spot[0].compliance_mm_per_N / end, 1, 2e-3);
}

TEST(YieldSolver, IsHarderOverSomethingHardAndSlopesTowardsIt) {
  const auto model = soft_block(true);
  const double over = settled_compliance(*model, pressed_at(0, 0)),
               beside = settled_compliance(*model, pressed_at(20, 0));
  EXPECT_LT(over, 0.92 * beside);
  YieldSolver solver;
  for (int n = 0; n < 8; ++n) solver.solve(*model, pressed_at(4, 0));
  const YieldSpot& spot = solver.frame().spot[0];
  EXPECT_GT(spot.slope_per_N.x(), 0);
  // within a cell: from cell to cell W has ripples of a thousandth
  const double change =
      (settled_compliance(*model, pressed_at(4.1, 0)) - settled_compliance(*model, pressed_at(3.9, 0))) / 0.2;
  EXPECT_NEAR(spot.slope_per_N.x() / change, 1, 0.15);
}

TEST(YieldSolver, WhatIsHardFarBelowCountsToo) {
  auto model = std::make_shared<Model>(*soft_block(false));
  // the plate 22 cells down
  model->tissue_cell_mm = 0.9;
  YieldSolver solver;
  for (int n = 0; n < 12; ++n) solver.solve(*model, pressed_at(0, 0));
  const YieldSpot& spot = solver.frame().spot[0];

  // in a box that reaches into the plate and wider, to the end
  ElasticBox box = elastic_box_of(model->labels->geometry(), {{0, 0, 0}, {1, 1, 1}}, model->tissue_cell_mm);
  box.cells = {47, 48, 40};
  box.corner = Point<Patient>(-21.15, -21.6, -27);
  auto grid = ElasticGrid::of_labels(*model->labels, materials_of(*model), box);
  ASSERT_TRUE(grid.ok());
  grid->continue_beyond({true, true, true, true, true, true}, Point<Patient>(0, 0, 0));
  const PressurePatch patch(*grid, spot.at, Vector<Patient>(0, 0, 1), spot.patch_radius_mm);
  ElasticField unit(grid->layout()), load(grid->layout());
  patch.add(1, load);
  ASSERT_TRUE(ElasticSolver(*grid).solve(load, unit, 200, 1e-5).converged);
  EXPECT_NEAR(spot.compliance_mm_per_N / patch.displacement(unit), 1, 0.02);
}

TEST(YieldSolver, FollowsAToolThroughBoxesThatAreLaidAnew) {
  const auto model = soft_block(true);
  constexpr double kSpeed_mm_s = 50;
  YieldSolver solver;
  double worst = 0;
  // 16 mm of box lie on each side: three are laid on the way
  for (double x = -22; x < 22; x += kSpeed_mm_s * kYieldFrame_s) {
    const YieldSpot& spot = solver.solve(*model, pressed_at(x, 0.3, kSpeed_mm_s)).spot[0];
    ASSERT_TRUE(spot.is_known());
    // for where the tool will be
    EXPECT_NEAR(spot.at.x(), x + 1.5 * kSpeed_mm_s * kYieldFrame_s, 1e-6);
    if (static_cast<int>(std::floor(x)) % 4 != 0) continue;
    const double end = settled_compliance(*model, pressed_at(spot.at.x(), 0.3));
    worst = std::max(worst, std::abs(spot.compliance_mm_per_N / end - 1));
  }
  EXPECT_LT(worst, 0.025);
}

TEST(YieldSolver, DependsOnNothingButWhatItWasGiven) {
  const auto model = soft_block(true);
  YieldSolver one, other;
  for (int n = 0; n < 20; ++n) {
    const TickRecord felt = pressed_at(-15 + 1.5 * n, 0.1 * n, 90);
    EXPECT_EQ(one.solve(*model, felt).hash(), other.solve(*model, felt).hash());
  }
}

TEST(YieldSolver, KnowsNothingWhereNothingSoftIsNear) {
  const auto model = soft_block(false);
  YieldSolver solver;
  EXPECT_FALSE(solver.solve(*model, tool_at({0, 0, 30})).spot[0].is_known());
  EXPECT_FALSE(solver.solve(*model, tool_at({0, std::nan(""), 1})).spot[0].is_known());
  EXPECT_FALSE(solver.solve(*model, tool_at({0, 0, 1}, {0, std::nan(""), 0})).spot[0].is_known());
  EXPECT_EQ(solver.frame().number, 3u);
  auto bare = std::make_shared<Model>(*model);
  bare->tissues[0].elastic.reset();
  EXPECT_FALSE(solver.solve(*bare, tool_at({0, 0, 1})).spot[0].is_known());
  YieldField field;
  EXPECT_FALSE(solver.field_of(0, field));
  // and is none the worse for it
  bare->version = 2;
  bare->tissues[0].elastic = ElasticConstants{10, 0.45};
  EXPECT_TRUE(solver.solve(*bare, tool_at({0, 0, 1})).spot[0].is_known());
  EXPECT_TRUE(solver.field_of(0, field));
}

TEST(YieldSolver, EveryDeviceHasItsOwnPlace) {
  const auto model = soft_block(true);
  TickRecord felt = pressed_at(0, 0);
  felt.devices = 2;
  felt.device[1] = pressed_at(20, 0).device[0];
  YieldSolver solver;
  for (int n = 0; n < 6; ++n) solver.solve(*model, felt);
  const auto& spot = solver.frame().spot;
  ASSERT_TRUE(spot[0].is_known() && spot[1].is_known());
  EXPECT_LT(spot[0].compliance_mm_per_N, 0.92 * spot[1].compliance_mm_per_N);
}

// A plate of 200 kPa whose surface is z = 0, on something else, whose labels go up to z = top.
std::shared_ptr<const Model> plate_on(const std::optional<ElasticConstants>& support, double top_mm) {
  constexpr double kPlate_mm = 8, kSupport_mm = 20;
  auto model = std::make_shared<Model>(*soft_block(false));
  Volume<LabelId> labels(model->labels->geometry());
  const auto X_PatientVoxel = labels.geometry().X_PatientVoxel();
  for (int k = 0; k < labels.geometry().dims[2]; ++k)
    for (int j = 0; j < labels.geometry().dims[1]; ++j)
      for (int i = 0; i < labels.geometry().dims[0]; ++i) {
        const double z = (X_PatientVoxel * Point<Voxel>(i, j, k)).z();
        labels.at(i, j, k) = static_cast<LabelId>(z > top_mm         ? 0
                                                  : z > -kPlate_mm   ? 1
                                                  : z > -kSupport_mm ? 2
                                                                     : 3);
      }
  model->labels = label_bricks(labels);
  model->tissues[0].elastic = ElasticConstants{200, 0.45};
  model->tissues[1].elastic = support;
  model->surfaces = {testing::felt_surface(
      testing::cube_grid(testing::kSoftBlockHalf, {1, 1, 1}),
      [top_mm](const Eigen::Vector3d& p) { return p.z() - top_mm; }, 12)};
  return model;
}

// the plate without its uppermost millimetres, by a cylinder of 4 mm that lies and is led across its axis
std::shared_ptr<const Model> trimmed(const std::shared_ptr<const Model>& model, double by_mm) {
  constexpr double kAcross_mm = 38, kRadius_mm = 2;
  std::vector<Cut> cuts;
  for (double down_mm = 1; down_mm <= by_mm; down_mm += 1)
    cuts.push_back({0,
                    {{-kAcross_mm, -kAcross_mm, kRadius_mm - down_mm},
                     {kAcross_mm, -kAcross_mm, kRadius_mm - down_mm},
                     kRadius_mm,
                     0,
                     {0, 2 * kAcross_mm, 0},
                     kRadius_mm}});
  return Carving(*model).with(cuts)->taken_from(*model);
}

TickRecord pressed_on(double z) {
  TickRecord felt = pressed_at(0, 0);
  felt.device[0].tip_patient_mm[2] += z;
  felt.device[0].contact_patient_mm[2] = z;
  return felt;
}

TEST(YieldSolver, APlateThatIsTrimmedIsAsSoftAsOneThatWasMadeThinner) {
  constexpr double kTrimmed_mm = 3;
  struct On {
    const char* name;
    std::optional<ElasticConstants> support;
    bool softer;
  };
  for (const auto& [name, support, softer] :
       {On{"soft tissue", ElasticConstants{10, 0.45}, true}, On{"bone", std::nullopt, false}}) {
    SCOPED_TRACE(name);
    const auto whole = plate_on(support, 0);
    YieldSolver solver;
    for (int n = 0; n < 8; ++n) solver.solve(*whole, pressed_on(0));
    const double before = solver.frame().spot[0].compliance_mm_per_N;
    const auto less = trimmed(whole, kTrimmed_mm);
    for (int n = 0; n < 14; ++n) solver.solve(*less, pressed_on(-kTrimmed_mm));
    const YieldSpot& spot = solver.frame().spot[0];
    ASSERT_TRUE(spot.is_known());
    EXPECT_NEAR(spot.at.z(), -kTrimmed_mm, 0.05);
    const double thinner = settled_compliance(*plate_on(support, -kTrimmed_mm), pressed_on(-kTrimmed_mm));
    EXPECT_NEAR(spot.compliance_mm_per_N / thinner, 1, 0.02);
    if (softer)
      EXPECT_GT(spot.compliance_mm_per_N, 1.2 * before);
    else
      EXPECT_LT(spot.compliance_mm_per_N, 0.95 * before);
  }
}

TEST(YieldSolver, WhatIsCutAndPutBackIsFollowedWithoutALaidBox) {
  const auto whole = std::make_shared<Model>(*soft_block(true));
  // the surface between two layers of cells, and the groove beside the patch
  whole->tissue_cell_mm = 1;
  const auto groove = Carving(*whole).with(std::vector<Cut>{{0, {{6.5, -10, 0}, {6.5, 10, 0}, 3}}});
  const auto cut_away = groove->taken_from(*whole);
  const auto put_back = groove->undone()->taken_from(*cut_away);
  YieldSolver solver;
  const auto settled = [&](const Model& model) {
    for (int n = 0; n < 14; ++n) solver.solve(model, pressed_at(0, 0));
    return solver.frame().spot[0].compliance_mm_per_N;
  };
  const double before = settled(*whole), after = settled(*cut_away);
  EXPECT_GT(after, 1.01 * before);
  // the springs of a box that is laid now are the same: the tool has not moved
  EXPECT_NEAR(after / settled_compliance(*cut_away, pressed_at(0, 0)), 1, 1e-3);
  EXPECT_NEAR(settled(*put_back) / before, 1, 1e-3);
  // little by little: in no frame of the cut itself does a cell lose more than it may
  YieldSolver other;
  for (int n = 0; n < 8; ++n) other.solve(*whole, pressed_at(0, 0));
  double last = other.frame().spot[0].compliance_mm_per_N;
  for (int n = 0; n < 10; ++n) {
    const double now = other.solve(*cut_away, pressed_at(0, 0)).spot[0].compliance_mm_per_N;
    EXPECT_GE(now, last * 0.999);
    EXPECT_LE(now - last, 0.5 * (after - before));
    last = now;
  }
}

TEST(YieldSolver, AFrameIsAWholeNumberOfTicks) {
  EXPECT_EQ(ticks_of_yield_frame(1000), 16u);
  EXPECT_EQ(ticks_of_yield_frame(250), 4u);
  EXPECT_EQ(ticks_of_yield_frame(10'000), 156u);
  EXPECT_EQ(ticks_of_yield_frame(20), 1u);
}

}  // namespace
}  // namespace palpate
