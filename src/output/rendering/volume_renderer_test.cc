#include "palpate/rendering/volume_renderer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>

#include "base/test_seed.h"
#include "rendering/test_volume_oracle.h"
#include "sampling/test_targets.h"

namespace palpate {
namespace {

using testing::VolumeOracle;

GridGeometry some_grid(int kind) {
  return test::make_grid(kind == 0 ? std::array{56, 48, 40} : std::array{88, 48, 30}, kind);
}

std::vector<StructureAppearance> some_appearances() {
  return {
      {{0, 0, 0}, 0}, {{230, 220, 190}, 1}, {{200, 90, 80}, 0.35}, {{90, 160, 220}, 1}, {{80, 220, 120}, 0}};
}

/// Balls and sheets of several structures, some of them cut by the border.
Volume<LabelId> some_shapes(const GridGeometry& grid, std::mt19937& random) {
  std::uniform_real_distribution<double> part(0, 1);
  std::normal_distribution<double> normal;
  Volume<LabelId> labels(grid);
  const Eigen::Vector3d size(grid.dims[0] * grid.spacing_mm[0], grid.dims[1] * grid.spacing_mm[1],
                             grid.dims[2] * grid.spacing_mm[2]);
  const double smallest = size.minCoeff();
  const auto for_each = [&](const auto& visit) {
    for (int k = 0; k < grid.dims[2]; ++k)
      for (int j = 0; j < grid.dims[1]; ++j)
        for (int i = 0; i < grid.dims[0]; ++i)
          visit(Eigen::Vector3d(i * grid.spacing_mm[0], j * grid.spacing_mm[1], k * grid.spacing_mm[2]),
                labels.at(i, j, k));
  };
  for (const LabelId label : std::initializer_list<LabelId>{2, 1, 3, 1, 3, 4}) {
    const double x = part(random), y = part(random), z = part(random);
    const Eigen::Vector3d centre(x * size[0], y * size[1], z * size[2]);
    const double radius = (label == 2 ? 0.45 : 0.12 + 0.2 * part(random)) * smallest;
    for_each([&](const Eigen::Vector3d& p, LabelId& voxel) {
      if ((p - centre).norm() < radius) voxel = label;
    });
  }
  const double a = normal(random), b = normal(random), c = normal(random);
  const Eigen::Vector3d across = Eigen::Vector3d(a, b, c).normalized();
  for_each([&](const Eigen::Vector3d& p, LabelId& voxel) {
    if (std::abs((p - size / 2).dot(across)) < 1.2 * grid.spacing_mm.maxCoeff() &&
        (p - size / 2).norm() < 0.4 * smallest)
      voxel = 3;
  });
  return labels;
}

/// Along an axis of the grid, on either side of a change of the principal axis, or from a random direction.
VolumeCamera some_camera(const GridGeometry& grid, int number, std::mt19937& random) {
  std::normal_distribution<double> normal;
  const auto direction = [&] {
    const double x = normal(random), y = normal(random), z = normal(random);
    return Vector<Patient>(x, y, z).normalized();
  };
  VolumeCamera camera;
  camera.focus = grid.centre();
  Vector<Patient> into = direction();
  const auto axis = [&](int a) { return Vector<Patient>(Eigen::Vector3d(grid.direction.col(a))); };
  const double turn = 0.785398 + (number % 2 == 0 ? 1e-3 : -1e-3);
  if (number % 3 == 0) into = axis(number / 3 % 3) * (number % 2 == 0 ? 1 : -1);
  if (number % 3 == 1)
    into = axis(number / 3 % 3) * std::cos(turn) + axis((number / 3 + 1) % 3) * std::sin(turn);
  camera.right = into.cross(direction()).normalized();
  camera.down = into.cross(camera.right).normalized();
  double longest = 0;
  for (int a = 0; a < 3; ++a) longest = std::max(longest, grid.dims[a] * grid.spacing_mm[a]);
  camera.width_px = 90;
  camera.height_px = 80;
  camera.width_mm = 0.9 * longest;
  if (number % 4 == 3) camera.eye_mm = 2 * camera.width_mm;
  return camera;
}

struct Difference {
  double rms = 0, p999 = 0, most = 0, coverage = 0;
  double too_deep = 0;  ///< Share of pixels, deep in both, that differ by more than a voxel
};

Difference compare(const VolumeOracle::Picture& oracle, const std::vector<std::uint8_t>& rgb,
                   const std::vector<float>& depth, const Rgb& background, double voxel_mm) {
  std::vector<double> errors;
  double sum = 0;
  std::size_t covered = 0, deep = 0, both = 0;
  for (std::size_t n = 0; n < oracle.rgb.size(); ++n) {
    const std::uint8_t* pixel = &rgb[3 * n];
    const bool drawn = pixel[0] != background.r || pixel[1] != background.g || pixel[2] != background.b;
    if (!drawn && oracle.covered[n] < 1.0 / 255) continue;
    ++covered;
    for (int c = 0; c < 3; ++c) {
      const double error = std::abs(pixel[c] - oracle.rgb[n][c]);
      errors.push_back(error);
      sum += error * error;
    }
    if (std::isfinite(oracle.depth_mm[n]) && std::isfinite(depth[n])) {
      ++both;
      deep += std::abs(oracle.depth_mm[n] - depth[n]) > voxel_mm ? 1 : 0;
    }
  }
  std::sort(errors.begin(), errors.end());
  Difference difference;
  if (errors.empty()) return difference;
  difference.rms = std::sqrt(sum / static_cast<double>(errors.size()));
  difference.p999 = errors[errors.size() * 999 / 1000];
  difference.most = errors.back();
  difference.coverage = static_cast<double>(covered) / static_cast<double>(oracle.rgb.size());
  difference.too_deep = both > 0 ? static_cast<double>(deep) / static_cast<double>(both) : 0;
  return difference;
}

struct Drawn {
  std::vector<std::uint8_t> rgb;
  std::vector<float> depth_mm;
  bool operator==(const Drawn&) const = default;
};

Drawn draw(VolumeRenderer& renderer, const VolumeCamera& camera, const VolumeStyle& style = {}) {
  const std::size_t pixels = static_cast<std::size_t>(camera.width_px) * camera.height_px;
  Drawn drawn{std::vector<std::uint8_t>(3 * pixels), std::vector<float>(pixels)};
  renderer.render(camera, style, drawn.rgb, drawn.depth_mm);
  return drawn;
}

VolumeRenderer made(const Volume<LabelId>& labels, const std::vector<StructureAppearance>& appearances,
                    int threads = 0, const ScanAppearance& scan = {}) {
  auto renderer = VolumeRenderer::make(*label_bricks(labels), appearances, threads, {}, scan);
  EXPECT_TRUE(renderer);
  return std::move(*renderer);
}

VolumeStyle some_style(const GridGeometry& grid, int number) {
  VolumeStyle style;
  if (number % 5 == 4) style.clip = ClipPlane{grid.centre(), {0.3, -0.8, 0.2}};
  return style;
}

TEST(VolumeRenderer, EqualsARayCaster) {
  const unsigned seed = test::test_seed();
  std::printf("seed %u\n", seed);
  std::mt19937 random(seed);
  // pixels of half a voxel to one voxel; in the last twelve views, of 1 to 1.6
  for (int number = 0; number < 24; ++number) {
    const GridGeometry grid = some_grid(number % 4);
    const Volume<LabelId> labels = some_shapes(grid, random);
    VolumeCamera camera = some_camera(grid, number, random);
    if (number >= 12) camera.width_px = camera.height_px = 48;
    const VolumeStyle style = some_style(grid, number);
    std::vector<StructureAppearance> appearances = some_appearances();
    if (number % 12 >= 6) appearances[2].opacity = 1;
    VolumeRenderer renderer = made(labels, appearances);
    const Drawn drawn = draw(renderer, camera, style);
    VolumeOracle oracle(labels, appearances);
    const Difference difference = compare(oracle.render(camera, style, 5), drawn.rgb, drawn.depth_mm,
                                          style.background, grid.spacing_mm.maxCoeff());
    EXPECT_LE(difference.rms, 2) << number;
    EXPECT_LE(difference.p999, 12) << number;
    EXPECT_GE(difference.coverage, 0.2) << number;
    EXPECT_LE(difference.too_deep, 0.05) << number;
  }
}

/// Waves with a length of a few voxels over the whole window and beyond it, and values that are not finite.
ScanAppearance some_scan(const GridGeometry& grid, std::mt19937& random) {
  std::uniform_real_distribution<double> part(0, 1);
  const double x = part(random), y = part(random), z = part(random);
  auto scan = std::make_shared<Volume<float>>(grid);
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i)
        scan->at(i, j, k) = static_cast<float>(300 + 900 * std::sin(0.2 * i + x) * std::cos(0.15 * j + y) *
                                                         std::sin(0.25 * k + z));
  scan->at(3, 4, 5) = std::numeric_limits<float>::quiet_NaN();
  scan->at(9, 4, 5) = std::numeric_limits<float>::infinity();
  return {scan, {-100, 1000}, 0.6 + 0.4 * part(random)};
}

TEST(VolumeRenderer, BlendsTheScanAsARayCasterDoes) {
  const unsigned seed = test::test_seed();
  std::printf("seed %u\n", seed);
  std::mt19937 random(seed);
  for (int number = 0; number < 6; ++number) {
    const GridGeometry grid = some_grid(number % 4);
    Volume<LabelId> labels = some_shapes(grid, random);
    const VolumeCamera camera = some_camera(grid, number, random);
    const VolumeStyle style = some_style(grid, number);
    const ScanAppearance scan = some_scan(grid, random);
    const std::vector<StructureAppearance> appearances = some_appearances();
    VolumeRenderer renderer = made(labels, appearances, 0, scan);
    Drawn drawn = draw(renderer, camera, style);
    const Difference difference =
        compare(VolumeOracle(labels, appearances, scan).render(camera, style, 5), drawn.rgb, drawn.depth_mm,
                style.background, grid.spacing_mm.maxCoeff());
    EXPECT_LE(difference.rms, 2) << number;
    EXPECT_LE(difference.p999, 12) << number;
    EXPECT_GE(difference.coverage, 0.5) << number;
    // visible, but not through opaque structures
    VolumeRenderer without = made(labels, appearances);
    EXPECT_NE(draw(without, camera, style), drawn) << number;
    // a box that the labels uncover shows the scan
    const VoxelBox box{{10, 12, 8}, {18, 15, 14}};
    for (int k = 8; k < 22; ++k)
      for (int j = 12; j < 27; ++j)
        for (int i = 10; i < 28; ++i) labels.at(i, j, k) = 0;
    renderer.change(*label_bricks(labels), box);
    VolumeRenderer anew = made(labels, appearances, 2, scan);
    EXPECT_EQ(draw(renderer, camera, style), draw(anew, camera, style)) << number;
  }
}

/// Structures that reach the volume's border begin on the first sampling plane.
TEST(VolumeRenderer, HasDepthsAtTheVolumeBorder) {
  const GridGeometry grid = test::make_grid({20, 24, 28}, 0);
  const Volume<LabelId> labels(grid, 1);
  VolumeRenderer renderer = made(labels, some_appearances());
  VolumeOracle oracle(labels, some_appearances());
  std::mt19937 random(4);
  for (const int number : {0, 3, 6, 9, 2}) {
    const VolumeCamera camera = some_camera(grid, number, random);
    const Drawn drawn = draw(renderer, camera);
    const VolumeOracle::Picture picture = oracle.render(camera, {}, 20);
    double sum = 0;
    int missed = 0, count = 0;
    for (std::size_t n = 0; n < drawn.depth_mm.size(); ++n) {
      if (picture.covered[n] < 0.99) continue;
      ++count;
      if (!std::isfinite(drawn.depth_mm[n])) ++missed;
      if (std::isfinite(drawn.depth_mm[n])) sum += std::abs(drawn.depth_mm[n] - picture.depth_mm[n]);
    }
    EXPECT_GT(count, 1000) << number;
    EXPECT_EQ(missed, 0) << number;
    EXPECT_LE(sum / count, 0.3) << number;
  }
}

Volume<LabelId> ball(const GridGeometry& grid, double radius_mm) {
  Volume<LabelId> labels(grid);
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i)
        if ((grid.X_PatientVoxel() * Point<Voxel>(i, j, k) - grid.centre()).norm() < radius_mm)
          labels.at(i, j, k) = 1;
  return labels;
}

