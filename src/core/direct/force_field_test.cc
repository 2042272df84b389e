#include <gtest/gtest.h>

#include <cmath>
#include <limits>
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
using testing::with_every_method;

constexpr unsigned kSeed = 20261120;

const Model& layered() {
  static const Model model = with_every_method(ball_model({0.6, 0.6, 0.9}, 1.0, 4, 0.5f));
  return model;
}

Point<Patient> random_point(std::mt19937& random, double reach_mm) {
  std::uniform_real_distribution<double> coordinate(-reach_mm, reach_mm);
  return {coordinate(random), coordinate(random), coordinate(random)};
}

// bone where x > 0
Model wall_model(const Eigen::Vector3d& spacing_mm, double sigma_mm) {
  Model model = ball_model(spacing_mm, sigma_mm);
  const GridGeometry& grid = model.labels->geometry();
  Volume<LabelId> labels(grid);
  Volume<std::uint16_t> field(grid);
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) {
        const double x = (X_PatientVoxel * Point<Voxel>(i, j, k)).x();
        labels.at(i, j, k) = x > 0 ? kBone : LabelId{0};
        field.at(i, j, k) = static_cast<std::uint16_t>(std::lround(65535 * testing::ramp(-x, sigma_mm)));
      }
  model.labels = label_bricks(labels);
  model.field = std::make_shared<const Field>(field);
  return with_every_method(std::move(model));
}

TEST(ForceMethods, AreFoundByName) {
  for (std::size_t n = 0; n < kForceMethods.size(); ++n) {
    EXPECT_EQ(index_of(kForceMethods[n].method), n) << "recordings hold the number";
    EXPECT_EQ(find_force_method(kForceMethods[n].name), kForceMethods[n].method);
    EXPECT_FALSE(kForceMethods[n].about.empty());
  }
  EXPECT_FALSE(find_force_method("proxies"));
  EXPECT_EQ(next_of(ForceMethod::kProxy), ForceMethod::kTrilinear);
}

TEST(ForceField, EvaluatesItsMethod) {
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  const Model& model = layered();
  const SplineField spline(*model.field);
  const StoredNormals normals = StoredNormals::from_ramp(
      std::get<Volume<std::uint16_t>>(model.field->storage()), model.method_settings.normals);
  for (int n = 0; n < 2000; ++n) {
    const Point<Patient> x = random_point(random, 32);
    const auto expect_same = [&](ForceMethod method, const FieldSample& expected) {
      const FieldSample sample = model.force_field(method).sample(x);
      EXPECT_EQ(sample.value, expected.value) << name_of(method);
      // rounding errors deep inside are removed
      const bool flat = expected.gradient.norm() < 1e-6;
      EXPECT_EQ(sample.gradient, flat ? Vector<Patient>() : expected.gradient) << name_of(method);
    };
    expect_same(ForceMethod::kTrilinear, sample_central_differences(*model.field, x));
    // negative overshoots of a spline and rounded coefficients count as 0
    const FieldSample smooth = sample_spline(spline, x);
    expect_same(ForceMethod::kSpline, smooth.value > spline.scale() ? smooth : FieldSample{});
    expect_same(ForceMethod::kStoredNormals, normals.sample(x));
  }
  for (const ForceMethodInfo& info : kDirectMethods)
    EXPECT_EQ(model.force_field(info.method).method(), info.method);
}

TEST(ForceField, NoMethodHasADirectionDeepInside) {
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  const Model model = with_every_method(ball_model({0.6, 0.6, 0.9}, 1.0));
  for (const ForceMethodInfo& info : kDirectMethods)
    for (int n = 0; n < 500; ++n) {
      const Point<Patient> x = random_point(random, 4);
      const FieldSample sample = model.force_field(info.method).sample(x);
      ASSERT_EQ(sample.gradient, Vector<Patient>()) << info.name;
      EXPECT_GT(sample.value, 0.9);
    }
}

// reference by definition: each tissue's own sphere times its level
template <class Sphere>
FieldSample weighted_sum(const Sphere& bone, const Sphere& cartilage, double cartilage_level,
                         const Point<Patient>& x) {
  const FieldSample hard = bone.sample_literal(x), soft = cartilage.sample_literal(x);
  return {hard.value + cartilage_level * soft.value, hard.gradient + soft.gradient * cartilage_level};
}

