#include <gtest/gtest.h>

#include "base/test_seed.h"
#include "surfaces/test_surface_shapes.h"

/// Hand segmentation proceeds slice by slice, and widely spaced slices turn a slanted surface into a
/// staircase. Measures how the smoothing of the position reduces it, and how far it moves the surface.
namespace palpate {
namespace {

struct Quality {
  double direction_deg = 0, position_mm = 0;  ///< Root mean squares
};

/// Error of the position's gradient and zero level, along rays from inside, against a shape with known
/// outward normal and signed distance.
template <class Shape>
Quality measure(const Surface& s, const Shape& shape, std::mt19937& random) {
  Quality q;
  constexpr int kRays = 1500;
  for (int n = 0; n < kRays; ++n) {
    const Eigen::Vector3d on = shape.point(random), normal = shape.normal(on);
    const double t = test::crossing(s, on - 1.2 * normal, normal, 2.4) - 1.2;
    const Point<Patient> p(Eigen::Vector3d(on + t * normal));
    const Eigen::Vector3d gradient = sample_central_differences(s.distance_field(), p).gradient.eigen();
    q.direction_deg += std::pow(test::angle_deg(gradient, normal), 2) / kRays;
    q.position_mm += t * t / kRays;
  }
  return {std::sqrt(q.direction_deg), std::sqrt(q.position_mm)};
}

/// A half space whose surface is slanted through the centre of a grid.
struct Slope {
  Eigen::Vector3d middle, up, u, v;
  Eigen::Vector3d point(std::mt19937& random) const {
    std::uniform_real_distribution<double> within(-4, 4);
    return middle + within(random) * u + within(random) * v;
  }
  Eigen::Vector3d normal(const Eigen::Vector3d&) const { return up; }
};

/// A cylinder perpendicular to the slices' direction.
struct Rod {
  Eigen::Vector3d middle, axis;
  double radius;
  Eigen::Vector3d point(std::mt19937& random) const {
    const Eigen::Vector3d d = test::random_direction(random);
    std::uniform_real_distribution<double> within(-4, 4);
    return middle + within(random) * axis + radius * (d - d.dot(axis) * axis).normalized();
  }
  Eigen::Vector3d normal(const Eigen::Vector3d& p) const {
    const Eigen::Vector3d r = p - middle;
    return (r - r.dot(axis) * axis).normalized();
  }
};

PreparedSurface prepare_with(const Volume<LabelId>& labels, double sigma_mm) {
  return std::move(
      prepare_surfaces(*label_bricks(labels), {test::kTissue}, {.position_sigma_mm = sigma_mm})->front());
}

Surface smoothed(const Volume<LabelId>& labels) {
  return prepare_with(labels, SurfaceOptions{}.position_sigma_mm).surface;
}

/// Signed distance of the labels before smoothing.
Surface unsmoothed(const Volume<LabelId>& labels) {
  const PreparedSurface s = prepare_with(labels, 0);
  const SignedField distance(s.intermediates.distance.dense(), s.surface.distance_field().steps());
  return {distance, distance, 3};
}

GridGeometry stacked_grid() {
  return test::surface_grid({80, 80, 22}, {0.277, 0.277, 1.0});
}

TEST(SurfaceRepair, SlantedPlanesBecomeSmooth) {
  const auto seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> within(-0.5, 0.5);
  for (const double tilt_deg : {20.0, 35.0, 50.0, 70.0}) {
    Quality before, after;
    for (int n = 0; n < 2; ++n) {
      Slope slope;
      const double tilt = tilt_deg / 180 * 3.14159265, turn = 2 * 3.14159265 * within(random);
      slope.up = {std::sin(tilt) * std::cos(turn), std::sin(tilt) * std::sin(turn), std::cos(tilt)};
      slope.u = slope.up.unitOrthogonal();
      slope.v = slope.up.cross(slope.u);
      slope.middle = Eigen::Vector3d(11, 11, 10.5 + within(random));
      const auto labels = test::label_where(
          stacked_grid(), [&](const Eigen::Vector3d& p) { return (p - slope.middle).dot(slope.up) < 0; });
      const Quality raw = measure(unsmoothed(labels), slope, random);
      const Quality smooth = measure(smoothed(labels), slope, random);
      before.direction_deg += raw.direction_deg / 2;
      before.position_mm += raw.position_mm / 2;
      after.direction_deg += smooth.direction_deg / 2;
      after.position_mm += smooth.position_mm / 2;
    }
    std::printf("plane tilted %2.0f deg: direction %.2f -> %.2f deg rms, place %.3f -> %.3f mm rms\n",
                tilt_deg, before.direction_deg, after.direction_deg, before.position_mm, after.position_mm);
    EXPECT_LT(after.direction_deg, 0.5 * before.direction_deg);
    EXPECT_LT(after.position_mm, before.position_mm);
  }
}

TEST(SurfaceRepair, RodsBecomeSmooth) {
  std::mt19937 random(5);
  for (const double radius : {3.0, 6.0}) {
    const Rod rod{{11, 11, 10.6}, Eigen::Vector3d(0.7, 0.3, 0.65).normalized(), radius};
    const auto labels = test::label_where(stacked_grid(), [&](const Eigen::Vector3d& p) {
      const Eigen::Vector3d r = p - rod.middle;
      return (r - r.dot(rod.axis) * rod.axis).norm() < rod.radius;
    });
    const Quality before = measure(unsmoothed(labels), rod, random);
    const Quality after = measure(smoothed(labels), rod, random);
    std::printf("rod of %.0f mm: direction %.2f -> %.2f deg rms, place %.3f -> %.3f mm rms\n", radius,
                before.direction_deg, after.direction_deg, before.position_mm, after.position_mm);
    EXPECT_LT(after.direction_deg, 0.6 * before.direction_deg);
    // a thin rod becomes slightly thinner
    EXPECT_LT(after.position_mm, 0.1);
  }
}

// the labels' surface is midway between neighbours of different classes; the smoothed one lies between them
// too
TEST(SurfaceRepair, MovesTheSurfaceByLessThanHalfAVoxel) {
  std::mt19937 random(7);
  for (const double sigma_mm : {0.5, 1.0, 3.0}) {
    const test::RandomBall ball(4, {0.277, 0.277, 1.0}, random);
    auto labels = ball.labels;
    for (auto& v : labels.voxels()) v = random() % 50 == 0 ? (v == 0 ? test::kTissue : LabelId{0}) : v;
    const PreparedSurface s = prepare_with(labels, sigma_mm);
    const Volume<std::int16_t> position = s.surface.distance_field().bricks().dense();
    const GridGeometry& grid = position.geometry();
    double largest = 0;
    for (int k = 0; k + 1 < grid.dims[2]; ++k) {
      for (int j = 0; j + 1 < grid.dims[1]; ++j) {
        for (int i = 0; i + 1 < grid.dims[0]; ++i) {
          for (int a = 0; a < 3; ++a) {
            const double here = position.at(i, j, k),
                         next = position.at(i + (a == 0), j + (a == 1), k + (a == 2));
            const double d = s.intermediates.distance.at(i, j, k);
            const double e = s.intermediates.distance.at(i + (a == 0), j + (a == 1), k + (a == 2));
            ASSERT_EQ(here < 0, d < 0);
            if ((d < 0) != (e < 0)) largest = std::max(largest, std::abs(here / (here - next) - 0.5));
          }
        }
      }
    }
    EXPECT_LT(largest, 0.5);
  }
}

}  // namespace
}  // namespace palpate
