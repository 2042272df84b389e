#include "verification/accuracy_fields.h"

#include <gtest/gtest.h>

#include <cmath>

#include "palpate/direct/direct_methods.h"
#include "verification/smoothed_indicator.h"

namespace palpate {
namespace {

const Shape& ball() {
  static const Shape shape = Shape::sphere({0.2, -0.1, 0.3}, 8);
  return shape;
}

GridGeometry grid() {
  GridGeometry grid;
  grid.dims = {45, 45, 31};
  grid.spacing_mm = {0.6, 0.6, 0.9};
  grid.origin = {-13.2, -13.2, -13.5};
  return grid;
}

TEST(VoxelisedSolid, IsPreparedForEveryMethod) {
  const auto solid = VoxelisedSolid::make(ball(), grid());
  ASSERT_TRUE(solid.ok());
  for (const int bytes : {1, 2}) {
    const auto model = solid->prepared(1.5, bytes);
    ASSERT_TRUE(model.ok());
    EXPECT_EQ(model->field->bytes_per_voxel(), bytes);
    for (const ForceMethodInfo& info : kDirectMethods) {
      const auto field = make_force_field(*model, info.method);
      ASSERT_TRUE(field.ok()) << info.name;
      EXPECT_EQ((*field)->method(), info.method);
      EXPECT_GT((*field)->sample({0.2, -0.1, 4.3}).value, 0.9) << info.name;
      EXPECT_LT((*field)->sample({0.2, -0.1, 12.5}).value, 0.1) << info.name;
      const FieldSample at_surface = (*field)->sample({0.2, -0.1, 8.3});
      EXPECT_NEAR(at_surface.value, 0.5, 0.15) << info.name;
      EXPECT_LT(at_surface.gradient.z(), 0) << info.name;
    }
  }
}

TEST(VoxelisedSolid, RejectsInvalidFilterWidths) {
  const auto solid = VoxelisedSolid::make(ball(), grid());
  const auto refused = solid->prepared(-1, 2);
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.error().kind, ErrorKind::kBadInput);
}

TEST(ExactSolid, HoldsTheExactValuesAtVoxelCentres) {
  const ExactSolid solid(ball(), grid());
  const Volume<float> ramp = solid.ramp(1.5), bytes = solid.ramp_field(1.5, 1).values(),
                      words = solid.ramp_field(1.5, 2).values(), distances = solid.distance_field().values();
  const auto X_PatientVoxel = grid().X_PatientVoxel();
  for (int k = 0; k < 31; k += 2) {
    for (int j = 0; j < 45; j += 3) {
      for (int i = 0; i < 45; ++i) {
        const double distance = ball().distance_mm(X_PatientVoxel * Point<Voxel>(i, j, k));
        const double value = smoothed_half_space(distance, 1.5);
        ASSERT_NEAR(ramp.at(i, j, k), value, 1e-6);
        ASSERT_NEAR(bytes.at(i, j, k), value, 0.5 / 255 + 1e-6);
        ASSERT_NEAR(words.at(i, j, k), value, 0.5 / 65535 + 1e-6);
        ASSERT_NEAR(distances.at(i, j, k), distance, 0.00025 + 1e-5);
      }
    }
  }
}

TEST(ExactSolid, ClampsLargeDistances) {
  GridGeometry wide = grid();
  wide.spacing_mm = {3, 3, 3};
  wide.origin = {-66, -66, -45};
  const Volume<float> distances = ExactSolid(Shape::sphere({}, 30), wide).distance_field().values();
  EXPECT_NEAR(distances.at(0, 0, 0), 16.3835, 1e-4);
  EXPECT_NEAR(distances.at(22, 22, 15), -16.3835, 1e-4);
}

}  // namespace
}  // namespace palpate
