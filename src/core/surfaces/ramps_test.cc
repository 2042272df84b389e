#include "palpate/surfaces/ramps.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <limits>
#include <queue>

#include "base/test_seed.h"
#include "palpate/preparation/preparation.h"
#include "palpate/sampling/sampling.h"
#include "sampling/test_targets.h"
#include "surfaces/test_surface_shapes.h"

namespace palpate {
namespace {

using test::kTissue;

constexpr LabelId kBoneLabel = kTissue, kCartilageLabel = 3, kMeniscusLabel = 4, kOther = 9;
constexpr double kBone_N_per_mm = 1.5, kCartilage_N_per_mm = 0.9, kMeniscus_N_per_mm = 0.6;
const Eigen::Vector3d kSlices(0.277, 0.277, 1.0);
const std::array<Eigen::Vector3d, 2> kClinical{kSlices, Eigen::Vector3d(0.6, 0.6, 0.9)};

// bone, cartilage on it, meniscus on both, and a structure that rests on nothing
std::vector<RampStructure> knee() {
  return {{kBoneLabel, kBone_N_per_mm, {}},
          {kCartilageLabel, kCartilage_N_per_mm, {kBoneLabel}},
          {kMeniscusLabel, kMeniscus_N_per_mm, {kBoneLabel, kCartilageLabel}},
          {kOther, kCartilage_N_per_mm, {}}};
}

Ramps prepared(const Volume<LabelId>& labels, const std::vector<RampStructure>& structures = knee(),
               const RampOptions& options = {}) {
  auto ramps = prepare_ramps(*label_bricks(labels), structures, options);
  EXPECT_TRUE(ramps.ok()) << (ramps.ok() ? "" : ramps.error().message());
  return *std::move(ramps);
}

double force_N(const Ramps& ramps, int i, int j, int k) {
  return ramps.full_force_N * ramps.field.at(i, j, k) / 65535;
}

void expect_nothing_outside_and_something_inside(const Volume<LabelId>& labels, const Ramps& ramps) {
  const std::vector<std::uint16_t> field = ramps.field.dense().voxels();
  std::size_t outside = 0, inside = 0;
  for (std::size_t v = 0; v < labels.voxels().size(); ++v) {
    outside += labels.voxels()[v] == 0 && field[v] != 0 ? 1 : 0;
    inside += labels.voxels()[v] != 0 && field[v] == 0 ? 1 : 0;
  }
  EXPECT_EQ(outside, 0u);
  EXPECT_EQ(inside, 0u);
}

// labels by the height of a voxel's centre above a plane through the centre of the grid
Volume<LabelId> layers(const GridGeometry& grid, const Eigen::Vector3d& up,
                       const std::function<LabelId(double height_mm)>& label_at) {
  Volume<LabelId> labels(grid);
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i)
        labels.at(i, j, k) = label_at(
            (grid.X_PatientVoxel() * Point<Voxel>(i, j, k) - grid.centre()).dot(Vector<Patient>(up)));
  return labels;
}

GridGeometry cube(const Eigen::Vector3d& spacing_mm, double side_mm) {
  std::array<int, 3> dims;
  for (int a = 0; a < 3; ++a) dims[a] = static_cast<int>(side_mm / spacing_mm[a]) | 1;
  return test::surface_grid(dims, spacing_mm);
}

// ---- directions

// the same ball surrounded by air, which the union Gaussian needs
struct BallCase {
  BallCase(double radius_mm, const Eigen::Vector3d& spacing_mm, std::mt19937& random) {
    const test::RandomBall tight(radius_mm, spacing_mm, random);
    GridGeometry grid = tight.labels.geometry();
    std::array<int, 3> air;
    centre = tight.centre;
    for (int a = 0; a < 3; ++a) {
      air[a] = static_cast<int>(7 / spacing_mm[a]);
      grid.dims[a] += 2 * air[a];
      centre[a] += air[a] * spacing_mm[a];
    }
    labels = Volume<LabelId>(grid);
    for (int k = 0; k < grid.dims[2]; ++k)
      for (int j = 0; j < grid.dims[1]; ++j)
        for (int i = 0; i < grid.dims[0]; ++i)
          labels.at(i, j, k) = tight.labels.at_or(i - air[0], j - air[1], k - air[2], 0);
  }
  Volume<LabelId> labels;
  Eigen::Vector3d centre;
};

Field union_gaussian(const Volume<LabelId>& labels) {
  Volume<std::uint8_t> weights(labels.geometry());
  for (std::size_t v = 0; v < weights.voxels().size(); ++v)
    weights.voxels()[v] = labels.voxels()[v] != 0 ? 255 : 0;
  return Field(*gaussian_smooth_16(weights, {.sigma_mm = 1.5}));
}

TEST(Ramps, OnBallsPointOutward) {
  const auto seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  constexpr std::array kDepth_mm{0.3, 0.5, 1.0, 1.5, 2.0};
  for (const Eigen::Vector3d& spacing : kClinical) {
    for (const double radius_mm : {5.0, 10.0, 20.0}) {
      std::array<std::vector<double>, kDepth_mm.size()> ramp_deg, gaussian_deg, contact_mm;
      // the same number of rays per radius: larger balls need fewer instances
      const int balls = radius_mm < 10 ? 20 : radius_mm < 20 ? 8 : 4;
      for (int n = 0; n < balls; ++n) {
        const BallCase ball(radius_mm, spacing, random);
        const Ramps ramps = prepared(ball.labels, {{kBoneLabel, 1, {}}});
        expect_nothing_outside_and_something_inside(ball.labels, ramps);
        const Field ramp(ramps.field), gaussian = union_gaussian(ball.labels);
        for (int ray = 0; ray < 6000 / balls; ++ray) {
          const Eigen::Vector3d d = test::random_direction(random);
          for (std::size_t t = 0; t < kDepth_mm.size(); ++t) {
            const Point<Patient> x(ball.centre + (radius_mm - kDepth_mm[t]) * d);
            const FieldSample sample = sample_central_differences(ramp, x);
            ramp_deg[t].push_back(test::angle_deg(-sample.gradient.eigen(), d));
            contact_mm[t].push_back(sample.value * ramps.full_force_N);
            gaussian_deg[t].push_back(
                test::angle_deg(-sample_central_differences(gaussian, x).gradient.eigen(), d));
          }
        }
      }
      std::printf("spacing %.3f %.3f r %2.0f:", spacing[0], spacing[2], radius_mm);
      for (std::size_t t = 0; t < kDepth_mm.size(); ++t) {
        const test::Spread ramp(ramp_deg[t]), gaussian(gaussian_deg[t]), rendered(contact_mm[t]);
        std::printf(" | %.1f mm: %.2f %.2f (%.2f %.2f), felt %.2f", kDepth_mm[t], ramp.mean, ramp.at(0.99),
                    gaussian.mean, gaussian.at(0.99), rendered.mean);
        // near the surface the differences include voxels that must be 0
        EXPECT_LE(ramp.mean, kDepth_mm[t] < 1 ? 6 : 3) << kDepth_mm[t];
        EXPECT_LE(ramp.at(0.99), kDepth_mm[t] < 1 ? 18 : 14) << kDepth_mm[t];
        EXPECT_NEAR(rendered.mean, kDepth_mm[t], 0.15) << "a sphere keeps its size";
      }
      std::printf("\n");
    }
  }
}

// ---- slopes and thin tissue

TEST(Ramps, RiseWithTheStiffnessAndEndAtTheWidth) {
  const auto seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  for (const Eigen::Vector3d& spacing : kClinical) {
    std::vector<Eigen::Vector3d> ups{Eigen::Vector3d::UnitX(), Eigen::Vector3d::UnitZ()};
    for (int n = 0; n < 6; ++n) ups.push_back(test::random_direction(random));
    for (const Eigen::Vector3d& up : ups) {
      SCOPED_TRACE(testing::Message() << spacing.transpose() << " up " << up.transpose());
      const GridGeometry grid = cube(spacing, 30);
      const auto labels = layers(grid, up, [](double h) { return h < 0 ? kBoneLabel : LabelId{0}; });
      const Ramps ramps = prepared(labels);
      EXPECT_DOUBLE_EQ(ramps.full_force_N, kBone_N_per_mm * 4);
      const Field field(ramps.field);
      const auto rendered_N = [&](double depth_mm) {
        return ramps.full_force_N * sample_value(field, grid.centre() - Vector<Patient>(depth_mm * up));
      };
      const double begin_mm = up.cwiseAbs().dot(spacing) + 0.5;
      const double slope = (rendered_N(3.2) - rendered_N(begin_mm)) / (3.2 - begin_mm);
      std::printf("spacing %.3f %.3f up %+.2f %+.2f %+.2f: %.3f N/mm, %.2f N at 1 mm\n", spacing[0],
                  spacing[2], up[0], up[1], up[2], slope, rendered_N(1));
      // a surface almost parallel to planes of voxels moves by up to half a voxel towards them with depth
      const bool parallel = up.cwiseAbs().maxCoeff() > 0.95;
      EXPECT_GT(slope, 0.93 * kBone_N_per_mm);
      EXPECT_LT(slope, (parallel ? 1.2 : 1.05) * kBone_N_per_mm);
      EXPECT_EQ(rendered_N(6), ramps.full_force_N);
    }
  }
}

TEST(Ramps, PlatesOfOneAndTwoVoxelsPushToBothSides) {
  for (const Eigen::Vector3d& spacing : kClinical) {
    for (int axis = 0; axis < 3; ++axis) {
      for (const int thick : {1, 2}) {
        SCOPED_TRACE(testing::Message() << spacing.transpose() << " axis " << axis << " thick " << thick);
        const GridGeometry grid = cube(spacing, 14);
        Volume<LabelId> labels(grid);
        const int first = grid.dims[axis] / 2;
        for (int k = 0; k < grid.dims[2]; ++k)
          for (int j = 0; j < grid.dims[1]; ++j)
            for (int i = 0; i < grid.dims[0]; ++i) {
              const int at = std::array{i, j, k}[axis];
              if (at >= first && at < first + thick) labels.at(i, j, k) = kBoneLabel;
            }
        const Ramps ramps = prepared(labels);
        expect_nothing_outside_and_something_inside(labels, ramps);
        const Field field(ramps.field);
        Point<Voxel> centre(grid.dims[0] / 2, grid.dims[1] / 2, grid.dims[2] / 2);
        centre[axis] = first + 0.5 * (thick - 1);
        for (const double side : {-1.0, 1.0}) {
          Point<Voxel> p = centre;
          p[axis] += side * 0.25 * thick;
          const FieldSample sample = sample_central_differences(field, grid.X_PatientVoxel() * p);
          EXPECT_GT(ramps.full_force_N * sample.value, 0.05);
          EXPECT_GT(-side * sample.gradient.normalized()[axis], 0.99);
        }
        EXPECT_LE(ramps.structures[0].max_N, kBone_N_per_mm * thick * spacing[axis] + 1e-3);
        EXPECT_GT(ramps.structures[0].max_N, 0.25 * kBone_N_per_mm * thick * spacing[axis]);
        EXPECT_NEAR(ramps.structures[0].half_thickness_mm, spacing[axis], 0.03);
      }
    }
  }
}

// ---- adjacent and supporting structures

TEST(Ramps, LeaveTheNarrowestGapFree) {
  const GridGeometry grid = cube(kSlices, 24);
  const auto labels = layers(grid, Eigen::Vector3d::UnitX(), [](double h) {
    return std::abs(h) < 0.2 ? LabelId{0} : h < 0 ? kBoneLabel : kOther;
  });
  const Ramps ramps = prepared(labels);
  expect_nothing_outside_and_something_inside(labels, ramps);
  EXPECT_EQ(ramps.field.at(grid.dims[0] / 2, 40, 12), 0);
}

TEST(Ramps, TouchingStructuresMeetInAValley) {
  const GridGeometry grid = cube(kSlices, 24);
  const auto labels =
      layers(grid, Eigen::Vector3d::UnitX(), [](double h) { return h < -0.1 ? kBoneLabel : kOther; });
  // two bones of the same tissue
  const Ramps ramps = prepared(labels, {{kBoneLabel, 1, {}}, {kOther, 1, {}}});
  const int border = grid.dims[0] / 2;
  EXPECT_LT(force_N(ramps, border - 1, 40, 12), 0.3);
  EXPECT_LT(force_N(ramps, border, 40, 12), 0.3);
  EXPECT_GT(force_N(ramps, border - 10, 40, 12), 2.5);
  EXPECT_GT(force_N(ramps, border + 9, 40, 12), 2.5);
}

TEST(Ramps, CartilageOnBoneIsContinuousAcrossTheBorder) {
  for (const Eigen::Vector3d& spacing : kClinical) {
    for (const Eigen::Vector3d& up :
         {Eigen::Vector3d(1, 0, 0), Eigen::Vector3d(0, 0, 1), Eigen::Vector3d(0.6, 0, 0.8)}) {
      SCOPED_TRACE(testing::Message() << spacing.transpose() << " up " << up.transpose());
      const GridGeometry grid = cube(spacing, 32);
      constexpr double kThick_mm = 1.5;
      const auto labels = layers(grid, up, [](double h) {
        return h > kThick_mm ? LabelId{0} : h > 0 ? kCartilageLabel : kBoneLabel;
      });
      const Ramps ramps = prepared(labels, knee(), {.width_mm = 6});
      expect_nothing_outside_and_something_inside(labels, ramps);
      const Field field(ramps.field);
      const auto sample = [&](double depth_mm) {
        return sample_central_differences(field,
                                          grid.centre() + Vector<Patient>((kThick_mm - depth_mm) * up));
      };
      const double voxel_mm = up.cwiseAbs().dot(spacing);
      double before = sample(0.3).value;
      for (double depth_mm = 0.4; depth_mm < 3.8; depth_mm += 0.1) {
        const FieldSample here = sample(depth_mm);
        EXPECT_GE(here.value, before) << depth_mm;
        EXPECT_LE(ramps.full_force_N * (here.value - before), kBone_N_per_mm * 0.3) << depth_mm;
        EXPECT_GT(-here.gradient.normalized().dot(Vector<Patient>(up)), 0.9) << depth_mm;
        before = here.value;
      }
      // above the interface the slope is that of the upper structure, below it that of bone
      const double at_border_N = ramps.full_force_N * sample(kThick_mm).value;
      EXPECT_NEAR(at_border_N, kCartilage_N_per_mm * kThick_mm, kBone_N_per_mm * voxel_mm);
      const double bone_slope = ramps.full_force_N * (sample(4.5).value - sample(3).value) / 1.5;
      EXPECT_NEAR(bone_slope, kBone_N_per_mm, 0.15 * kBone_N_per_mm);
    }
  }
}

TEST(Ramps, ThreeSupportedStructuresAddUp) {
  const GridGeometry grid = cube({0.5, 0.5, 0.5}, 30);
  const auto labels = layers(grid, Eigen::Vector3d::UnitZ(), [](double h) {
    return h > 3.7 ? LabelId{0} : h > 1.7 ? kMeniscusLabel : h > -0.2 ? kCartilageLabel : kBoneLabel;
  });
  const Ramps ramps = prepared(labels);
  const int middle = grid.dims[2] / 2;
  double before = 0;
  for (int k = middle + 7; k > middle - 3; --k) {
    EXPECT_GT(force_N(ramps, 30, 30, k), before) << k;
    before = force_N(ramps, 30, 30, k);
  }
  // meniscus 2 mm, cartilage 2 mm, and 1 mm of bone
  EXPECT_NEAR(before, 2 * (0.6 + 0.9) + 1.5, 0.5);
}

TEST(Ramps, BoneNextToCartilageStartsAtItsBareSurface) {
  // cartilage covers one half of the bone
  const GridGeometry grid = cube({0.5, 0.5, 0.5}, 30);
  Volume<LabelId> labels(grid);
  const int top = grid.dims[2] / 2;
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i)
        labels.at(i, j, k) = k < top                               ? kBoneLabel
                             : k < top + 5 && i < grid.dims[0] / 2 ? kCartilageLabel
                                                                   : LabelId{0};
  const Ramps ramps = prepared(labels);
  EXPECT_NEAR(force_N(ramps, 48, 30, top - 4), kBone_N_per_mm * 2, 0.5);
  EXPECT_NEAR(force_N(ramps, 12, 30, top - 4), kBone_N_per_mm * 2 + kCartilage_N_per_mm * 2.5, 0.6);
  // no step along the way
  for (int i = 12; i < 48; ++i)
    EXPECT_LE(std::abs(force_N(ramps, i + 1, 30, top - 4) - force_N(ramps, i, 30, top - 4)),
              1.05 * kBone_N_per_mm * 0.5);
}

