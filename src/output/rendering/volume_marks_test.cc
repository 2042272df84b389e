#include "palpate/rendering/volume_marks.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <random>
#include <vector>

#include "base/test_seed.h"

namespace palpate {
namespace {

VolumeCamera marks_camera(bool perspective) {
  VolumeCamera camera;
  camera.focus = Point<Patient>(3, -4, 5);
  const Vector<Patient> into = Vector<Patient>(1, 2, -0.5).normalized();
  camera.right = into.cross(Vector<Patient>(0, 0, 1)).normalized();
  camera.down = into.cross(camera.right);
  camera.width_mm = 60;
  camera.width_px = camera.height_px = 60;
  if (perspective) camera.eye_mm = 90;
  return camera;
}

/// Upper bound of the distance of a point from a mark, by sampling spheres along it.
double outside_mm(const VolumeMark& mark, const Point<Patient>& at) {
  double smallest = 1e9;
  for (int n = 0; n <= 60; ++n) {
    const double s = n / 60.0;
    const Point<Patient> centre = mark.from + (mark.to - mark.from) * s;
    smallest = std::min(smallest, (at - centre).norm() - (mark.from_mm + (mark.to_mm - mark.from_mm) * s));
  }
  return smallest;
}

TEST(VolumeMarks, AreWhereStepsAlongARayMeetThem) {
  const unsigned seed = test::test_seed();
  std::printf("seed %u\n", seed);
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> lateral(-22, 22), radius(0.5, 6);
  int covered = 0;
  for (int number = 0; number < 6; ++number) {
    const VolumeCamera camera = marks_camera(number % 2 == 1);
    const auto labels_at = [&] {
      const double x = lateral(random), y = lateral(random), z = lateral(random);
      return camera.focus + Vector<Patient>(x, y, z);
    };
    VolumeMark mark{labels_at(), labels_at(), radius(random), radius(random), {200, 200, 200}, 0};
    if (number % 5 == 4) mark.to = mark.from;
    Image image{60, 60, std::vector<std::uint8_t>(3 * 60 * 60, 0)};
    const std::vector<float> far(60 * 60, std::numeric_limits<float>::infinity());
    draw_volume_marks(image, far, camera, {&mark, 1});
    int wrong = 0;
    for (int row = 0; row < 60; row += 3)
      for (int column = 0; column < 60; column += 3) {
        const Point<Patient> through = camera.at(column, row),
                             eye = camera.focus - camera.into() * camera.eye_mm;
        const Point<Patient> from = camera.is_parallel() ? through - camera.into() * 100 : eye;
        const Vector<Patient> displacement =
            camera.is_parallel() ? camera.into() : (through - eye).normalized();
        double nearest = 1e9;
        for (double t = 0; t < 220; t += 0.5)
          nearest = std::min(nearest, outside_mm(mark, from + displacement * t));
        const bool drawn = image.rgb[3 * static_cast<std::size_t>(60 * row + column)] > 0;
        covered += drawn ? 1 : 0;
        // a pixel is 1 mm wide, and sampled spheres are smaller than the tangent cone
        if (nearest < -0.8 && !drawn) ++wrong;
        if (nearest > 1.6 && drawn) ++wrong;
      }
    EXPECT_EQ(wrong, 0) << number;
  }
  EXPECT_GT(covered, 30);
}

/// In perspective, an off-axis sphere projects to an ellipse that extends farther outwards than inwards.
TEST(VolumeMarks, AreCompleteInObliqueViews) {
  const unsigned seed = test::test_seed();
  std::printf("seed %u\n", seed);
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> lateral(-1, 1), part(0.2, 0.95);
  constexpr int kSide = 200;
  int covered = 0;
  for (int number = 0; number < 30; ++number) {
    VolumeCamera camera = marks_camera(true);
    camera.width_px = camera.height_px = kSide;
    camera.width_mm = 120;
    const Point<Patient> eye = camera.focus - camera.into() * camera.eye_mm;
    const double z = 40 + 40 * part(random), x = z * lateral(random), y = z * lateral(random);
    const double radius = 0.5 * z * part(random);
    const Point<Patient> centre = eye + camera.into() * z + camera.right * x + camera.down * y;
    const VolumeMark mark{centre, centre, radius, radius, {200, 200, 200}, 0};
    Image image{kSide, kSide, std::vector<std::uint8_t>(3 * kSide * kSide, 0)};
    draw_volume_marks(image, std::vector<float>(kSide * kSide, std::numeric_limits<float>::infinity()),
                      camera, {&mark, 1});
    int wrong = 0;
    for (int row = 0; row < kSide; ++row)
      for (int column = 0; column < kSide; ++column) {
        const Vector<Patient> displacement = (camera.at(column, row) - eye).normalized();
        const double beside = displacement.cross(centre - eye).norm();
        const bool drawn = image.rgb[3 * static_cast<std::size_t>(kSide * row + column)] > 0;
        covered += drawn ? 1 : 0;
        // ambiguous within a pixel of the rim
        const double pixel_mm = camera.mm_per_px() * std::hypot(x, y, z) / camera.eye_mm;
        if (beside < radius - pixel_mm && !drawn) ++wrong;
        if (beside > radius + pixel_mm && drawn) ++wrong;
      }
    EXPECT_EQ(wrong, 0) << number;
  }
  EXPECT_GT(covered, 10'000);
}

TEST(VolumeMarks, AreOpaqueInFrontAndFaintBehindSurfaces) {
  const VolumeCamera camera = marks_camera(false);
  const std::size_t middle = 3 * (60 * 30 + 30);
  const auto drawn = [&](double ball_mm, double other_mm, float surface_mm, double behind) {
    const auto at = [&](double mm) { return camera.focus + camera.into() * mm; };
    const std::vector<VolumeMark> marks{{at(ball_mm), at(ball_mm), 5, 5, {0, 200, 0}, behind},
                                        {at(other_mm), at(other_mm), 5, 5, {0, 0, 200}, behind}};
    Image image{60, 60, std::vector<std::uint8_t>(3 * 60 * 60, 100)};
    const std::vector<float> depth(60 * 60, surface_mm);
    draw_volume_marks(image, depth, camera, marks);
    return std::array{image.rgb[middle], image.rgb[middle + 1], image.rgb[middle + 2]};
  };
  using Pixel = std::array<std::uint8_t, 3>;
  // the surface, the first sphere, the second
  EXPECT_EQ(drawn(20, 30, 10, 0), (Pixel{100, 100, 100}));
  const Pixel first = drawn(0, 30, 10, 0), second = drawn(30, 0, 10, 0), faint = drawn(20, 30, 10, 0.5);
  EXPECT_LT(first[0], 5);
  EXPECT_GT(first[1], 190);
  EXPECT_GT(second[2], 190);
  EXPECT_LT(second[1], 5);
  EXPECT_NEAR(faint[1], 150, 3);
  EXPECT_NEAR(faint[0], 50, 3);
}

TEST(VolumeMarks, SkipNonFinitePoints) {
  const VolumeCamera camera = marks_camera(true);
  const double nan = std::numeric_limits<double>::quiet_NaN(), inf = std::numeric_limits<double>::infinity();
  std::vector<VolumeMark> marks;
  const std::vector<Point<Patient>> path{camera.focus, Point<Patient>(nan, 0, 0), Point<Patient>(inf, 0, 0),
                                         camera.focus + camera.right * 20};
  add_path(marks, path, 3, {255, 255, 255}, 0, camera);
  ASSERT_EQ(marks.size(), 1u);
  add_arrow(marks, camera.focus, {nan, 0, 0}, 1, {255, 0, 0});
  add_arrow(marks, camera.focus, {0, 0, 0}, 1, {255, 0, 0});
  EXPECT_EQ(marks.size(), 1u);
  add_arrow(marks, camera.focus, {0, 3, 0}, 1, {255, 0, 0});
  EXPECT_EQ(marks.size(), 3u);
  marks.push_back({Point<Patient>(nan, nan, nan), camera.focus, 1, 1, {255, 0, 0}, 0});
  // far away, behind the eye, around the eye
  const Point<Patient> eye = camera.focus - camera.into() * camera.eye_mm;
  marks.push_back({camera.focus + camera.right * 1e12, camera.focus, 1, 1, {255, 0, 0}, 0});
  marks.push_back({eye - camera.into() * 50, eye - camera.into() * 20, 4, 4, {255, 0, 0}, 0});
  marks.push_back({eye, eye, 4, 4, {255, 0, 0}, 0});
  Image image{60, 60, std::vector<std::uint8_t>(3 * 60 * 60, 0)};
  draw_volume_marks(image, std::vector<float>(60 * 60, 1000.0f), camera, marks);
  EXPECT_GT(image.rgb[3 * (60 * 30 + 30)], 50);
}

}  // namespace
}  // namespace palpate