TEST(VolumeRenderer, ABallIsLitAsABallIs) {
  for (const int kind : {0, 1, 2}) {
    GridGeometry grid = test::make_grid({56, 56, 56}, 0);
    if (kind == 1) grid = test::make_grid({97, 60, 60}, 0), grid.spacing_mm = {0.6, 1, 1};
    if (kind == 2) grid.direction = test::make_grid({1, 1, 1}, 2).direction;
    const double radius = 22.3;
    VolumeRenderer renderer = made(ball(grid, radius), {{{0, 0, 0}, 0}, {{255, 255, 255}, 1}});
    VolumeStyle style;
    style.light = {0, 1, 0, 0};
    for (const int number : {0, 1, 2}) {
      std::mt19937 random(static_cast<unsigned>(number));
      VolumeCamera camera = some_camera(grid, number, random);
      camera.eye_mm = std::numeric_limits<double>::infinity();
      camera.width_mm = 60, camera.width_px = 200, camera.height_px = 200;
      const Drawn drawn = draw(renderer, camera, style);
      double sum = 0, most = 0, deepest = 0;
      int count = 0;
      for (int row = 0; row < camera.height_px; ++row)
        for (int column = 0; column < camera.width_px; ++column) {
          const double off = (camera.at(column, row) - camera.focus).norm() / radius;
          // at the rim a pixel also covers what is beside the ball
          if (off > 1 - 1.5 * grid.spacing_mm.maxCoeff() / radius) continue;
          const std::size_t n = static_cast<std::size_t>(row) * 200 + static_cast<std::size_t>(column);
          const double lambert = std::sqrt(1 - off * off), error = drawn.rgb[3 * n] / 255.0 - lambert;
          sum += error * error;
          most = std::max(most, std::abs(error));
          deepest = std::max(deepest, std::abs(drawn.depth_mm[n] + radius * lambert));
          ++count;
        }
      EXPECT_LE(std::sqrt(sum / count), 0.02) << kind;
      EXPECT_LE(most, 0.06) << kind << " " << number;
      EXPECT_LE(deepest, 2.5) << kind;
    }
  }
}

