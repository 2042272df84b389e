#include "palpate/contact/owners.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <map>
#include <random>
#include <string>

#include "base/test_seed.h"
#include "contact/test_proxy_surfaces.h"

namespace palpate {
namespace {

using testing::cube_grid;

// label 1 left of a plane, label 2 right of it, nothing above
Volume<LabelId> two_halves(const Eigen::Vector3d& spacing_mm) {
  Volume<LabelId> labels(cube_grid(9, spacing_mm));
  const auto X_PatientVoxel = labels.geometry().X_PatientVoxel();
  const auto& dims = labels.geometry().dims;
  for (int k = 0; k < dims[2]; ++k)
    for (int j = 0; j < dims[1]; ++j)
      for (int i = 0; i < dims[0]; ++i) {
        const Point<Patient> p = X_PatientVoxel * Point<Voxel>(i, j, k);
        if (p.z() < 0) labels.at(i, j, k) = p.x() < 0 ? 1 : 2;
      }
  return labels;
}

double part_of(const OwnerFractions& fractions, int structure) {
  for (const OwnerFraction& fraction : fractions.all())
    if (fraction.structure == structure) return fraction.fraction;
  return 0;
}

TEST(Owners, SharesVarySmoothlyAcrossBorders) {
  for (const Eigen::Vector3d& spacing_mm :
       {Eigen::Vector3d(0.36, 0.36, 0.7), Eigen::Vector3d(0.28, 0.28, 1)}) {
    const Owners owners(*label_bricks(two_halves(spacing_mm)), {-1, 0, 1});
    double before = 0, max_gradient = 0;
    for (double x = -4; x <= 4; x += 0.01) {
      const OwnerFractions fractions = owners.at(Point<Patient>(x, 0.4, -0.3));
      double all = 0;
      for (const OwnerFraction& fraction : fractions.all()) all += fraction.fraction;
      EXPECT_NEAR(all, 1, 1e-12);
      EXPECT_EQ(fractions.largest(), fractions.all()[0].structure);
      const double right = part_of(fractions, 1);
      EXPECT_GE(right, before - 1e-12) << x;
      if (x > -4) max_gradient = std::max(max_gradient, (right - before) / 0.01);
      before = right;
      // labels end half a voxel to the left of the first voxel centre on the right
      if (x < -Owners::kReach_mm - spacing_mm.x()) {
        EXPECT_EQ(right, 0) << x;
      }
      if (x > Owners::kReach_mm) {
        EXPECT_EQ(right, 1) << x;
      }
    }
    EXPECT_LT(max_gradient, 1.15 / Owners::kReach_mm);
    EXPECT_NEAR(part_of(owners.at(Point<Patient>(-0.5 * spacing_mm.x(), 0, -0.3)), 1), 0.5, 0.01);
  }
}

TEST(Owners, EqualTheSumOverAllOuterVoxels) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("PALPATE_TEST_SEED=" + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_int_distribution<int> any_label(0, 5), size(4, 24);
  std::uniform_real_distribution<double> part(-0.2, 1.2), spacing(0.25, 3.5);
  for (int round = 0; round < 12; ++round) {
    GridGeometry grid;
    for (int a = 0; a < 3; ++a) {
      grid.dims[static_cast<std::size_t>(a)] = size(random);
      grid.spacing_mm[a] = spacing(random);
    }
    grid.direction =
        Eigen::AngleAxisd(part(random), testing::random_direction(random).eigen()).toRotationMatrix();
    Volume<LabelId> labels(grid);
    // clusters, so that some blocks have a single owner; label 5 belongs to none
    for (int k = 0; k < grid.dims[2]; ++k)
      for (int j = 0; j < grid.dims[1]; ++j) {
        const auto clump = static_cast<LabelId>(any_label(random));
        for (int i = 0; i < grid.dims[0]; ++i)
          labels.at(i, j, k) = round % 2 ? clump : static_cast<LabelId>(i / 9);
      }
    labels.at(0, 0, 0) = 1;
    const std::vector<std::int16_t> structure_of_label{-1, 3, 0, 3, 7, -1};
    const Owners owners(*label_bricks(labels), structure_of_label);
    const double reach_mm = owners.reach_mm();
    EXPECT_EQ(reach_mm, std::max(Owners::kReach_mm, 1.5 * grid.spacing_mm.maxCoeff()));

    const auto X_PatientVoxel = grid.X_PatientVoxel();
    for (int n = 0; n < 60; ++n) {
      const Point<Voxel> at(part(random) * grid.dims[0], part(random) * grid.dims[1],
                            part(random) * grid.dims[2]);
      std::map<int, double> expected;
      double all = 0;
      for (int k = 0; k < grid.dims[2]; ++k)
        for (int j = 0; j < grid.dims[1]; ++j)
          for (int i = 0; i < grid.dims[0]; ++i) {
            const int structure = structure_of_label[labels.at(i, j, k)];
            const auto is_out = [&](int a, int b, int c) {
              return structure_of_label[labels.at_or(a, b, c, 0)] < 0;
            };
            const bool outer = is_out(i - 1, j, k) || is_out(i + 1, j, k) || is_out(i, j - 1, k) ||
                               is_out(i, j + 1, k) || is_out(i, j, k - 1) || is_out(i, j, k + 1);
            if (structure < 0 || !outer) continue;
            const double r_mm = (Eigen::Vector3d(i, j, k) - at.eigen()).cwiseProduct(grid.spacing_mm).norm();
            if (r_mm >= reach_mm) continue;
            const double left = 1 - r_mm * r_mm / (reach_mm * reach_mm);
            expected[structure] += left * left;
            all += left * left;
          }
      const OwnerFractions fractions = owners.at(X_PatientVoxel * at);
      if (all == 0) {
        ASSERT_EQ(fractions.all().size(), 1u) << "one of them";
        EXPECT_GE(fractions.largest(), 0);
        EXPECT_EQ(fractions.all()[0].fraction, 1);
        continue;
      }
      ASSERT_EQ(fractions.all().size(), expected.size()) << "round " << round << ", place " << n;
      for (const auto& [structure, weight] : expected)
        EXPECT_NEAR(part_of(fractions, structure), weight / all, 1e-5)
            << "round " << round << ", place " << n;
      for (std::size_t s = 1; s < fractions.all().size(); ++s)
        EXPECT_GE(fractions.all()[s - 1].fraction, fractions.all()[s].fraction);
    }
  }
}

// Repeated look-ups at few points, on two surfaces, before and after a cut, and after the labels changed.
TEST(Owners, CachedLookupEqualsFreshLookupAfterAnyChange) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("PALPATE_TEST_SEED=" + std::to_string(seed));
  std::mt19937 random(seed);
  const auto owners_of = [&](std::vector<std::int16_t> structure_of_label) {
    return std::make_shared<const Owners>(*label_bricks(two_halves({0.5, 0.5, 0.5})), structure_of_label);
  };
  const auto labels = label_bricks(two_halves({0.5, 0.5, 0.5}));
  // all of it lies half a voxel below the original surface
  const auto as_made =
      testing::make_contact_surface(labels->geometry(), [](const Eigen::Vector3d&) { return -2.0; }).surface;
  std::uniform_real_distribution<double> part(-3, 3);
  std::vector<Point<Patient>> positions;
  for (int n = 0; n < 6; ++n) positions.emplace_back(part(random), part(random), -0.3);
  std::array<ContactSurface, 3> surfaces;
  OwnerCache memo;
  int several = 0;
  for (int n = 0; n < 2000; ++n) {
    const auto any = static_cast<std::size_t>(random() % surfaces.size());
    ContactSurface& surface = surfaces[any];
    switch (random() % 20) {
      case 0:
        surface.owners = owners_of({-1, 0, 1});
        break;
      case 1:
        surface.owners = owners_of({-1, 1, 0});
        break;
      case 2:
        surface.owners = surfaces[0].owners;
        break;
      case 3:
        surface.owners = nullptr;
        break;
      case 4:
        surface.original_surface = surface.original_surface == nullptr ? as_made : nullptr;
        surface.original_labels = labels;
        break;
      default:
        break;
    }
    const Point<Patient>& position = positions[random() % positions.size()];
    const auto index = static_cast<int>(any);
    const OwnerFractions known = memo.at(surfaces, index, position),
                         fresh = owners_at(surfaces, index, position);
    ASSERT_EQ(known.all().size(), fresh.all().size()) << n;
    several += known.all().size() > 1;
    for (std::size_t s = 0; s < known.all().size(); ++s) {
      ASSERT_EQ(known.all()[s].structure, fresh.all()[s].structure) << n;
      ASSERT_EQ(known.all()[s].fraction, fresh.all()[s].fraction) << n;
    }
  }
  EXPECT_GT(several, 100);
}

TEST(Owners, StructureBelowAThinLayerHasNoShare) {
  Volume<LabelId> labels(cube_grid(6, {0.5, 0.5, 0.5}));
  const auto& dims = labels.geometry().dims;
  const int top = dims[2] / 2;
  for (int k = 0; k <= top; ++k)
    for (int j = 0; j < dims[1]; ++j)
      for (int i = 0; i < dims[0]; ++i) labels.at(i, j, k) = k < top ? 2 : 1;
  const OwnerFractions fractions =
      Owners(*label_bricks(labels), {-1, 0, 1}).at(Point<Patient>(0.1, 0.2, 0.25));
  ASSERT_EQ(fractions.all().size(), 1u);
  EXPECT_EQ(fractions.largest(), 0);
}

TEST(Owners, AtMostEightSharesAndOneFarFromAnyStructure) {
  GridGeometry grid = cube_grid(3, {1, 1, 1});
  Volume<LabelId> labels(grid);
  for (std::size_t v = 0; v < labels.voxels().size(); ++v)
    labels.voxels()[v] = static_cast<LabelId>(1 + v % 40);
  std::vector<std::int16_t> structure_of_label(41, -1);
  for (int label = 1; label <= 40; ++label)
    structure_of_label[static_cast<std::size_t>(label)] = static_cast<std::int16_t>(label + 1);
  const Owners owners(*label_bricks(labels), structure_of_label);
  const OwnerFractions many = owners.at(Point<Patient>(3, 3, 3));
  EXPECT_EQ(many.all().size(), OwnerFractions::kCapacity);
  double all = 0;
  for (const OwnerFraction& fraction : many.all()) all += fraction.fraction;
  EXPECT_NEAR(all, 1, 1e-12);
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  for (const Point<Patient>& nowhere :
       {Point<Patient>(100, 0, 0), Point<Patient>(0, -1e300, 0), Point<Patient>(0, 0, kNan)}) {
    const OwnerFractions one = owners.at(nowhere);
    ASSERT_EQ(one.all().size(), 1u);
    EXPECT_GE(one.largest(), 2);
  }
}

}  // namespace
}  // namespace palpate
