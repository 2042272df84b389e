#include "volume_io/dicom_structures.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <string>
#include <utility>

#include "base/test_seed.h"

namespace palpate::volume_io {
namespace {

using ::testing::HasSubstr;
using V3 = Eigen::Vector3d;
using Contour3 = std::vector<V3>;
using FlatContour = std::vector<Eigen::Vector2d>;
using Inside = std::function<bool(const V3&)>;

Eigen::Matrix3d turned(double degrees, const V3& axis) {
  return Eigen::AngleAxisd(degrees * std::numbers::pi / 180, axis.normalized()).toRotationMatrix();
}

// around the patient's origin
GridGeometry grid_of(const std::array<int, 3>& dims, const V3& spacing_mm, const Eigen::Matrix3d& direction) {
  GridGeometry grid;
  grid.dims = dims;
  grid.spacing_mm = spacing_mm;
  grid.direction = direction;
  const V3 middle = 0.5 * spacing_mm.cwiseProduct(V3(dims[0] - 1, dims[1] - 1, dims[2] - 1));
  grid.origin = Point<Patient>(V3(-(direction * middle)));
  return grid;
}

std::vector<char> mask_of_planes(const StructurePlanes& planes, const GridGeometry& grid) {
  std::vector<char> mask(grid.voxel_count());
  const std::size_t slice = static_cast<std::size_t>(grid.dims[0]) * static_cast<std::size_t>(grid.dims[1]);
  for (int k = 0; k < grid.dims[2]; ++k)
    planes.read_slice(k, [&](std::size_t v) {
      EXPECT_EQ(mask[static_cast<std::size_t>(k) * slice + v], 0) << "once";
      mask[static_cast<std::size_t>(k) * slice + v] = 1;
    });
  return mask;
}

std::vector<char> mask_of_shape(const Inside& inside, const GridGeometry& grid) {
  std::vector<char> mask;
  const auto X = grid.X_PatientVoxel();
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) mask.push_back(inside((X * Point<Voxel>(i, j, k)).eigen()));
  return mask;
}

StructurePlanes laid(const std::vector<Contour3>& contours, const GridGeometry& grid) {
  DicomStructure structure;
  structure.segment.number = 1;
  structure.contours = contours;
  auto planes = StructurePlanes::make(structure, grid);
  if (!planes) ADD_FAILURE() << planes.error().message();
  return *std::move(planes);
}

// how a mask compares with a shape: by its voxels, and by the shape's own volume
struct Likeness {
  double dice = 0, volume = 0, centroid_voxels = 0;
};
Likeness likeness(const std::vector<char>& mask, const Inside& inside, double volume_mm3,
                  const GridGeometry& grid) {
  const auto expected = mask_of_shape(inside, grid);
  double both = 0, sum = 0, count = 0;
  V3 centre = V3::Zero();
  for (std::size_t v = 0; v < mask.size(); ++v) {
    both += mask[v] && expected[v];
    sum += mask[v] + expected[v];
    if (!mask[v]) continue;
    const auto i = static_cast<int>(v), row = grid.dims[0], plane = row * grid.dims[1];
    centre += V3(i % row, i % plane / row, i / plane);
    ++count;
  }
  // the shapes lie around the grid's middle
  const V3 middle = 0.5 * V3(grid.dims[0] - 1, grid.dims[1] - 1, grid.dims[2] - 1);
  return {2 * both / sum, count * grid.spacing_mm.prod() / volume_mm3, (centre / count - middle).norm()};
}

// contours in planes along the third column of R, each made by `cut` in its plane's own coordinates
template <class Cut>
std::vector<Contour3> contours_in_planes(const Eigen::Matrix3d& R, double gap_mm, double shift_mm,
                                         double reach_mm, const Cut& cut) {
  std::vector<Contour3> contours;
  const int most = static_cast<int>(std::ceil(reach_mm / gap_mm)) + 1;
  for (int n = -most; n <= most; ++n) {
    const double place = n * gap_mm + shift_mm;
    for (const FlatContour& flat : cut(place)) {
      Contour3& contour = contours.emplace_back();
      for (const auto& point : flat) contour.push_back(R * V3(point.x(), point.y(), place));
    }
  }
  std::erase_if(contours, [](const Contour3& contour) { return contour.size() < 3; });
  return contours;
}

FlatContour circle(double radius) {
  FlatContour points;
  constexpr int kCorners = 240;
  for (int n = 0; n < kCorners && radius > 0; ++n) {
    const double angle = 2 * std::numbers::pi * n / kCorners;
    points.emplace_back(radius * std::cos(angle), radius * std::sin(angle));
  }
  return points;
}

double half_chord(double radius, double off) {
  return std::sqrt(std::max(0.0, radius * radius - off * off));
}

// a grid whose slices the contours lie in, then one that they are oblique to
struct Lay {
  GridGeometry grid;
  Eigen::Matrix3d R;  // of the contours' planes
  double gap_mm, shift_mm;
};
std::vector<Lay> lays() {
  const Eigen::Matrix3d direction = turned(33, V3(1, 2, -1)), oblique = turned(40, V3(2, -1, 1));
  const auto thick = grid_of({84, 86, 41}, V3(0.8, 0.8, 1.6), direction);
  const auto even = grid_of({66, 64, 68}, V3(1, 1, 1), direction);
  // slices lie at whole steps from the middle one
  return {{thick, direction, 1.6, 0},
          {even, oblique, 1, 0.3},
          {even, turned(90, V3(0, 1, 0)) * direction, 1, 0.21}};
}

TEST(DicomStructures, ASphereInObliquePlanes) {
  constexpr double kRadius = 24;
  for (const Lay& lay : lays()) {
    const auto contours = contours_in_planes(lay.R, lay.gap_mm, lay.shift_mm, kRadius, [&](double place) {
      return std::vector<FlatContour>{circle(half_chord(kRadius, place))};
    });
    const auto like = likeness(
        mask_of_planes(laid(contours, lay.grid), lay.grid), [&](const V3& p) { return p.norm() <= kRadius; },
        4.0 / 3 * std::numbers::pi * std::pow(kRadius, 3), lay.grid);
    EXPECT_GE(like.dice, 0.98);
    EXPECT_NEAR(like.volume, 1, 0.01);
    EXPECT_LT(like.centroid_voxels, 0.1);
  }
}

TEST(DicomStructures, ATorusInObliquePlanes) {
  constexpr double kRing = 19, kTube = 9;
  for (const Lay& lay : lays()) {
    const auto contours = contours_in_planes(lay.R, lay.gap_mm, lay.shift_mm, kTube, [&](double place) {
      const double chord = half_chord(kTube, place);
      return chord > 0 ? std::vector<FlatContour>{circle(kRing + chord), circle(kRing - chord)}
                       : std::vector<FlatContour>();
    });
    const auto like = likeness(
        mask_of_planes(laid(contours, lay.grid), lay.grid),
        [&](const V3& p) {
          const V3 own = lay.R.transpose() * p;
          return std::hypot(std::hypot(own.x(), own.y()) - kRing, own.z()) <= kTube;
        },
        2 * std::pow(std::numbers::pi * kTube, 2) * kRing, lay.grid);
    EXPECT_GE(like.dice, 0.98);
    EXPECT_NEAR(like.volume, 1, 0.01);
    EXPECT_LT(like.centroid_voxels, 0.1);
  }
}

// where a plane cuts a box with these half edges, turned by R
FlatContour cut_of_box(const V3& half, const Eigen::Matrix3d& R, double place) {
  FlatContour points;
  for (int axis = 0; axis < 3; ++axis)
    for (int corner = 0; corner < 4; ++corner) {
      V3 a;
      a[axis] = -half[axis];
      a[(axis + 1) % 3] = corner & 1 ? half[(axis + 1) % 3] : -half[(axis + 1) % 3];
      a[(axis + 2) % 3] = corner & 2 ? half[(axis + 2) % 3] : -half[(axis + 2) % 3];
      V3 b = a;
      b[axis] = half[axis];
      a = R * a;
      b = R * b;
      if ((a.z() <= place) == (b.z() <= place)) continue;
      const V3 p = a + (place - a.z()) / (b.z() - a.z()) * (b - a);
      points.emplace_back(p.x(), p.y());
    }
  Eigen::Vector2d middle = Eigen::Vector2d::Zero();
  for (const auto& point : points) middle += point / static_cast<double>(points.size());
  std::ranges::sort(points, {},
                    [&](const auto& p) { return std::atan2(p.y() - middle.y(), p.x() - middle.x()); });
  return points;
}

TEST(DicomStructures, APlateInObliquePlanes) {
  const V3 half(22, 18, 5);
  // stands nearly upright in the contours' planes
  const Eigen::Matrix3d stands = turned(68, V3(1, 0.4, 0.1));
  for (const Lay& lay : lays()) {
    const auto contours = contours_in_planes(lay.R, lay.gap_mm, lay.shift_mm, 30, [&](double place) {
      return std::vector<FlatContour>{cut_of_box(half, stands, place)};
    });
    const auto like = likeness(
        mask_of_planes(laid(contours, lay.grid), lay.grid),
        [&](const V3& p) {
          const V3 own = stands.transpose() * (lay.R.transpose() * p);
          return (own.cwiseAbs() - half).maxCoeff() <= 0;
        },
        8 * half.prod(), lay.grid);
    EXPECT_GE(like.dice, 0.98);
    EXPECT_NEAR(like.volume, 1, 0.01);
    EXPECT_LT(like.centroid_voxels, 0.1);
  }
}

// ---- against an oracle --------------------------------------------------------------------------

// how far a point is from the nearest contour of its plane and from the nearest boundary of two planes, and
// whether it is in: by the plane whose place is nearest, and by the sum of angles around it
struct Told {
  bool in = false;
  double margin_mm = 1e9;
};
Told told_slowly(const std::vector<Contour3>& contours, const V3& normal, double gap_mm, const V3& p) {
  double nearest = 1e9, second = 1e9;
  for (const Contour3& contour : contours) {
    const double off = std::abs((p - contour.front()).dot(normal));
    if (off < nearest - 1e-6)
      second = std::exchange(nearest, off);
    else if (off > nearest + 1e-6)
      second = std::min(second, off);
  }
  Told told;
  told.margin_mm = std::min((second - nearest) / 2, std::abs(gap_mm / 2 - nearest));
  if (nearest > gap_mm / 2) return told;
  for (const Contour3& contour : contours) {
    if (std::abs((p - contour.front()).dot(normal)) > nearest + 1e-6) continue;
    const V3 flat = p - (p - contour.front()).dot(normal) * normal;
    double angle = 0;
    for (std::size_t n = 0; n < contour.size(); ++n) {
      const V3 a = contour[n] - flat, b = contour[(n + 1) % contour.size()] - flat;
      angle += std::atan2(normal.dot(a.cross(b)), a.dot(b));
      const V3 edge = b - a;
      const double along = std::clamp(-a.dot(edge) / edge.squaredNorm(), 0.0, 1.0);
      told.margin_mm = std::min(told.margin_mm, (a + along * edge).norm());
    }
    if (std::lround(angle / (2 * std::numbers::pi)) % 2 != 0) told.in = !told.in;
  }
  return told;
}

TEST(DicomStructures, AreWhatTheOracleSays) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> any(-1, 1);
  std::size_t compared = 0, in = 0;
  for (int round = 0; round < 12; ++round) {
    const auto vector = [&] { return V3(any(random), any(random), any(random)); };
    const Eigen::Matrix3d direction = turned(180 * any(random), vector());
    // in the scan's slices, nearly in them, across them or anyhow
    const Eigen::Matrix3d R = round % 4 == 0   ? direction
                              : round % 4 == 1 ? Eigen::Matrix3d(turned(1, vector()) * direction)
                              : round % 4 == 2 ? Eigen::Matrix3d(direction * turned(90, V3(1, 0, 0)))
                                               : turned(180 * any(random), vector());
    const double gap_mm = 1.5 + any(random);
    const auto grid = grid_of({17, 15, 14}, V3(1 + 0.3 * any(random), 1 + 0.3 * any(random), 1.4), direction);
    // stars, a third of which have another one inside or across
    const auto contours = contours_in_planes(R, gap_mm, any(random), 6, [&](double) {
      std::vector<FlatContour> stars(random() % 3 == 0 ? 2 : 1);
      for (auto& star : stars)
        for (int n = 0; n < 9; ++n) {
          const double angle = 2 * std::numbers::pi * n / 9, radius = 4 + 2.5 * any(random);
          star.emplace_back(radius * std::cos(angle) + any(random) / 9, radius * std::sin(angle));
        }
      return stars;
    });
    const auto mask = mask_of_planes(laid(contours, grid), grid);
    const auto X = grid.X_PatientVoxel();
    for (std::size_t v = 0; v < mask.size(); ++v) {
      const auto i = static_cast<int>(v), row = grid.dims[0], plane = row * grid.dims[1];
      const V3 p = (X * Point<Voxel>(i % row, i % plane / row, i / plane)).eigen();
      const Told told = told_slowly(contours, R.col(2), gap_mm, p);
      if (told.margin_mm < 0.02) continue;
      ++compared;
      in += told.in;
      ASSERT_EQ(mask[v] != 0, told.in) << "round " << round << ", voxel " << v;
    }
  }
  EXPECT_GT(compared, 30'000u);
  EXPECT_GT(in, 3'000u);
}

// ---- contours as programs draw them --------------------------------------------------------------

const GridGeometry kSmall = grid_of({11, 11, 9}, V3(1, 1, 2), Eigen::Matrix3d::Identity());

Contour3 rectangle(double left, double right, double low, double high, double place) {
  return {{left, low, place}, {right, low, place}, {right, high, place}, {left, high, place}};
}
std::size_t count_in(const std::vector<Contour3>& contours) {
  const auto mask = mask_of_planes(laid(contours, kSmall), kSmall);
  return static_cast<std::size_t>(std::ranges::count(mask, 1));
}

TEST(DicomStructures, AHoleIsAContourWithinAnotherOrAKeyhole) {
  EXPECT_EQ(count_in({rectangle(-3.5, 3.5, -3.5, 3.5, 0)}), 49u);
  EXPECT_EQ(count_in({rectangle(-3.5, 3.5, -3.5, 3.5, 0), rectangle(-1.5, 1.5, -1.5, 1.5, 0)}), 40u);
  // out and back along one line, which goes through centres
  Contour3 keyhole = rectangle(-3.5, 3.5, -3.5, 3.5, 0);
  keyhole.insert(keyhole.end(), {{-3.5, 0, 0},
                                 {-1.5, 0, 0},
                                 {-1.5, 1.5, 0},
                                 {1.5, 1.5, 0},
                                 {1.5, -1.5, 0},
                                 {-1.5, -1.5, 0},
                                 {-1.5, 0, 0},
                                 {-3.5, 0, 0}});
  EXPECT_EQ(count_in({keyhole}), 40u);
  // an island in the hole
  EXPECT_EQ(count_in({rectangle(-3.5, 3.5, -3.5, 3.5, 0), rectangle(-1.5, 1.5, -1.5, 1.5, 0),
                      rectangle(-0.5, 0.5, -0.5, 0.5, 0)}),
            41u);
  // one that stands there twice is no hole of its own
  EXPECT_EQ(count_in({rectangle(-3.5, 3.5, -3.5, 3.5, 0), rectangle(-3.5, 3.5, -3.5, 3.5, 0)}), 49u);
}

TEST(DicomStructures, ACentreOnAContourIsIn) {
  EXPECT_EQ(count_in({rectangle(-3, 3, -3, 3, 0)}), 49u);
  EXPECT_EQ(count_in({{{-3, 0, 0}, {0, 3, 0}, {3, 0, 0}, {0, -3, 0}}}), 25u);
}

TEST(DicomStructures, PlanesThatAreMissedAreBridgedAndPartsAreNot) {
  const auto at = [](const std::vector<int>& slices) {
    std::vector<Contour3> contours;
    for (const int slice : slices) contours.push_back(rectangle(-1.5, 1.5, -1.5, 1.5, 2 * slice));
    return contours;
  };
  EXPECT_EQ(count_in(at({-3, -2, -1, 0, 1})), 45u);
  // in any order, one missing
  EXPECT_EQ(count_in(at({1, -3, -1, -2})), 45u);
  EXPECT_EQ(laid(at({1, -3, -1, -2}), kSmall).bridged(), 1u);
  EXPECT_EQ(laid(at({-3, -2, -1, 0}), kSmall).bridged(), 0u);
  // a part of its own
  EXPECT_EQ(count_in(at({-4, -3, 3, 4})), 36u);
  EXPECT_EQ(count_in(at({-4, 4})), 18u);
  // a single one is a slice
  EXPECT_EQ(count_in(at({0})), 9u);
  // a position's last digits
  auto rounded = at({-2, -1, 0, 1});
  for (std::size_t n = 0; n < rounded.size(); ++n)
    for (V3& point : rounded[n]) point.z() += n % 2 ? 0.008 : -0.009;
  EXPECT_EQ(count_in(rounded), 36u);
}

TEST(DicomStructures, WhatGoesBeyondTheScanIsCutOffAndTold) {
  EXPECT_FALSE(laid({rectangle(-3, 3, -3, 3, 0)}, kSmall).is_cut());
  EXPECT_TRUE(laid({rectangle(-3, 30, -3, 3, 0)}, kSmall).is_cut());
  EXPECT_EQ(count_in({rectangle(-3, 30, -3, 3, 0)}), 63u);
  EXPECT_EQ(count_in({rectangle(20, 30, -3, 3, 0)}), 0u);
  EXPECT_EQ(count_in({rectangle(-3, 3, -3, 3, 40)}), 0u);
}

TEST(DicomStructures, WhatIsNotPlanarIsRefused) {
  DicomStructure structure;
  structure.segment.number = 7;
  structure.contours = {rectangle(-3, 3, -3, 3, 0), rectangle(-3, 3, -3, 3, 2)};
  structure.contours[1][2].z() += 1.5;
  auto planes = StructurePlanes::make(structure, kSmall);
  ASSERT_FALSE(planes);
  EXPECT_THAT(planes.error().what, HasSubstr("of segment 7 is not planar"));
  // one across the others
  structure.contours[1] = {{0, -3, -3}, {0, 3, -3}, {0, 3, 3}, {0, -3, 3}};
  planes = StructurePlanes::make(structure, kSmall);
  ASSERT_FALSE(planes);
  EXPECT_THAT(planes.error().what, HasSubstr("in another plane than the others"));
}

}  // namespace
}  // namespace palpate::volume_io