TEST(VolumeRenderer, DrawsTheSameOnEveryTargetAndWithAnyNumberOfThreads) {
  std::mt19937 random(7);
  for (int number = 0; number < 4; ++number) {
    const GridGeometry grid = some_grid(number);
    const Volume<LabelId> labels = some_shapes(grid, random);
    const VolumeCamera camera = some_camera(grid, 3 * number + number % 2, random);
    const VolumeStyle style = some_style(grid, number + 1);
    VolumeRenderer one = made(labels, some_appearances(), 1), three = made(labels, some_appearances(), 3);
    const Drawn drawn = draw(one, camera, style);
    EXPECT_EQ(draw(three, camera, style), drawn);
    for (const std::int64_t target : test::all_targets()) {
      const test::OnlyTargets only(target);
      VolumeRenderer renderer = made(labels, some_appearances(), 1);
      EXPECT_EQ(draw(renderer, camera, style), drawn) << test::target_name(target);
    }
  }
}

TEST(VolumeRenderer, PartialUpdateEqualsAFullRebuild) {
  const unsigned seed = test::test_seed();
  std::printf("seed %u\n", seed);
  std::mt19937 random(seed);
  const GridGeometry grid = test::make_grid({90, 75, 70}, 1);
  Volume<LabelId> labels = some_shapes(grid, random);
  VolumeRenderer renderer = made(labels, some_appearances());
  for (int number = 0; number < 4; ++number) {
    VoxelBox box;
    for (std::size_t a = 0; a < 3; ++a) {
      box.size[a] = 1 + static_cast<int>(random() % 20);
      box.first[a] = static_cast<int>(random() % static_cast<unsigned>(grid.dims[a] - box.size[a] + 1));
    }
    const auto label = static_cast<LabelId>(number % 3);
    for (int k = box.first[2]; k < box.first[2] + box.size[2]; ++k)
      for (int j = box.first[1]; j < box.first[1] + box.size[1]; ++j)
        for (int i = box.first[0]; i < box.first[0] + box.size[0]; ++i) labels.at(i, j, k) = label;
    renderer.change(*label_bricks(labels), box);
    VolumeRenderer anew = made(labels, some_appearances());
    const VolumeCamera camera = some_camera(grid, 3 * number, random);
    EXPECT_EQ(draw(renderer, camera), draw(anew, camera)) << number;
  }
}

