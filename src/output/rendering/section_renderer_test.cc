#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <limits>
#include <random>

#include "palpate/rendering/rendering.h"
#include "rendering/test_section_oracle.h"
#include "sampling/test_targets.h"

// allocations are counted by wrapping operator new, which the sanitizers replace themselves
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define PALPATE_COUNTS_ALLOCATIONS
namespace {
std::atomic<long> allocations{0};
}
extern "C" {
void* __libc_malloc(size_t size);
void* malloc(size_t size) {
  ++allocations;
  return __libc_malloc(size);
}
}
#endif

namespace palpate {
namespace {

using testing::oracle_blend;
using testing::oracle_section;
using testing::OraclePixel;

constexpr SectionStorage kStorages[] = {SectionStorage::kModel, SectionStorage::kBricks};
const std::vector<Rgb> kColours{{10, 200, 30}, {220, 40, 30}, {20, 60, 230}, {250, 250, 10}, {90, 0, 120}};

enum class Values { kWhole, kReal, kHoles };

/// Random values in every voxel, so that mistaken voxels are detected.
Model noise_model(const GridGeometry& grid, Values values, int max_label, std::mt19937& random) {
  std::uniform_real_distribution<float> real(-3, 5);
  const float nan = std::numeric_limits<float>::quiet_NaN(), inf = std::numeric_limits<float>::infinity();
  Volume<float> scan(grid);
  for (float& voxel : scan.voxels()) {
    voxel = values == Values::kWhole ? static_cast<float>(static_cast<int>(random() % 4000) - 1000)
                                     : real(random);
    if (values == Values::kHoles && random() % 20 == 0)
      voxel = random() % 3 == 0 ? nan : random() % 2 == 0 ? inf : -inf;
  }
  Volume<LabelId> labels(grid);
  for (LabelId& voxel : labels.voxels()) voxel = static_cast<LabelId>(random() % (max_label + 1));
  Model model;
  model.scan = std::make_shared<const Volume<float>>(std::move(scan));
  model.labels = label_bricks(labels);
  for (int label = 1; label <= max_label; ++label)
    model.segments.push_back(
        {static_cast<LabelId>(label), "", kColours[label % kColours.size()], 0, static_cast<LabelId>(label)});
  return model;
}

GridGeometry random_grid(std::mt19937& random) {
  const auto size = [&] {
    return random() % 4 == 0 ? 1 + static_cast<int>(random() % 3) : 5 + static_cast<int>(random() % 30);
  };
  const std::array<int, 3> dims{size(), size(), size()};
  GridGeometry grid = test::make_grid(dims, static_cast<int>(random() % 4));
  // random permutation of the axes
  if (random() % 2 == 0) {
    const Eigen::Matrix3d direction = grid.direction;
    grid.direction << direction.col(2), direction.col(0), direction.col(1);
  }
  return grid;
}

/// Plane through or beside the volume, at a random angle and scale.
SectionPlane random_plane(const GridGeometry& grid, std::mt19937& random) {
  std::uniform_real_distribution<double> part(-0.2, 1.2), size(0.1, 3);
  std::normal_distribution<double> normal;
  const auto direction = [&] {
    const double x = normal(random), y = normal(random), z = normal(random);
    return Vector<Patient>(x, y, z).normalized();
  };
  SectionPlane plane;
  const double i = part(random), j = part(random), k = part(random);
  plane.centre = grid.X_PatientVoxel() * Point<Voxel>(i * grid.dims[0], j * grid.dims[1], k * grid.dims[2]);
  plane.right = direction();
  plane.down = plane.right.cross(direction()).normalized();
  // including planes along the grid's axes
  if (random() % 4 == 0) {
    plane.right = Vector<Patient>(Eigen::Vector3d(grid.direction.col(random() % 3)));
    plane.down = plane.right.cross(Vector<Patient>(0.3, -0.5, 0.8)).normalized();
  }
  plane.width_mm = size(random) * grid.dims[0] * grid.spacing_mm[0];
  plane.width_px = 1 + static_cast<int>(random() % 150);
  plane.height_px = 1 + static_cast<int>(random() % 90);
  return plane;
}

SectionStyle style_for(Values values) {
  return values == Values::kWhole ? SectionStyle{-800, 2800, 0.4, true, 256}
                                  : SectionStyle{-2, 4, 0.4, true, 256};
}

struct Rendered {
  std::vector<std::uint8_t> rgb, scan, overlay;
  std::vector<LabelId> labels;
  bool operator==(const Rendered&) const = default;
};

Rendered render(SectionRenderer& renderer, const SectionPlane& plane) {
  const std::size_t pixels = static_cast<std::size_t>(plane.width_px) * plane.height_px;
  Rendered all{std::vector<std::uint8_t>(3 * pixels), std::vector<std::uint8_t>(3 * pixels),
               std::vector<std::uint8_t>(4 * pixels), std::vector<LabelId>(pixels)};
  renderer.render(plane, all.rgb);
  renderer.render_scan(plane, all.scan);
  renderer.render_structures(plane, all.overlay);
  renderer.labels(plane, all.labels);
  return all;
}

/// @param tolerance  in grey levels, beyond rounding
void expect_like_oracle(const std::vector<OraclePixel>& oracle, const Rendered& rendered,
                        const SectionPlane& plane, const SectionStyle& style, double tolerance) {
  for (std::size_t n = 0; n < oracle.size(); ++n) {
    const std::string where =
        "column " + std::to_string(n % plane.width_px) + ", row " + std::to_string(n / plane.width_px);
    if (!oracle[n].near_tie) {
      ASSERT_EQ(rendered.labels[n], oracle[n].label) << where;
    }
    const double grey = rendered.scan[3 * n];
    if (!oracle[n].value) {
      ASSERT_EQ(grey, 14) << where;
      continue;
    }
    const double level = 255 * (*oracle[n].value - style.window_low) / (style.window_high - style.window_low);
    ASSERT_NEAR(grey, std::clamp(level, 0.0, 255.0), 0.5 + tolerance) << where;
  }
  ASSERT_EQ(rendered.rgb, oracle_blend(rendered.scan, rendered.labels, plane, kColours, style));
}

class SectionTargets : public ::testing::TestWithParam<Values> {};

// random planes through random grids, on every SIMD target, in both storage layouts
TEST_P(SectionTargets, AgreeWithTheOracleAndEachOther) {
#ifdef __SANITIZE_ADDRESS__
  constexpr unsigned kTrials = 40;
#else
  constexpr unsigned kTrials = 250;
#endif
  const SectionStyle style = style_for(GetParam());
  std::size_t inside = 0, outside = 0, holes = 0;
  for (unsigned seed = 1; seed <= kTrials; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    std::mt19937 random(seed);
    const GridGeometry grid = random_grid(random);
    // a small number of labels is indexed by bytes in bricks, a large one is not
    const Model model = noise_model(grid, GetParam(), seed % 5 == 0 ? 60000 : 7, random);
    const SectionPlane plane = random_plane(grid, random);
    const auto oracle = oracle_section(model, plane);
    for (const OraclePixel& pixel : oracle) {
      inside += pixel.value.has_value();
      outside += !pixel.inside;
      holes += pixel.inside && !pixel.value;
    }
    for (const SectionStorage storage : kStorages) {
      SectionRenderer renderer(model, style, storage);
      std::optional<Rendered> first;
      for (const std::int64_t target : test::all_targets()) {
        SCOPED_TRACE(test::target_name(target) + (storage == SectionStorage::kBricks ? ", bricks" : ""));
        const test::OnlyTargets only(target);
        const Rendered rendered = render(renderer, plane);
        if (!first) {
          first = rendered;
          expect_like_oracle(oracle, rendered, plane, style, 0.02);
          if (HasFatalFailure()) return;
        }
        ASSERT_TRUE(rendered == *first);
      }
    }
  }
  EXPECT_GT(inside, 200u * kTrials);
  EXPECT_GT(outside, 200u * kTrials);
  EXPECT_EQ(holes > 1000, GetParam() == Values::kHoles);
}
std::string values_name(const ::testing::TestParamInfo<Values>& values) {
  return std::vector<std::string>{"whole", "real", "holes"}[static_cast<std::size_t>(values.param)];
}
INSTANTIATE_TEST_SUITE_P(Scans, SectionTargets,
                         ::testing::Values(Values::kWhole, Values::kReal, Values::kHoles), values_name);

// Smooth localised displacement with a gradient of at most 0.7, so that nothing folds.
struct Push {
  Point<Patient> middle;
  Vector<Patient> by_mm;
  double reach_mm = 1;

