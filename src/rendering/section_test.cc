#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "palpate/rendering.h"

namespace palpate {
namespace {

constexpr double kPi = 3.14159265358979323846;

std::string letters(const SectionPlane& plane) {
  const OrientationLetters l = orientation_letters(plane);
  return l.left + " " + l.right + " " + l.top + " " + l.bottom;
}

/// The letters on picture right when `right` points to this patient direction.
std::string right_letters(const Vector<Patient>& direction) {
  SectionPlane plane;
  plane.right = direction.normalized();
  plane.down = Vector<Patient>(plane.right.cross(Vector<Patient>(0.3, -0.5, 0.8))).normalized();
  return orientation_letters(plane).right;
}

TEST(Section, AnatomicalViewsHangRadiologically) {
  const Point<Patient> centre(10, -20, 30);
  // axial from the feet, patient's left on picture right; the face of a sagittal looks left
  EXPECT_EQ(letters(anatomical_section(AnatomicalPlane::kAxial, centre, 100, 64, 64)), "R L A P");
  EXPECT_EQ(letters(anatomical_section(AnatomicalPlane::kCoronal, centre, 100, 64, 64)), "R L S I");
  EXPECT_EQ(letters(anatomical_section(AnatomicalPlane::kSagittal, centre, 100, 64, 64)), "A P S I");
}

TEST(Section, ObliqueDirectionsNameTheNearestAxisFirst) {
  const auto turned = [](double degrees) {
    return Vector<Patient>(std::cos(degrees * kPi / 180), -std::sin(degrees * kPi / 180), 0);
  };
  EXPECT_EQ(right_letters(turned(0)), "L");
  EXPECT_EQ(right_letters(turned(19.9)), "L");
  EXPECT_EQ(right_letters(turned(20.1)), "LA");
  EXPECT_EQ(right_letters(turned(44)), "LA");
  EXPECT_EQ(right_letters(turned(46)), "AL");
  EXPECT_EQ(right_letters(turned(71)), "A");
  EXPECT_EQ(right_letters(turned(140)), "RA");
  EXPECT_EQ(right_letters(Vector<Patient>(-1, 0.9, -0.8)), "RPI");
  EXPECT_EQ(right_letters(Vector<Patient>(0.1, 0.5, 1)), "SP");
}

TEST(Section, OppositeEdgesCarryOppositeLetters) {
  const auto opposite = [](const std::string& text) {
    const std::string from = "LRAPSI", to = "RLPAIS";
    std::string result;
    for (const char letter : text) result += to[from.find(letter)];
    return result;
  };
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  for (int i = 0; i < 500; ++i) {
    SectionPlane plane;
    plane.right = Vector<Patient>(normal(random), normal(random), normal(random)).normalized();
    const Vector<Patient> other(normal(random), normal(random), normal(random));
    plane.down = plane.right.cross(other).normalized();
    const OrientationLetters l = orientation_letters(plane);
    EXPECT_EQ(l.left, opposite(l.right));
    EXPECT_EQ(l.top, opposite(l.bottom));
    ASSERT_GE(l.right.size(), 1u);
    ASSERT_LE(l.right.size(), 3u);
  }
}

TEST(Section, PixelOfInvertsAt) {
  std::mt19937 random(11);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (int i = 0; i < 200; ++i) {
    SectionPlane plane;
    plane.centre = Point<Patient>(100 * uniform(random), 100 * uniform(random), 100 * uniform(random));
    plane.right = Vector<Patient>(uniform(random), uniform(random), uniform(random)).normalized();
    plane.down = plane.right.cross(Vector<Patient>(uniform(random), 1.5, uniform(random))).normalized();
    plane.width_mm = 80;
    plane.width_px = 321;
    plane.height_px = 200;
    const double column = 400 * uniform(random), row = 300 * uniform(random);
    const auto pixel = plane.pixel_of(plane.at(column, row));
    EXPECT_NEAR(pixel[0], column, 1e-9);
    EXPECT_NEAR(pixel[1], row, 1e-9);
    // what stands off the plane is projected along its normal
    const Vector<Patient> normal = plane.right.cross(plane.down);
    const auto projected = plane.pixel_of(plane.at(column, row) + normal * 17.0);
    EXPECT_NEAR(projected[0], column, 1e-9);
    EXPECT_NEAR(projected[1], row, 1e-9);
  }
}

TEST(Section, CentreIsInTheMiddleAndWidthSpansThePicture) {
  const Point<Patient> centre(1, 2, 3);
  const SectionPlane plane = anatomical_section(AnatomicalPlane::kAxial, centre, 50, 100, 60);
  EXPECT_NEAR((plane.at(49.5, 29.5) - centre).norm(), 0, 1e-12);
  // from the left edge of the first pixel to the right edge of the last
  EXPECT_NEAR((plane.at(99.5, 0) - plane.at(-0.5, 0)).norm(), 50, 1e-12);
  // square pixels
  EXPECT_NEAR((plane.at(0, 59.5) - plane.at(0, -0.5)).norm(), 30, 1e-12);
}

}  // namespace
}  // namespace palpate