TEST(VolumeRenderer, BoxesThatChangeToAndFroTakeNoEverGrowingRoom) {
  const GridGeometry grid = test::make_grid({100, 60, 50}, 1);
  std::mt19937 random(3);
  Volume<LabelId> labels = some_shapes(grid, random);
  VolumeRenderer renderer = made(labels, some_appearances());
  const std::vector<LabelId> before(labels.voxels().begin(), labels.voxels().end());
  const VoxelBox all{{0, 0, 0}, grid.dims};
  std::array<std::size_t, 8> bytes{};
  for (std::size_t number = 0; number < bytes.size(); ++number) {
    // a comb whose teeth are shifted each time
    for (std::size_t n = 0; n < before.size(); ++n)
      labels.voxels()[n] = n % 100 / 5 % 4 == number % 4 ? LabelId{1} : before[n];
    renderer.change(*label_bricks(labels), all);
    bytes[number] = renderer.prepared_bytes();
  }
  EXPECT_EQ(bytes[7], bytes[3]);
  VolumeRenderer anew = made(labels, some_appearances());
  const VolumeCamera camera = some_camera(grid, 1, random);
  EXPECT_EQ(draw(renderer, camera), draw(anew, camera));
}

/// Blocks of two adjacent slices that share a slot in a thread's cache of lit blocks.
TEST(VolumeRenderer, BlocksSharingASlotAreBothVisible) {
  const GridGeometry grid = test::make_grid({64, 64, 30}, 1);
  Volume<LabelId> labels(grid);
  const auto fill = [&](int k, LabelId label) {
    for (int j = 0; j < 64; ++j)
      for (int i = 0; i < 64; ++i) labels.at(i, j, k) = label;
  };
  // 512 blocks each, separated by empty slices: blocks filled later have indices 4096 higher
  for (const int k : {0, 5, 8, 11, 14, 17, 20, 23}) fill(k, 1);
  const std::vector<StructureAppearance> solid{{{}, 0}, {{220, 30, 30}, 1}, {{30, 30, 220}, 1}};
  VolumeRenderer renderer = made(labels, solid, 1);
  fill(1, 2);
  renderer.change(*label_bricks(labels), {{0, 0, 1}, {64, 64, 1}});
  VolumeRenderer anew = made(labels, solid, 1);
  std::mt19937 random(3);
  VolumeCamera camera = some_camera(grid, 0, random);
  camera.eye_mm = std::numeric_limits<double>::infinity();
  // slightly oblique to the slices' normal, from either side
  const Vector<Patient> normal(grid.direction.col(2)), beside(grid.direction.col(0));
  for (const double side : {1.0, -1.0}) {
    const Vector<Patient> into = (normal * side + beside * 0.1).normalized();
    camera.right = into.cross(Vector<Patient>(grid.direction.col(1))).normalized();
    camera.down = into.cross(camera.right);
    EXPECT_EQ(draw(renderer, camera), draw(anew, camera)) << side;
  }
}

