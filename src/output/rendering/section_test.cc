#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "palpate/rendering/rendering.h"

namespace palpate {
namespace {

constexpr double kPi = 3.14159265358979323846;

std::string letters(const SectionPlane& plane) {
  const OrientationLetters l = orientation_letters(plane);
  return l.left + " " + l.right + " " + l.top + " " + l.bottom;
}

/// Letters on picture right if `right` points in this anatomical direction.
std::string right_letters(const Vector<Patient>& direction) {
  SectionPlane plane;
  plane.right = direction.normalized();
  plane.down = Vector<Patient>(plane.right.cross(Vector<Patient>(0.3, -0.5, 0.8))).normalized();
  return orientation_letters(plane).right;
}

TEST(Section, AnatomicalViewsHangRadiologically) {
  const Point<Patient> centre(10, -20, 30);
  // axial from the feet, patient's left on picture right; in a sagittal view the face points to the left
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
    // a point off the plane is projected along the normal
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

// ---- oblique sections -----------------------------------------------------------------------------------

constexpr ObliqueView kViews[] = {ObliqueView::kAlong, ObliqueView::kAcross};

SectionPlane oblique(const Vector<Patient>& direction, ObliqueView view,
                     const SectionPlane* before = nullptr) {
  return oblique_section(Point<Patient>(1, 2, 3), direction, view, 80, 200, 100, before);
}

Vector<Patient> normal_of(const SectionPlane& plane) {
  return plane.right.cross(plane.down);
}

Vector<Patient> random_direction(std::mt19937& random) {
  std::normal_distribution<double> normal;
  const double x = normal(random), y = normal(random), z = normal(random);
  return Vector<Patient>(x, y, z).normalized();
}

/// Difference in orientation between two sections.
double turned(const SectionPlane& a, const SectionPlane& b) {
  return std::max(
      {(a.right - b.right).norm(), (a.down - b.down).norm(), (normal_of(a) - normal_of(b)).norm()});
}

std::vector<Vector<Patient>> awkward_directions() {
  std::vector<Vector<Patient>> directions;
  for (const double tiny : {0.0, 1e-20, 1e-12, 1e-9, 1e-6}) {
    for (int axis = 0; axis < 3; ++axis) {
      for (const double sign : {-1.0, 1.0}) {
        Vector<Patient> d(tiny, -tiny, tiny);
        d[axis] = sign;
        directions.push_back(d);
      }
    }
  }
  directions.emplace_back(1e-300, 2e-300, -1e-300);
  directions.emplace_back(1e300, 2e300, -1e300);
  return directions;
}

TEST(ObliqueSection, LiesAlongOrAcrossEveryDirection) {
  SCOPED_TRACE("seed 3");
  std::mt19937 random(3);
  auto directions = awkward_directions();
  for (int n = 0; n < 1000; ++n) directions.push_back(random_direction(random) * 7.0);
  const SectionPlane before = oblique(random_direction(random), ObliqueView::kAlong);
  for (const Vector<Patient>& direction : directions) {
    const Vector<Patient> d = (direction / direction.eigen().cwiseAbs().maxCoeff()).normalized();
    for (const ObliqueView view : kViews) {
      for (const SectionPlane* from : {static_cast<const SectionPlane*>(nullptr), &before}) {
        const SectionPlane plane = oblique(direction, view, from);
        EXPECT_NEAR(plane.right.norm(), 1, 1e-12);
        EXPECT_NEAR(plane.down.norm(), 1, 1e-12);
        EXPECT_NEAR(plane.right.dot(plane.down), 0, 1e-12);
        EXPECT_NEAR(((view == ObliqueView::kAlong ? plane.down : normal_of(plane)) - d).norm(), 0, 1e-12);
        EXPECT_EQ(plane.centre, Point<Patient>(1, 2, 3));
        EXPECT_EQ(plane.width_mm, 80);
        EXPECT_EQ(plane.width_px, 200);
        EXPECT_EQ(plane.height_px, 100);
      }
    }
  }
}

TEST(ObliqueSection, HangsAsTheAnatomicalViewsDo) {
  const auto across = [](double x, double y, double z) {
    return letters(oblique(Vector<Patient>(x, y, z), ObliqueView::kAcross));
  };
  EXPECT_EQ(across(0, 0, 1), letters(anatomical_section(AnatomicalPlane::kAxial, {}, 100, 64, 64)));
  EXPECT_EQ(across(0, 1, 0), letters(anatomical_section(AnatomicalPlane::kCoronal, {}, 100, 64, 64)));
  EXPECT_EQ(across(-1, 0, 0), letters(anatomical_section(AnatomicalPlane::kSagittal, {}, 100, 64, 64)));
  // from the head, and from the patient's right
  EXPECT_EQ(across(0, 0, -1), "R L P A");
  EXPECT_EQ(across(1, 0, 0), "P A S I");
  const auto along = [](double x, double y, double z) {
    return letters(oblique(Vector<Patient>(x, y, z), ObliqueView::kAlong));
  };
  EXPECT_EQ(along(0, 0, -1), "R L S I");
  EXPECT_EQ(along(0, 1, 0), "R L A P");
  EXPECT_EQ(along(0, -1, 0), "R L P A");
}

TEST(ObliqueSection, WithoutADirectionIsCoronalOrTheOneBefore) {
  const double nan = std::numeric_limits<double>::quiet_NaN(), inf = std::numeric_limits<double>::infinity();
  const SectionPlane before = oblique(Vector<Patient>(1, 2, 3), ObliqueView::kAlong);
  for (const ObliqueView view : kViews) {
    for (const double none : {0.0, nan, inf, -inf}) {
      EXPECT_EQ(letters(oblique(Vector<Patient>(none, 0, 0), view)), "R L S I");
      EXPECT_EQ(turned(oblique(Vector<Patient>(0, none, 0), view, &before), before), 0);
    }
  }
}

// rotating the direction rotates the picture by not much more, except near the direction opposite to the
// coronal one
TEST(ObliqueSection, DoesNotSpin) {
  constexpr double kStep = 1e-4;
  SCOPED_TRACE("seed 4");
  std::mt19937 random(4);
  for (int n = 0; n < 5000; ++n) {
    const Vector<Patient> d = random_direction(random);
    const Vector<Patient> moved = (d + d.cross(random_direction(random)).normalized() * kStep).normalized();
    for (const ObliqueView view : kViews) {
      const Vector<Patient> opposite =
          view == ObliqueView::kAlong ? Vector<Patient>(0, 0, 1) : Vector<Patient>(0, -1, 0);
      const double angle = std::acos(d.dot(opposite));
      if (angle < 20 * kPi / 180) continue;
      // rotation about the direction itself that the direction's own rotation induces
      EXPECT_LT(turned(oblique(d, view), oblique(moved, view)), (1 + 2 / std::tan(0.5 * angle)) * kStep) << n;
    }
  }
}

// with the previous section given, no direction is singular
TEST(ObliqueSection, FollowsADirectionAnywhere) {
  for (const ObliqueView view : kViews) {
    // through the opposite direction, exactly and nearby
    for (const double off : {0.0, 1e-6, 1e-3, 0.1}) {
      SectionPlane plane = oblique(Vector<Patient>(0, 1, -1), view);
      for (int n = 0; n <= 360; ++n) {
        const double angle = n * kPi / 180;
        const Vector<Patient> d(off, std::cos(angle), -std::sin(angle));
        const SectionPlane next = oblique(d, view, &plane);
        if (n > 0) {
          EXPECT_LT(turned(plane, next), 1.01 * kPi / 180) << n;
        }
        plane = next;
      }
    }
  }
}

}  // namespace
}  // namespace palpate