// minimum over paths between voxel centres, from free space to a structure, of length times stiffness
std::vector<double> min_over_paths(const Volume<LabelId>& labels, const std::array<LabelId, 2>& passable,
                                   const std::array<double, 2>& stiffness) {
  const GridGeometry& grid = labels.geometry();
  const auto stiffness_at = [&](std::size_t v) {
    const LabelId label = labels.voxels()[v];
    return label == passable[0] ? stiffness[0] : label == passable[1] ? stiffness[1] : 0.0;
  };
  std::vector<double> cost(labels.voxels().size(), std::numeric_limits<double>::infinity());
  using Entry = std::pair<double, std::size_t>;
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> open;
  for (std::size_t v = 0; v < cost.size(); ++v)
    if (stiffness_at(v) == 0) open.push({cost[v] = 0, v});
  while (!open.empty()) {
    const auto [here, v] = open.top();
    open.pop();
    if (here > cost[v]) continue;
    const auto row = v / static_cast<std::size_t>(grid.dims[0]);
    const std::array<int, 3> at{static_cast<int>(v % static_cast<std::size_t>(grid.dims[0])),
                                static_cast<int>(row % static_cast<std::size_t>(grid.dims[1])),
                                static_cast<int>(row / static_cast<std::size_t>(grid.dims[1]))};
    for (int n = 0; n < 27; ++n) {
      const std::array<int, 3> step{n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1};
      bool known = true;
      Eigen::Vector3d displacement;
      for (int a = 0; a < 3; ++a) {
        known = known && at[a] + step[a] >= 0 && at[a] + step[a] < grid.dims[a];
        displacement[a] = step[a] * grid.spacing_mm[a];
      }
      if (!known) continue;
      const std::size_t next = grid.offset(at[0] + step[0], at[1] + step[1], at[2] + step[2]);
      const double there = here + displacement.norm() * std::max(stiffness_at(v), stiffness_at(next));
      if (there < cost[next]) open.push({cost[next] = there, next});
    }
  }
  return cost;
}