/// Image difference between two nearly identical views.
TEST(VolumeRenderer, IsContinuousAcrossAxisChanges) {
  const GridGeometry grid = some_grid(1);
  std::mt19937 random(3);
  const Volume<LabelId> labels = some_shapes(grid, random);
  VolumeRenderer renderer = made(labels, some_appearances());
  const auto turned = [&](double angle) {
    VolumeCamera camera = some_camera(grid, 0, random);
    const Vector<Patient> into(std::sin(angle), std::cos(angle), 0.1);
    camera.right = into.cross(Vector<Patient>(0, 0, 1)).normalized();
    camera.down = into.normalized().cross(camera.right);
    camera.eye_mm = std::numeric_limits<double>::infinity();
    return draw(renderer, camera);
  };
  // steps of half a thousandth of a degree: across the switch, and beside it
  const auto step = [&](double from) {
    const Drawn a = turned(from), b = turned(from + 1e-5);
    double sum = 0;
    for (std::size_t n = 0; n < a.rgb.size(); ++n) sum += std::pow(a.rgb[n] - b.rgb[n], 2);
    return std::sqrt(sum / static_cast<double>(a.rgb.size()));
  };
  const double over = step(std::numbers::pi / 4 - 5e-6);
  EXPECT_GT(over, 0) << "no switch";
  EXPECT_LE(over, 1);
  EXPECT_LE(step(std::numbers::pi / 4 + 1e-3), 0.1);
}

