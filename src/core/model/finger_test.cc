#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "contact/test_layer_oracle.h"
#include "palpate/model/make_model.h"
#include "palpate/servo/servo.h"
#include "palpate/tissue/yield_solver.h"

/// Tools as wide as a finger on soft tissue, in the complete tick.
namespace palpate {
namespace {

constexpr double kThick_mm = 30, kModulus_kPa = 10, kPoissonsRatio = 0.45;

// Block of soft tissue on bone with its surface at z = 0.
Result<std::shared_ptr<const Model>> block_for(double radius_mm, double spacing_mm) {
  GridGeometry grid;
  const int across = static_cast<int>(56 / spacing_mm), deep = static_cast<int>(34 / spacing_mm), above = 3;
  grid.dims = {across, across, deep + above};
  grid.spacing_mm = Eigen::Vector3d::Constant(spacing_mm);
  const double corner = -0.5 * (across - 1) * spacing_mm;
  grid.origin = Point<Patient>(corner, corner, (0.5 - deep) * spacing_mm);
  Volume<LabelId> labels(grid);
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < across; ++j)
      for (int i = 0; i < across; ++i) {
        const double z = (k + 0.5 - deep) * spacing_mm;
        labels.at(i, j, k) = z > 0 ? LabelId{0} : z > -kThick_mm ? LabelId{1} : LabelId{2};
      }
  ModelParts parts;
  parts.labels = label_bricks(labels);
  parts.segments = {{1, "fat", {}, 0, 1}, {2, "bone", {}, 0, 2}};
  Tissue fat, bone;
  fat.name = "fat";
  fat.stiffness_N_per_mm = 0.2;
  fat.elastic = ElasticConstants{kModulus_kPa, kPoissonsRatio};
  bone.name = "bone";
  bone.stiffness_N_per_mm = 2;
  parts.tissues = {fat, bone};
  parts.tissue_of_label = {-1, 0, 1};
  parts.tissue_law = TissueLaw::kElastic;
  Tool tool;
  tool.radius_mm = radius_mm;
  parts.tools = {tool};
  auto made = make_model(std::move(parts));
  if (!made) return made.error();
  const ForceMethod proxy = ForceMethod::kProxy;
  return prepared_for(made->model, {&proxy, 1});
}

TEST(Finger, TouchesWhereItsGeometryDoesWithTheForceOfASphere) {
  const testing::LayerOracle oracle(kPoissonsRatio);
  for (const double spacing_mm : {0.8, 1.0})
    for (const double radius_mm : {4.0, 6.0, 8.0, 12.0}) {
      SCOPED_TRACE(std::to_string(radius_mm) + " mm, voxels of " + std::to_string(spacing_mm));
      const auto made = block_for(radius_mm, spacing_mm);
      ASSERT_TRUE(made.ok()) << made.error().message();
      const Model& model = **made;
      Parameters parameters;
      parameters.method = ForceMethod::kProxy;
      parameters.friction = parameters.viscosity = false;
      SessionState state;
      TickRecord record;
      VirtualClockYieldSolver yields(1000);
      const auto tick_at = [&](double z) {
        if (yields.advance(model, state.tick > 0 ? &record : nullptr)) parameters.yields = yields.frame();
        DeviceState device;
        device.tip = model.X_WorldPatient * Point<Patient>(0.2, -0.3, z);
        Wrench wrench;
        tick(model, parameters, {&device, 1}, 1e-3, state, {&wrench, 1}, record);
      };
      constexpr double kAbove_mm = 1, kStep_mm = 0.02;
      for (int n = 0; n < 600; ++n) tick_at(radius_mm + kAbove_mm);
      double touched_mm = 0;
      for (double z = radius_mm + kAbove_mm; z > radius_mm - 1 && touched_mm == 0; z -= kStep_mm) {
        tick_at(z);
        if (record.device[0].contact_label[0] != 0 && record.device[0].depth_mm > 0) touched_mm = z;
      }
      EXPECT_NEAR(touched_mm, radius_mm, 0.1 * spacing_mm);
      for (const double depth_mm : {1.0, 2.0}) {
        for (int n = 0; n < 300; ++n) tick_at(radius_mm - depth_mm);
        const double modulus = 1e-3 * kModulus_kPa / (1 - kPoissonsRatio * kPoissonsRatio);
        const double exact_N = oracle.at_depth(radius_mm / kThick_mm, depth_mm / kThick_mm).force * modulus *
                               kThick_mm * kThick_mm;
        EXPECT_NEAR(record.device[0].contact_N[0] / exact_N, 1, 0.07) << depth_mm;
      }
    }
}

TEST(Finger, WiderThanWhatSurfacesReachIsRefusedWithTheRemedy) {
  const auto made = block_for(12, 4);
  ASSERT_FALSE(made.ok());
  EXPECT_NE(made.error().message().find("too wide for voxels of 4 mm"), std::string::npos)
      << made.error().message();
  EXPECT_NE(made.error().message().find("`radius`"), std::string::npos);
}

}  // namespace
}  // namespace palpate