  Vector<Patient> operator()(const Point<Patient>& at_rest) const {
    const double far = (at_rest - middle).norm() / reach_mm;
    return by_mm * std::exp(-far * far);
  }
};
Push random_push(const GridGeometry& grid, std::mt19937& random) {
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> part(0, 1);
  Push push;
  push.middle = grid.X_PatientVoxel() * Point<Voxel>(part(random) * grid.dims[0], part(random) * grid.dims[1],
                                                     part(random) * grid.dims[2]);
  push.reach_mm = 2 + 10 * part(random);
  // the maximum slope of exp(-x2) is 0.858
  push.by_mm = Vector<Patient>(normal(random), normal(random), normal(random)).normalized() *
               (0.7 / 0.858 * push.reach_mm * part(random));
  return push;
}

TEST(SectionRenderer, DrawsDeformedTissueAtItsDisplacedPosition) {
  std::size_t moved = 0;
  for (unsigned seed = 1; seed <= 40; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    std::mt19937 random(seed);
    const GridGeometry grid = random_grid(random);
    const Values values = seed % 3 == 0 ? Values::kHoles : Values::kWhole;
    const Model model = noise_model(grid, values, 7, random);
    const SectionPlane plane = random_plane(grid, random);
    SectionStyle style = style_for(values);
    const auto at_rest = oracle_section(model, plane);
    style.moved = random_push(grid, random);
    auto oracle = oracle_section(model, plane, style.moved);
    for (std::size_t n = 0; n < oracle.size(); ++n) moved += oracle[n].label != at_rest[n].label;
    for (const SectionStorage storage : kStorages) {
      SectionRenderer renderer(model, style, storage);
      const Rendered rendered = render(renderer, plane);
      // rest positions are accurate to some micrometres, so pixels near a voxel boundary may differ
      std::size_t off = 0;
      for (std::size_t n = 0; n < oracle.size(); ++n) {
        if (oracle[n].label != rendered.labels[n] ||
            oracle[n].value.has_value() != (rendered.scan[3 * n] != 14)) {
          ++off;
          continue;
        }
        if (!oracle[n].value) continue;
        const double level =
            255 * (*oracle[n].value - style.window_low) / (style.window_high - style.window_low);
        const double max_gradient = 255 * 3000 / (style.window_high - style.window_low);
        ASSERT_NEAR(rendered.scan[3 * n], std::clamp(level, 0.0, 255.0), 1 + 0.004 * max_gradient);
      }
      EXPECT_LE(off, 2 + oracle.size() / 200);
      // the blend follows from the labels
      EXPECT_EQ(rendered.rgb, oracle_blend(rendered.scan, rendered.labels, plane, kColours, style));
      // without displacement the picture is as before
      SectionStyle still = style;
      still.moved = {};
      SectionStyle unmoved = style;
      unmoved.moved = [](const Point<Patient>&) { return Vector<Patient>(); };
      SectionRenderer other(model, still, storage);
      renderer.set_style(unmoved);
      EXPECT_TRUE(render(renderer, plane) == render(other, plane));
    }
  }
  EXPECT_GT(moved, 5000u);
}

TEST(SectionRenderer, FindsWhereTissueLayAtRest) {
  std::mt19937 random(7);
  const GridGeometry grid = test::make_grid({30, 30, 30}, 2);
  std::uniform_real_distribution<double> part(-0.2, 1.2);
  for (int trial = 0; trial < 200; ++trial) {
    const Push push = random_push(grid, random);
    const Point<Patient> lay =
        grid.X_PatientVoxel() * Point<Voxel>(30 * part(random), 30 * part(random), 30 * part(random));
    const Point<Patient> found = rest_position(lay + push(lay), push);
    // each iteration leaves at most 0.3 of the error
    EXPECT_LT((found - lay).norm(), 4 * kAtRestNear_mm);
  }
  // without displacement immediately; for a constant displacement after one step; in folded tissue some point
  // nearby
  const Point<Patient> at(1, 2, 3);
  EXPECT_EQ(rest_position(at, [](const Point<Patient>&) { return Vector<Patient>(); }), at);
  const Vector<Patient> same(0.5, -1, 2);
  EXPECT_LT((rest_position(at, [&](const Point<Patient>&) { return same; }) - (at - same)).norm(), 1e-12);
  const Push folding{at, {0, 0, 9}, 3};
  for (double z = -5; z < 15; z += 0.1) {
    const Point<Patient> found = rest_position(at + Vector<Patient>(0, 0, z), folding);
    EXPECT_LT((found - (at + Vector<Patient>(0, 0, z))).norm(), 9.1);
  }
}

// pixels exactly on the volume's boundary are inside at the lower end and outside at the upper
TEST(SectionRenderer, BordersAreTheOracles) {
  std::mt19937 random(5);
  GridGeometry grid;
  grid.dims = {9, 16, 8};
  const Model model = noise_model(grid, Values::kWhole, 4, random);
  const SectionStyle style = style_for(Values::kWhole);
  for (const SectionStorage storage : kStorages) {
    SectionRenderer renderer(model, style, storage);
    for (int axis = 0; axis < 3; ++axis) {
      for (const double at : {-0.5, 0.0, grid.dims[axis] - 1.0, grid.dims[axis] - 0.5}) {
        Point<Patient> centre = grid.centre();
        centre[axis] = at;
        SectionPlane plane{centre, {}, {}, 40, 40, 40};  // one pixel per voxel, at its corners
        plane.right[(axis + 1) % 3] = 1;
        plane.down[(axis + 2) % 3] = 1;
        const auto oracle = oracle_section(model, plane);
        const bool any = std::any_of(oracle.begin(), oracle.end(), [](const auto& p) { return p.inside; });
        EXPECT_EQ(any, at < grid.dims[axis] - 0.5);
        expect_like_oracle(oracle, render(renderer, plane), plane, style, 0.02);
      }
    }
  }
}

// bands of 64 rows and tiles of 64 columns: picture sizes just below and above
TEST(SectionRenderer, BandsAndTilesLeaveNoSeam) {
  std::mt19937 random(12);
  const GridGeometry grid = test::make_grid({40, 37, 33}, 3);
  const Model model = noise_model(grid, Values::kWhole, 3, random);
  const SectionStyle style = style_for(Values::kWhole);
  for (const SectionStorage storage : kStorages) {
    SectionRenderer renderer(model, style, storage);
    for (const int height : {1, 2, 63, 64, 65, 66, 127, 128, 129, 193}) {
      for (const int width : {1, 63, 64, 65, 129}) {
        SCOPED_TRACE(std::to_string(width) + " x " + std::to_string(height));
        SectionPlane plane = random_plane(grid, random);
        plane.centre = grid.centre();
        plane.width_px = width;
        plane.height_px = height;
        // coarse enough for many boundaries between structures, fine enough for their interiors
        plane.width_mm = 0.4 * grid.spacing_mm[0] * width;
        const Rendered rendered = render(renderer, plane);
        expect_like_oracle(oracle_section(model, plane), rendered, plane, style, 0.02);
        if (HasFatalFailure()) return;
        // the structure layer blended over the scan layer
        for (std::size_t n = 0; n < rendered.rgb.size(); ++n) {
          const std::uint8_t* over = &rendered.overlay[4 * (n / 3)];
          ASSERT_EQ(rendered.rgb[n],
                    (rendered.scan[n] * (255 - over[3]) + over[n % 3] * over[3] + 127) / 255);
        }
      }
    }
  }
}

TEST(SectionRenderer, DegeneratePlanesShowBackground) {
  std::mt19937 random(6);
  const Model model = noise_model(test::make_grid({20, 20, 20}, 2), Values::kWhole, 4, random);
  for (const SectionStorage storage : kStorages) {
    SectionRenderer renderer(model, style_for(Values::kWhole), storage);
    for (const Point<Patient>& centre : test::invalid_points(model.scan->geometry())) {
      for (const double bad : {1.0, std::numeric_limits<double>::quiet_NaN()}) {
        SectionPlane plane = anatomical_section(AnatomicalPlane::kAxial, centre, 50, 33, 20);
        plane.right[0] *= bad;
        for (const std::uint8_t byte : render(renderer, plane).rgb) ASSERT_EQ(byte, 14);
      }
    }
  }
}

// integers are stored exactly; a single outlier does not reduce the precision
TEST(SectionRenderer, BricksEqualTheWindowedScan) {
  GridGeometry grid;
  grid.dims = {64, 64, 16};
  Volume<float> scan(grid);
  std::mt19937 random(7);
  std::uniform_real_distribution<float> real(0, 1);
  for (float& voxel : scan.voxels()) voxel = real(random);
  scan.at(3, 3, 3) = 1e30f;
  scan.at(9, 9, 9) = -1e30f;
  Model model;
  model.scan = std::make_shared<const Volume<float>>(std::move(scan));
  const SectionPlane plane = anatomical_section(AnatomicalPlane::kAxial, {31.5, 31.5, 12}, 64, 64, 64);
  // a tenth of the range in 256 levels: a 16-bit step is a tenth of a level
  const SectionStyle style{0.4, 0.5, 0.4, true, 256};
  SectionRenderer plain(model, style, SectionStorage::kModel), bricks(model, style);
  const auto expected = render(plain, plane).scan, got = render(bricks, plane).scan;
  for (std::size_t n = 0; n < expected.size(); ++n) ASSERT_NEAR(got[n], expected[n], 1.5);
  // two bytes per voxel, including the overlaps
  EXPECT_EQ(plain.prepared_bytes(), 0u);
  EXPECT_EQ(bricks.prepared_bytes(), 9u * 9 * 3 * 512 * 2);
}

// more than one huge page, and not a whole number of pages
TEST(SectionRenderer, LargeBricksAreTheOracles) {
  std::mt19937 random(13);
  const GridGeometry grid = test::make_grid({120, 90, 131}, 2);
  const Model model = noise_model(grid, Values::kWhole, 5, random);
  const SectionStyle style = style_for(Values::kWhole);
  SectionRenderer renderer(model, style);
  // voxels times the bytes of scan and label
  EXPECT_EQ(renderer.prepared_bytes(), std::size_t{17} * 13 * 19 * 512 * 3);
  for (int n = 0; n < 5; ++n) {
    const SectionPlane plane = random_plane(grid, random);
    expect_like_oracle(oracle_section(model, plane), render(renderer, plane), plane, style, 0.02);
    if (HasFatalFailure()) return;
  }
}

TEST(SectionRenderer, WithoutAWindowTheAutomaticOneIsTaken) {
  std::mt19937 random(8);
  const Model model = noise_model(test::make_grid({20, 22, 24}, 3), Values::kWhole, 4, random);
  const auto window = scan_window(*model.scan);
  const SectionPlane plane =
      anatomical_section(AnatomicalPlane::kCoronal, model.scan->geometry().centre(), 12, 50, 40);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  SectionRenderer declared(model, {window[0], window[1]}), none(model), empty(model, {700, 700}),
      upside_down(model, {900, 100}), no_number(model, {nan, 100});
  const Rendered expected = render(declared, plane);
  for (SectionRenderer* renderer : {&none, &empty, &upside_down, &no_number})
    EXPECT_TRUE(render(*renderer, plane) == expected);
}

TEST(SectionRenderer, DrawsWhatThereIs) {
  std::mt19937 random(9);
  Model model = noise_model(test::make_grid({20, 22, 24}, 1), Values::kWhole, 4, random);
  const SectionPlane plane =
      anatomical_section(AnatomicalPlane::kSagittal, model.scan->geometry().centre(), 12, 50, 40);
  for (const SectionStorage storage : kStorages) {
    SectionRenderer both(model, {}, storage);
    Model labels_alone = model, scan_alone = model;
    labels_alone.scan = nullptr;
    scan_alone.labels = nullptr;
    SectionRenderer labels(labels_alone, {}, storage), scan(scan_alone, {}, storage),
        nothing(Model{}, {}, storage);
    const Rendered expected = render(both, plane);
    const Rendered of_scan = render(scan, plane), of_labels = render(labels, plane);
    EXPECT_EQ(of_scan.rgb, expected.scan);
    EXPECT_EQ(of_scan.labels, std::vector<LabelId>(50 * 40));
    EXPECT_EQ(of_labels.labels, expected.labels);
    EXPECT_EQ(of_labels.overlay, expected.overlay);
    for (const std::uint8_t byte : of_labels.scan) ASSERT_EQ(byte, 26);
    for (const std::uint8_t byte : render(nothing, plane).rgb) ASSERT_EQ(byte, 26);
  }
}

// pictures of changing size and style, copies, and a model that no longer exists
TEST(SectionRenderer, IsIndependentOfEarlierPictures) {
  std::mt19937 random(10);
  const GridGeometry grid = test::make_grid({30, 25, 20}, 2);
  auto model = std::make_unique<Model>(noise_model(grid, Values::kReal, 6, random));
  const SectionStyle style = style_for(Values::kReal);
  SectionStyle other = style;
  other.outlines = false;
  other.label_opacity = 0.9;
  other.grey_levels = 16;
  std::vector<SectionPlane> planes;
  std::vector<Rendered> expected;
  for (int n = 0; n < 20; ++n) {
    planes.push_back(random_plane(grid, random));
    SectionRenderer fresh(*model, style);
    expected.push_back(render(fresh, planes.back()));
  }
  SectionRenderer used(*model, other), copy(*model, style);
  copy = used;
  model.reset();
  for (std::size_t n = 0; n < planes.size(); ++n) {
    render(used, planes[(n * 7) % planes.size()]);
    used.set_style(style);
    EXPECT_TRUE(render(used, planes[n]) == expected[n]) << n;
    SectionRenderer another(used);
    EXPECT_TRUE(render(another, planes[n]) == expected[n]) << n;
    used.set_style(other);
    EXPECT_TRUE(render(used, planes[n]) == render(copy, planes[n])) << n;
  }
}

#ifdef PALPATE_COUNTS_ALLOCATIONS
TEST(SectionRenderer, AllocatesNothingForAPicture) {
  std::mt19937 random(11);
  const GridGeometry grid = test::make_grid({30, 25, 20}, 2);
  const Model model = noise_model(grid, Values::kHoles, 6, random);
  std::vector<SectionPlane> planes;
  std::size_t largest = 0;
  for (int n = 0; n < 20; ++n) {
    planes.push_back(random_plane(grid, random));
    planes.back().width_px = 20 + n;
    planes.back().height_px = 60 - n;
    largest = std::max(largest, static_cast<std::size_t>(planes.back().width_px) * planes.back().height_px);
  }
  std::vector<std::uint8_t> rgb(3 * largest);
  for (const SectionStorage storage : kStorages) {
    SectionRenderer renderer(model, {}, storage);
    const auto draw_all = [&] {
      for (const SectionPlane& plane : planes)
        renderer.render(plane, std::span(rgb).first(std::size_t{3} * plane.width_px * plane.height_px));
    };
    draw_all();
    const long before = allocations;
    EXPECT_GT(before, 0);
    draw_all();
    EXPECT_EQ(allocations, before);
  }
}
#endif

}  // namespace
}  // namespace palpate