template <class Sphere>
void expect_sum_of_tissues(ForceMethod method, const Sphere& bone, const Sphere& cartilage, double level) {
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  const ForceField& field = layered().force_field(method);
  const auto& levelled = std::get<LevelledSphere<Sphere>>(field.source());
  EXPECT_EQ(levelled.parts().size(), 2u);
  for (int n = 0; n < 500; ++n) {
    const Point<Patient> x = random_point(random, 22);
    const FieldSample expected = weighted_sum(bone, cartilage, level, x);
    for (const FieldSample& sample : {field.sample(x), levelled.sample_literal(x)}) {
      ASSERT_NEAR(sample.value, expected.value, 3e-5);
      ASSERT_LT((sample.gradient - expected.gradient).norm(), 1e-4);
    }
  }
}

TEST(ForceField, SphereMethodsWeightTissuesByLevel) {
  const Model& model = layered();
  const LabelVoxels bone(model.labels, {kBone}), cartilage(model.labels, {kCartilage});
  expect_sum_of_tissues(ForceMethod::kGaussianSphere, *GaussianSphere::make(bone, 1.0),
                        *GaussianSphere::make(cartilage, 1.0), 0.5);
  expect_sum_of_tissues(ForceMethod::kSmoothSphere, *SmoothSphere::make(bone, 1.0),
                        *SmoothSphere::make(cartilage, 1.0), 0.5);
}

TEST(ForceField, CartilageHasItsOwnSurfaceAndOutwardForceAtEveryDepth) {
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  const double shell_mm = 4;
  for (const ForceMethodInfo& info : kDirectMethods) {
    SCOPED_TRACE(info.name);
    const ForceField& field = layered().force_field(info.method);
    for (int n = 0; n < 200; ++n) {
      const Vector<Patient> outward = random_direction(random);
      const auto value_at = [&](double radius_mm) {
        return field.sample(Point<Patient>() + outward * radius_mm).value;
      };
      EXPECT_NEAR(value_at(kBoneRadius_mm + shell_mm), 0.25, 0.12) << "half of its level at its surface";
      EXPECT_NEAR(value_at(kBoneRadius_mm + shell_mm / 2), 0.5, 0.12);
      EXPECT_NEAR(value_at(kBoneRadius_mm - 3.5), 1, 0.06) << "the published weights do not sum to 1";
      // wherever there is a gradient it has the same direction
      for (double radius_mm = kBoneRadius_mm - 0.5; radius_mm < kBoneRadius_mm + shell_mm + 0.5;
           radius_mm += 0.25) {
        const FieldSample sample = field.sample(Point<Patient>() + outward * radius_mm);
        if (info.method != ForceMethod::kStoredNormals && sample.gradient.norm() < 0.05) continue;
        EXPECT_GT(-sample.gradient.dot(outward), 0) << radius_mm;
      }
    }
  }
}

// maximum slope of the force across a flat wall, over a whole ramp
double steepest_N_per_mm(const ForceField& field, double step_mm) {
  double max_gradient = 0;
  const auto force_at = [&](double x) {
    return normal_force(field.sample({x, 0.1, 0.2}), field.full_force_N()).norm();
  };
  for (double x = -3; x < 3; x += step_mm / 2)
    max_gradient = std::max(max_gradient, (force_at(x + step_mm) - force_at(x)) / step_mm);
  return max_gradient;
}

TEST(ForceField, EveryMethodRendersTissueStiffnessOnAFlatSurface) {
  for (const Eigen::Vector3d& spacing_mm : {Eigen::Vector3d(0.3, 0.3, 0.9), Eigen::Vector3d(0.6, 0.6, 0.6)}) {
    const Model model = wall_model(spacing_mm, 1.0);
    const double stiffness = model.max_stiffness_N_per_mm();
    for (const ForceMethodInfo& info : kDirectMethods) {
      SCOPED_TRACE(info.name);
      // differences over one voxel, because the published methods have steps and cusps
      const double found = steepest_N_per_mm(model.force_field(info.method), spacing_mm.x());
      EXPECT_GT(found, 0.85 * stiffness);
      EXPECT_LT(found, 1.05 * stiffness);
    }
  }
}