TEST(Ramps, EqualTheMinimumOverPathsFromFreeSpace) {
  const auto seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  for (int round = 0; round < 6; ++round) {
    const GridGeometry grid = test::surface_grid({30, 28, 18}, {0.4, 0.5, 0.8});
    Volume<LabelId> labels(grid);
    std::uniform_real_distribution<double> within(4, 9);
    // random lumps, later ones over earlier ones
    for (const LabelId label :
         {kBoneLabel, kCartilageLabel, kBoneLabel, kCartilageLabel, kOther, LabelId{0}}) {
      const Eigen::Vector3d centre(within(random), within(random), within(random));
      const double radius = label == 0 || label == kOther ? 1.5 : 4;
      for (int k = 0; k < 18; ++k)
        for (int j = 0; j < 28; ++j)
          for (int i = 0; i < 30; ++i)
            if ((Eigen::Vector3d(0.4 * i, 0.5 * j, 0.8 * k) - centre).norm() < radius)
              labels.at(i, j, k) = label;
    }
    const Ramps ramps = prepared(labels);
    const auto most =
        min_over_paths(labels, {kBoneLabel, kCartilageLabel}, {kBone_N_per_mm, kCartilage_N_per_mm});
    const std::vector<std::uint16_t> field = ramps.field.dense().voxels();
    for (std::size_t v = 0; v < most.size(); ++v) {
      if (labels.voxels()[v] != kBoneLabel && labels.voxels()[v] != kCartilageLabel) continue;
      EXPECT_LE(ramps.full_force_N * field[v] / 65535, most[v] + 1e-3);
    }
  }
}