TEST(VolumeRenderer, DrawsBackgroundWhereThereIsNothing) {
  const GridGeometry grid = some_grid(1);
  std::mt19937 random(3);
  VolumeCamera camera = some_camera(grid, 2, random);
  VolumeStyle style;
  style.background = {10, 200, 30};
  const auto is_background = [&](const Drawn& drawn) {
    for (std::size_t n = 0; n < drawn.depth_mm.size(); ++n)
      if (drawn.rgb[3 * n] != 10 || drawn.rgb[3 * n + 1] != 200 || drawn.rgb[3 * n + 2] != 30 ||
          std::isfinite(drawn.depth_mm[n]))
        return false;
    return true;
  };
  VolumeRenderer nothing = made(Volume<LabelId>(grid), some_appearances());
  EXPECT_TRUE(is_background(draw(nothing, camera, style)));
  VolumeRenderer hidden = made(Volume<LabelId>(grid, 4), some_appearances());
  EXPECT_TRUE(is_background(draw(hidden, camera, style)));
  VolumeRenderer full = made(Volume<LabelId>(grid, 1), some_appearances());
  EXPECT_FALSE(is_background(draw(full, camera, style)));
  // everything clipped, outside the picture, behind the eye
  style.clip = ClipPlane{grid.centre() - Vector<Patient>(500, 0, 0), {1, 0, 0}};
  EXPECT_TRUE(is_background(draw(full, camera, style)));
  style.clip.reset();
  camera.focus += camera.right * 500;
  EXPECT_TRUE(is_background(draw(full, camera, style)));
  camera.focus = grid.centre() + camera.into() * 500;
  camera.eye_mm = 300;
  EXPECT_TRUE(is_background(draw(full, camera, style)));
}

TEST(VolumeRenderer, SeesFromWithinAndWideAngles) {
  // an eye at the centre of a hollow box sees its walls all around, by rays with several principal axes
  const GridGeometry grid = test::make_grid({40, 40, 40}, 0);
  Volume<LabelId> labels(grid, 1);
  for (int k = 6; k < 34; ++k)
    for (int j = 6; j < 34; ++j)
      for (int i = 6; i < 34; ++i) labels.at(i, j, k) = 0;
  VolumeRenderer renderer = made(labels, some_appearances());
  std::mt19937 random(5);
  for (int number = 0; number < 3; ++number) {
    VolumeCamera camera = some_camera(grid, 2, random);
    camera.eye_mm = 0.5 * camera.width_mm;
    camera.focus = grid.centre() + camera.into() * camera.eye_mm;
    const Drawn drawn = draw(renderer, camera);
    VolumeOracle oracle(labels, some_appearances());
    const Difference difference =
        compare(oracle.render(camera, {}, 5), drawn.rgb, drawn.depth_mm, VolumeStyle{}.background, 1);
    EXPECT_EQ(difference.coverage, 1);
    EXPECT_LE(difference.rms, 2);
    EXPECT_LE(difference.p999, 12);
  }
}

TEST(VolumeRenderer, IsInterrupted) {
  const std::atomic<bool> stop{true};
  const GridGeometry grid = some_grid(0);
  const auto renderer = VolumeRenderer::make(*label_bricks(Volume<LabelId>(grid, 1)), some_appearances(), 0,
                                             Progress({}, &stop));
  ASSERT_FALSE(renderer);
  EXPECT_EQ(renderer.error().kind, ErrorKind::kInterrupted);
}

}  // namespace
}  // namespace palpate
