#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "haptics/test_model.h"

namespace palpate {
namespace {

using testing::ball_model;
using testing::kBone;
using testing::kBoneRadius_mm;
using testing::kCartilage;

Vector<Patient> random_direction(std::mt19937& random) {
  std::normal_distribution<double> normal;
  return Vector<Patient>(normal(random), normal(random), normal(random)).normalized();
}

TEST(ContactSite, DepthIsTheDistanceBelowTheSurface) {
  const Model model = ball_model();
  std::mt19937 random(3);
  for (const double depth_mm : {-2.0, -1.0, -0.3, 0.0, 0.3, 1.0, 2.0})
    for (int i = 0; i < 50; ++i) {
      const Point<Patient> x = Point<Patient>() + random_direction(random) * (kBoneRadius_mm - depth_mm);
      const ContactSite site = find_contact_site(model, x, sample_central_differences(*model.field, x), 6);
      ASSERT_EQ(site.label, kBone);
      EXPECT_EQ(site.tissue, 0);
      EXPECT_NEAR(site.depth_mm, depth_mm, 0.08) << "the chord of a ramp over half a voxel";
    }
}

TEST(ContactSite, CartilageIsMetBeforeTheBoneUnderIt) {
  const Model model = ball_model({0.6, 0.6, 0.6}, 0.7, 3);
  std::mt19937 random(4);
  for (int i = 0; i < 50; ++i) {
    const Vector<Patient> n = random_direction(random);
    const auto site_at = [&](double radius_mm) {
      const Point<Patient> x = Point<Patient>() + n * radius_mm;
      return find_contact_site(model, x, sample_central_differences(*model.field, x), 4);
    };
    EXPECT_EQ(site_at(kBoneRadius_mm + 3.5).label, kCartilage) << "through fat, which is not felt";
    EXPECT_EQ(site_at(kBoneRadius_mm + 2).label, kCartilage);
    EXPECT_EQ(site_at(kBoneRadius_mm - 0.7).label, kBone);
    EXPECT_NEAR(site_at(kBoneRadius_mm + 3).depth_mm, 0, 0.12);
  }
}

TEST(ContactSite, FreeSpaceAndOutsideMeetNothing) {
  const Model model = ball_model();
  for (const Point<Patient>& x :
       {Point<Patient>(25, 0, 0), Point<Patient>(1e6, 0, 0), Point<Patient>(-1e300, 0, 0)}) {
    const ContactSite site = find_contact_site(model, x, sample_central_differences(*model.field, x), 6);
    EXPECT_EQ(site.label, 0);
    EXPECT_EQ(site.tissue, -1);
  }
}

TEST(ContactSite, DeepInsideTheTipsOwnLabelCounts) {
  const Model model = ball_model();
  const FieldSample sample = sample_central_differences(*model.field, Point<Patient>());
  ASSERT_EQ(sample.gradient.norm(), 0) << "the ramp has ended here";
  const ContactSite site = find_contact_site(model, Point<Patient>(), sample, 6);
  EXPECT_EQ(site.label, kBone);
  EXPECT_EQ(site.depth_mm, 6);
}

TEST(ContactSite, NotANumberMeetsNothing) {
  const Model model = ball_model();
  const Point<Patient> x(std::nan(""), 0, 0);
  EXPECT_EQ(find_contact_site(model, x, sample_central_differences(*model.field, x), 6).label, 0);
}

}  // namespace
}  // namespace palpate