// ---- determinism, and errors

Volume<LabelId> lumps(std::mt19937& random) {
  Volume<LabelId> labels(test::surface_grid({50, 40, 60}, {0.5, 0.6, 0.7}));
  for (LabelId& v : labels.voxels()) v = random() % 60 == 0 ? kOther : LabelId{0};
  for (int k = 5; k < 55; ++k)
    for (int j = 5; j < 35; ++j)
      for (int i = 5; i < 45; ++i)
        labels.at(i, j, k) = i + k / 3 < 25 ? kBoneLabel : i + k / 3 < 29 ? kCartilageLabel : kMeniscusLabel;
  return labels;
}

TEST(Ramps, AreBitIdenticalForAnyThreadsTargetAndGridDirection) {
  std::mt19937 random(5);
  Volume<LabelId> labels = lumps(random);
  const Ramps one = prepared(labels, knee(), {.threads = 1});
  for (const int threads : {2, 3, 8})
    EXPECT_TRUE(prepared(labels, knee(), {.threads = threads}).field.dense().voxels() ==
                one.field.dense().voxels());
  for (const std::int64_t target : test::all_targets()) {
    SCOPED_TRACE(test::target_name(target));
    const test::OnlyTargets only(target);
    EXPECT_TRUE(prepared(labels).field.dense().voxels() == one.field.dense().voxels());
  }
  GridGeometry turned = labels.geometry();
  turned.direction << 0.6, -0.8, 0, 0.8, 0.6, 0, 0, 0, -1;
  const Volume<LabelId> oblique = [&] {
    Volume<LabelId> copy(turned);
    copy.voxels() = labels.voxels();
    return copy;
  }();
  EXPECT_TRUE(prepared(oblique).field.dense().voxels() == one.field.dense().voxels());
}

