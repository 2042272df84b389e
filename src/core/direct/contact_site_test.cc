#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "contact/test_model.h"
#include "contact/test_random.h"
#include "palpate/direct/direct_methods.h"

namespace palpate {
namespace {

using testing::ball_model;
using testing::kBone;
using testing::kBoneRadius_mm;
using testing::kCartilage;
using testing::random_direction;

TEST(ContactSite, DepthIsTheDistanceBelowTheSurface) {
  const Model model = ball_model();
  std::mt19937 random(3);
  for (const double depth_mm : {-2.0, -1.0, -0.3, 0.0, 0.3, 1.0, 2.0})
    for (int i = 0; i < 50; ++i) {
      const Point<Patient> x = Point<Patient>() + random_direction(random) * (kBoneRadius_mm - depth_mm);
      const ContactSite site = find_contact_site(model, x, sample_central_differences(*model.field, x));
      ASSERT_EQ(site.label, kBone);
      EXPECT_EQ(site.tissue, 0);
      EXPECT_NEAR(site.depth_mm, depth_mm, 0.08) << "the chord of a ramp over half a voxel";
    }
}

TEST(ContactSite, CartilageIsContactedBeforeItsBone) {
  const Model model = ball_model({0.6, 0.6, 0.6}, 0.7, 3);
  std::mt19937 random(4);
  for (int i = 0; i < 50; ++i) {
    const Vector<Patient> n = random_direction(random);
    const auto site_at = [&](double radius_mm) {
      const Point<Patient> x = Point<Patient>() + n * radius_mm;
      return find_contact_site(model, x, sample_central_differences(*model.field, x));
    };
    EXPECT_EQ(site_at(kBoneRadius_mm + 3.5).label, kCartilage) << "through fat, which is not felt";
    EXPECT_EQ(site_at(kBoneRadius_mm + 2).label, kCartilage);
    EXPECT_EQ(site_at(kBoneRadius_mm - 0.7).label, kBone);
    EXPECT_NEAR(site_at(kBoneRadius_mm + 3).depth_mm, 0, 0.12);
  }
}

TEST(ContactSite, DepthOfBoneIsMeasuredFromItsBorderWithTheCartilage) {
  // half of bone's level occurs inside the cartilage; the boundary is where the field is midway between the
  // levels
  for (const float cartilage_level : {0.3f, 0.5f, 0.65f}) {
    Model model = ball_model({0.6, 0.6, 0.6}, 0.7, 4, cartilage_level);
    std::mt19937 random(6);
    for (const double depth_mm : {0.6, 1.0, 1.5})
      for (int i = 0; i < 20; ++i) {
        const Point<Patient> x = Point<Patient>() + random_direction(random) * (kBoneRadius_mm - depth_mm);
        const ContactSite site = find_contact_site(model, x, sample_central_differences(*model.field, x));
        ASSERT_EQ(site.label, kBone);
        EXPECT_NEAR(site.depth_mm, depth_mm, 0.15) << "cartilage at " << cartilage_level;
      }
  }
}

TEST(ContactSite, ValleyBelongsToTheNearerSide) {
  // two half-spaces facing each other along x: in the valley between them the gradient points along the
  // valley or vanishes, although there is a structure in contact
  Model model = ball_model({1, 1, 1});
  GridGeometry grid = model.labels->geometry();
  Volume<LabelId> labels(grid);
  Volume<std::uint16_t> field(grid);
  const auto X = grid.X_PatientVoxel();
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) {
        const double x = (X * Point<Voxel>(i, j, k)).x();
        const double value = testing::ramp(2 + x, 1.0) + testing::ramp(2 - x, 1.0);
        field.at(i, j, k) = static_cast<std::uint16_t>(std::lround(65535 * std::min(1.0, value)));
        labels.at(i, j, k) = x < -2 ? kBone : x > 2 ? kCartilage : LabelId{0};
      }
  model.labels = label_bricks(labels);
  model.field = std::make_shared<const Field>(std::move(field));
  const Point<Patient> floor(0, 0, 0);
  const FieldSample sample = sample_central_differences(*model.field, floor);
  ASSERT_GT(sample.value, 0.02);
  ASSERT_LT(sample.gradient.norm(), 1e-6);
  EXPECT_NE(find_contact_site(model, floor, sample).label, 0);
  const Point<Patient> left(-0.5, 0, 0);
  EXPECT_EQ(find_contact_site(model, left, sample_central_differences(*model.field, left)).label, kBone);
}

TEST(ContactSite, FreeSpaceAndOutsideHaveNoContact) {
  const Model model = ball_model();
  for (const Point<Patient>& x :
       {Point<Patient>(25, 0, 0), Point<Patient>(1e6, 0, 0), Point<Patient>(-1e300, 0, 0)}) {
    const ContactSite site = find_contact_site(model, x, sample_central_differences(*model.field, x));
    EXPECT_EQ(site.label, 0);
    EXPECT_EQ(site.tissue, -1);
  }
}

TEST(ContactSite, DeepInsideUsesTheLabelAtTheTip) {
  const Model model = ball_model();
  const FieldSample sample = sample_central_differences(*model.field, Point<Patient>());
  ASSERT_EQ(sample.gradient.norm(), 0) << "the ramp has ended here";
  const ContactSite site = find_contact_site(model, Point<Patient>(), sample);
  EXPECT_EQ(site.label, kBone);
  EXPECT_TRUE(std::isnan(site.depth_mm)) << "no direction, no depth";
}

TEST(ContactSite, RampsUseTheVoxelLabelAtFullDepth) {
  const Model model = testing::with_ramps(ball_model({0.6, 0.6, 0.6}, 1, 3), 4, 3);
  std::mt19937 random(8);
  for (int n = 0; n < 300; ++n) {
    const Vector<Patient> up = testing::random_direction(random);
    for (const double radius_mm : {12.5, 14.0, 16.0, 17.5}) {
      const Point<Patient> x = Point<Patient>() + up * radius_mm;
      const ContactSite site = find_contact_site(model, x, sample_central_differences(*model.field, x));
      const bool in_bone = radius_mm < kBoneRadius_mm;
      EXPECT_EQ(site.label, in_bone ? kBone : kCartilage);
      // tolerance: half a voxel diagonal
      EXPECT_NEAR(site.depth_mm, (in_bone ? kBoneRadius_mm : kBoneRadius_mm + 3) - radius_mm, 0.6);
      EXPECT_FLOAT_EQ(static_cast<float>(site.level), (in_bone ? 1.f : 0.5f) / 4) << "whole at a millimetre";
    }
    const Point<Patient> before = Point<Patient>() + up * 19.5;
    EXPECT_EQ(find_contact_site(model, before, sample_central_differences(*model.field, before)).label, 0)
        << "no halo";
  }
}

TEST(ContactSite, NonFinitePositionHasNoContact) {
  const Model model = ball_model();
  const Point<Patient> x(std::nan(""), 0, 0);
  EXPECT_EQ(find_contact_site(model, x, sample_central_differences(*model.field, x)).label, 0);
}

}  // namespace
}  // namespace palpate