TEST(ForceField, SphereWidthIsASettingOfTheMethod) {
  Model model = ball_model({0.6, 0.6, 0.9}, 1.0);
  model.method_settings.sphere_sigma_voxels = 2;
  const double stiffness = model.max_stiffness_N_per_mm();
  const auto full_N = [&](ForceMethod method) { return (*make_force_field(model, method))->full_force_N(); };
  const double sqrt_2_pi = std::sqrt(2 * M_PI);
  EXPECT_NEAR(full_N(ForceMethod::kTrilinear), stiffness * sqrt_2_pi, 1e-9);
  EXPECT_NEAR(full_N(ForceMethod::kGaussianSphere), stiffness * 2 * 0.6 * sqrt_2_pi, 1e-9);
  EXPECT_NEAR(full_N(ForceMethod::kSmoothSphere), stiffness * sqrt_2_pi, 1e-9);
  // at least four voxels wide: the slope is largest along the small spacing
  model.sigma_mm = 0;
  EXPECT_NEAR(full_N(ForceMethod::kSmoothSphere), stiffness * 2 * 0.6 / 3 * sqrt_2_pi, 1e-9);
}

TEST(ForceField, NonFinitePositionIsFreeSpace) {
  const double nan = std::numeric_limits<double>::quiet_NaN(), inf = std::numeric_limits<double>::infinity();
  for (const ForceMethodInfo& info : kDirectMethods)
    for (const Point<Patient>& x : {Point<Patient>(nan, 0, 0), Point<Patient>(0, inf, 0),
                                    Point<Patient>(1e300, -1e300, 0), Point<Patient>(500, 0, 0)}) {
      const FieldSample sample = layered().force_field(info.method).sample(x);
      EXPECT_EQ(sample.value, 0) << info.name;
      EXPECT_EQ(normal_force(sample, 1), Vector<Patient>()) << info.name;
    }
}

TEST(WithMethods, PreparesMissingMethodsAndSharesTheOthers) {
  const auto model = std::make_shared<const Model>(ball_model({1, 1, 1}));
  const std::array requested{ForceMethod::kTrilinear, ForceMethod::kSpline};
  const auto more = with_methods(model, requested);
  ASSERT_TRUE(more.ok());
  EXPECT_FALSE(model->has(ForceMethod::kSpline));
  EXPECT_TRUE((*more)->has(ForceMethod::kSpline));
  EXPECT_FALSE((*more)->has(ForceMethod::kStoredNormals));
  EXPECT_EQ((*more)->field, model->field);
  EXPECT_EQ((*more)->methods[0], model->methods[0]);
  EXPECT_EQ((*more)->content_hash, model->content_hash);
  EXPECT_EQ(*with_methods(*more, requested), *more) << "nothing to add";
  // an unprepared method falls back to the trilinear one
  EXPECT_EQ(model->force_field(ForceMethod::kSpline).method(), ForceMethod::kTrilinear);
}

TEST(WithMethods, RejectsTooWideSpheresAndStopsOnRequest) {
  Model wide = ball_model({1, 1, 1});
  wide.sigma_mm = 30;
  const std::array smooth{ForceMethod::kSmoothSphere};
  const auto refused = with_methods(std::make_shared<const Model>(wide), smooth);
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.error().kind, ErrorKind::kBadInput);
  EXPECT_EQ(check_force_field(wide, ForceMethod::kSmoothSphere).error().what, refused.error().what);
  EXPECT_TRUE(check_force_field(wide, ForceMethod::kGaussianSphere).ok());
  EXPECT_TRUE(check_force_field(wide, ForceMethod::kSpline).ok());
  EXPECT_GE(memory_of_force_field(wide, ForceMethod::kSpline), 8 * wide.labels->geometry().voxel_count());
  EXPECT_EQ(memory_of_force_field(wide, ForceMethod::kTrilinear), 0u);
  std::fill(wide.level_of_label.begin(), wide.level_of_label.end(), 0.f);
  EXPECT_FALSE(check_force_field(wide, ForceMethod::kGaussianSphere).ok()) << "nothing is felt";
  const std::atomic<bool> stop{true};
  const auto stopped =
      with_methods(std::make_shared<const Model>(ball_model({1, 1, 1})), smooth, Progress({}, &stop));
  ASSERT_FALSE(stopped.ok());
  EXPECT_EQ(stopped.error().kind, ErrorKind::kInterrupted);
}

}  // namespace
}  // namespace palpate