TEST(Ramps, EightBitsPreserveTheForce) {
  Volume<std::uint16_t> ramp(test::surface_grid({4, 1, 1}, {1, 1, 1}));
  ramp.voxels() = {0, 1, 30000, 65535};
  EXPECT_EQ(in_eight_bits(Bricks<std::uint16_t>(ramp, 0)).dense().voxels(),
            (std::vector<std::uint8_t>{0, 1, 117, 255}));
}

TEST(Ramps, InvalidInputIsAnError) {
  std::mt19937 random(6);
  const Volume<LabelId> labels = lumps(random);
  const auto error_of = [&](const std::vector<RampStructure>& structures, const RampOptions& options) {
    const auto ramps = prepare_ramps(*label_bricks(labels), structures, options);
    return ramps.ok() ? std::string() : ramps.error().message();
  };
  EXPECT_NE(error_of(knee(), {.width_mm = 0.9}).find("0.9 mm"), std::string::npos);
  EXPECT_NE(error_of(knee(), {.width_mm = std::nan("")}), "");
  EXPECT_NE(error_of(knee(), {.threads = -1}), "");
  EXPECT_NE(error_of({{0, 1, {}}}, {}), "");
  EXPECT_NE(error_of({{kBoneLabel, 0, {}}}, {}), "");
  EXPECT_NE(error_of({{kCartilageLabel, 1, {kBoneLabel}}}, {}), "");
  EXPECT_NE(error_of({{kCartilageLabel, 2, {kBoneLabel}}, {kBoneLabel, 1, {}}}, {}).find("stiffer"),
            std::string::npos);

  const std::atomic<bool> stop{true};
  const auto stopped = prepare_ramps(*label_bricks(labels), knee(), {}, Progress({}, &stop));
  ASSERT_FALSE(stopped.ok());
  EXPECT_EQ(stopped.error().kind, ErrorKind::kInterrupted);
}

GridGeometry grid_with_voxels(double x, double y, double z) {
  GridGeometry grid;
  grid.dims = {10, 10, 10};
  grid.spacing_mm = {x, y, z};
  return grid;
}

TEST(RampWidth, CoversTwoOfTheWidestVoxels) {
  EXPECT_EQ(*ramp_width_mm({}, grid_with_voxels(0.3, 0.3, 1)), 4);
  EXPECT_EQ(*ramp_width_mm({}, grid_with_voxels(1, 1, 3)), 6);
  EXPECT_EQ(*ramp_width_mm(2, grid_with_voxels(0.3, 0.3, 1)), 2);
  const auto narrow = ramp_width_mm(1.5, grid_with_voxels(0.3, 0.3, 1));
  ASSERT_FALSE(narrow.ok());
  EXPECT_EQ(narrow.error().what, "the ramp width is 1.5 mm, and voxels are up to 1 mm wide");
  EXPECT_NE(narrow.error().remedy.find("2 mm"), std::string::npos);
  EXPECT_EQ(*ramp_width_mm({}, grid_with_voxels(1, 1, 10)), kMaxRampWidth_mm);
  const auto coarse = ramp_width_mm(12, grid_with_voxels(7, 7, 7));
  ASSERT_FALSE(coarse.ok());
  EXPECT_NE(coarse.error().remedy.find("union-gaussian"), std::string::npos);
}

}  // namespace
}  // namespace palpate
