#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "palpate/rendering/rendering.h"

namespace palpate {
namespace {

constexpr LabelId kFemur = 95, kFibula = 97;
constexpr Rgb kFemurPaint{220, 40, 30}, kFibulaColour{20, 60, 230};

/// Labels every voxel whose centre is within `radius_mm` of `centre`.
void paint_ball(Volume<LabelId>& labels, const Point<Patient>& centre, double radius_mm, LabelId label) {
  const GridGeometry& grid = labels.geometry();
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  for (int k = 0; k < grid.dims[2]; ++k) {
    for (int j = 0; j < grid.dims[1]; ++j) {
      for (int i = 0; i < grid.dims[0]; ++i) {
        if ((X_PatientVoxel * Point<Voxel>(i, j, k) - centre).norm() <= radius_mm) labels.at(i, j, k) = label;
      }
    }
  }
}

Eigen::Matrix3d rotation(double degrees) {
  return Eigen::AngleAxisd(degrees * 3.14159265358979323846 / 180, Eigen::Vector3d(1, 2, 3).normalized())
      .toRotationMatrix();
}

GridGeometry grid_with(const Eigen::Matrix3d& direction) {
  GridGeometry grid;
  grid.dims = {60, 50, 40};
  grid.spacing_mm = Eigen::Vector3d(0.8, 1.0, 1.3);
  grid.direction = direction;
  // centre of the grid at (5, -8, 12)
  const Eigen::Vector3d half = 0.5 * Eigen::Vector3d(59 * 0.8, 49 * 1.0, 39 * 1.3);
  grid.origin = Point<Patient>(Eigen::Vector3d(Eigen::Vector3d(5, -8, 12) - direction * half));
  return grid;
}
const Point<Patient> kMiddle(5, -8, 12);

/// Left knee as two balls: the femur in the centre, the fibula to the patient's left and slightly posterior.
Model two_balls(const GridGeometry& grid) {
  Volume<LabelId> labels(grid);
  paint_ball(labels, kMiddle, 6, kFemur);
  paint_ball(labels, kMiddle + Vector<Patient>(14, 4, -6), 4, kFibula);
  Model model;
  model.labels = label_bricks(labels);
  model.segments = {{kFemur, "femur", kFemurPaint, 0, kFemur},
                    {kFibula, "fibula", kFibulaColour, 0, kFibula}};
  model.tissues.resize(1);
  model.tissue_of_label.assign(kFibula + 1, -1);
  model.tissue_of_label[kFemur] = model.tissue_of_label[kFibula] = 0;
  return model;
}

Rgb pixel(const Image& image, std::array<double, 2> at) {
  const auto offset = 3 * (static_cast<std::size_t>(std::lround(at[1])) * image.width +
                           static_cast<std::size_t>(std::lround(at[0])));
  return {image.rgb[offset], image.rgb[offset + 1], image.rgb[offset + 2]};
}

const SectionStyle kOpaque{0, 0, 1.0, true, 256};

class LayersOnGrids : public ::testing::TestWithParam<int> {
 protected:
  GridGeometry grid() const {
    const Eigen::Matrix3d identity = Eigen::Matrix3d::Identity();
    switch (GetParam()) {
      case 0:
        return grid_with(identity);
      case 1:
        return grid_with(Eigen::Vector3d(-1, 1, 1).asDiagonal() * identity);  // left-handed
      case 2:
        return grid_with(rotation(35));
      default: {
        Eigen::Matrix3d permuted;
        permuted << 0, 0, 1, 1, 0, 0, 0, -1, 0;
        return grid_with(rotation(-20) * permuted);
      }
    }
  }
};

TEST_P(LayersOnGrids, StructuresAppearWhereTheyAre) {
  const Model model = two_balls(grid());
  const Point<Patient> fibula = kMiddle + Vector<Patient>(14, 4, -6);
  for (const AnatomicalPlane plane :
       {AnatomicalPlane::kAxial, AnatomicalPlane::kCoronal, AnatomicalPlane::kSagittal}) {
    const SectionPlane at_femur = anatomical_section(plane, kMiddle, 60, 240, 200);
    EXPECT_EQ(pixel(render_section(model, at_femur, kOpaque), at_femur.pixel_of(kMiddle)), kFemurPaint);
    const SectionPlane at_fibula = anatomical_section(plane, fibula, 60, 240, 200);
    EXPECT_EQ(pixel(render_section(model, at_fibula, kOpaque), at_fibula.pixel_of(fibula)), kFibulaColour);
  }
}

TEST_P(LayersOnGrids, TheFibulaOfALeftKneeIsOnPictureRight) {
  const Model model = two_balls(grid());
  const Point<Patient> fibula = kMiddle + Vector<Patient>(14, 4, -6);
  for (const AnatomicalPlane plane : {AnatomicalPlane::kAxial, AnatomicalPlane::kCoronal}) {
    const SectionPlane section = anatomical_section(plane, fibula - Vector<Patient>(14, 0, 0), 60, 241, 201);
    const std::vector<LabelId> labels = section_labels(model, section);
    double column_sum = 0, count = 0;
    for (std::size_t i = 0; i < labels.size(); ++i) {
      if (labels[i] != kFibula) continue;
      column_sum += static_cast<double>(i % 241);
      count += 1;
    }
    ASSERT_GT(count, 100);
    // 14 mm to the right of the centre column, 120, within a voxel
    EXPECT_NEAR(column_sum / count, 120 + 14 / section.mm_per_px(), 1.3 / section.mm_per_px());
  }
}

// every pixel of an arbitrary plane compared with the definition: the nearest voxel centre, along the grid's
// axes
TEST_P(LayersOnGrids, LabelsAreTheNearestVoxels) {
  Model model;
  Volume<LabelId> noise(grid());
  std::mt19937 random(3);
  for (LabelId& voxel : noise.voxels()) voxel = static_cast<LabelId>(random() % 5);
  model.labels = label_bricks(noise);
  SectionPlane plane =
      anatomical_section(AnatomicalPlane::kAxial, kMiddle + Vector<Patient>(0.13, -0.21, 0.17), 90, 97, 83);
  plane.right = Vector<Patient>(1, 0.4, -0.2).normalized();
  plane.down = plane.right.cross(Vector<Patient>(0.1, 1, 0.9)).normalized();

  const std::vector<LabelId> labels = section_labels(model, plane);
  const auto X_VoxelPatient = noise.geometry().X_PatientVoxel().inverse();
  int observed = 0;
  for (int row = 0; row < 83; ++row) {
    for (int column = 0; column < 97; ++column) {
      const Point<Voxel> v = X_VoxelPatient * plane.at(column, row);
      const LabelId expected =
          noise.at_or(static_cast<int>(std::lround(v[0])), static_cast<int>(std::lround(v[1])),
                      static_cast<int>(std::lround(v[2])), 0);
      ASSERT_EQ(labels[row * 97 + column], expected) << "column " << column << ", row " << row;
      observed += expected != 0;
    }
  }
  EXPECT_GT(observed, 1000);
  EXPECT_LT(observed, 97 * 83 - 1000);  // the plane extends beyond the volume
}

// a scan that is linear in the patient frame is reproduced exactly on any grid
TEST_P(LayersOnGrids, ScanIsInterpolatedLinearly) {
  Model model;
  Volume<float> scan(grid());
  const Eigen::Vector3d slope(0.02, -0.01, 0.015);
  const auto X_PatientVoxel = grid().X_PatientVoxel();
  const auto linear = [&](const Point<Patient>& p) { return 0.5 + slope.dot((p - kMiddle).eigen()); };
  for (int k = 0; k < 40; ++k) {
    for (int j = 0; j < 50; ++j) {
      for (int i = 0; i < 60; ++i) {
        scan.at(i, j, k) = static_cast<float>(linear(X_PatientVoxel * Point<Voxel>(i, j, k)));
      }
    }
  }
  model.scan = std::make_shared<const Volume<float>>(scan);
  const SectionPlane plane = anatomical_section(AnatomicalPlane::kSagittal, kMiddle, 25, 64, 64);
  const Image image = render_section(model, plane, {0, 1, 0.5, true, 256});
  for (int row = 0; row < 64; ++row) {
    for (int column = 0; column < 64; ++column) {
      const double expected = 255 * linear(plane.at(column, row));
      ASSERT_NEAR(pixel(image, {1.0 * column, 1.0 * row}).g, expected, 0.51) << column << ", " << row;
    }
  }
}

std::string grid_name(const ::testing::TestParamInfo<int>& grid) {
  return std::vector<std::string>{"axisAligned", "leftHanded", "oblique", "permuted"}[grid.param];
}
INSTANTIATE_TEST_SUITE_P(Grids, LayersOnGrids, ::testing::Values(0, 1, 2, 3), grid_name);

TEST(Layers, ScanIsClampedToItsWindow) {
  Model model;
  GridGeometry grid;
  grid.dims = {4, 1, 1};
  model.scan = std::make_shared<const Volume<float>>(grid, std::vector<float>{-1000, 100, 270, 5000});
  const SectionPlane plane = anatomical_section(AnatomicalPlane::kAxial, Point<Patient>(1.5, 0, 0), 6, 6, 1);
  const Image image = render_scan_layer(model, plane, {0, 400, 0.5, true, 256});
  // more than half a voxel outside the scan is background
  const std::vector<int> expected{14, 0, 64, 172, 255, 14};
  for (int column = 0; column < 6; ++column) EXPECT_EQ(image.rgb[3 * column], expected[column]) << column;
  // three grey levels: 0, 128, 255
  const Image coarse = render_scan_layer(model, plane, {0, 400, 0.5, true, 3});
  const std::vector<int> three{14, 0, 128, 128, 255, 14};
  for (int column = 0; column < 6; ++column) EXPECT_EQ(coarse.rgb[3 * column], three[column]) << column;
}

TEST(Layers, WindowIsThe1stTo99thPercentile) {
  GridGeometry grid;
  grid.dims = {1000, 7, 1};
  std::vector<float> values(7000);
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = static_cast<float>(i);
  std::shuffle(values.begin(), values.end(), std::mt19937(5));
  auto window = scan_window(Volume<float>(grid, values));
  EXPECT_NEAR(window[0], 70, 1);
  EXPECT_NEAR(window[1], 6930, 1);
  // values that are not finite are ignored
  values[3] = std::numeric_limits<float>::quiet_NaN();
  values[4] = std::numeric_limits<float>::infinity();
  EXPECT_NEAR(scan_window(Volume<float>(grid, values))[1], 6930, 2);
  // constant, or without finite values
  EXPECT_EQ(scan_window(Volume<float>(grid, 42.0f)), (std::array<double, 2>{0, 1}));
  EXPECT_EQ(scan_window(Volume<float>(grid, std::numeric_limits<float>::quiet_NaN())),
            (std::array<double, 2>{0, 1}));
}

TEST(Layers, FillIsTransparentAndTheOutlineIsNot) {
  Model model = two_balls(grid_with(Eigen::Matrix3d::Identity()));
  model.tissues[0].opacity = 0.5;
  const SectionPlane plane = anatomical_section(AnatomicalPlane::kAxial, kMiddle, 40, 200, 200);
  const Overlay overlay = render_structure_layer(model, plane, {0, 0, 0.6, true, 256});
  const auto alpha = [&](int column, int row) { return overlay.rgba[4 * (200 * row + column) + 3]; };
  EXPECT_EQ(alpha(100, 100), std::lround(255 * 0.3));
  EXPECT_EQ(alpha(5, 5), 0);
  // moving out of the structure, there is one opaque pixel before the outside
  int column = 100;
  while (alpha(column, 100) == std::lround(255 * 0.3)) ++column;
  EXPECT_EQ(alpha(column, 100), 255);
  EXPECT_EQ(alpha(column + 1, 100), 0);
  // radius of 6 mm, within a voxel
  EXPECT_NEAR((column - 99.5) * plane.mm_per_px(), 6, 0.8);

  // hidden tissues are not drawn, not even as an outline
  model.tissues[0].opacity = 0;
  for (const std::uint8_t byte : render_structure_layer(model, plane).rgba) ASSERT_EQ(byte, 0);
}

TEST(Layers, SectionIsTheScanUnderTheStructures) {
  Model model = two_balls(grid_with(Eigen::Matrix3d::Identity()));
  model.scan = std::make_shared<const Volume<float>>(model.labels->geometry(), 0.5f);
  const SectionPlane plane = anatomical_section(AnatomicalPlane::kAxial, kMiddle, 40, 100, 100);
  const Image image = render_section(model, plane, {0, 1, 0.4, true, 256});
  const Rgb grey = pixel(image, {2, 50}), mixed = pixel(image, {50, 50});
  EXPECT_EQ(grey, (Rgb{128, 128, 128}));
  EXPECT_NEAR(mixed.r, 0.6 * 128 + 0.4 * kFemurPaint.r, 1);
  EXPECT_NEAR(mixed.g, 0.6 * 128 + 0.4 * kFemurPaint.g, 1);
  EXPECT_NEAR(mixed.b, 0.6 * 128 + 0.4 * kFemurPaint.b, 1);
}

TEST(Layers, PlanesFarAwayOrNotFiniteShowBackground) {
  Model model = two_balls(grid_with(Eigen::Matrix3d::Identity()));
  model.scan = std::make_shared<const Volume<float>>(model.labels->geometry(), 0.5f);
  for (const double where : {1e6, 1e300, std::numeric_limits<double>::quiet_NaN()}) {
    const SectionPlane plane =
        anatomical_section(AnatomicalPlane::kCoronal, Point<Patient>(0, where, 0), 50, 16, 16);
    for (const std::uint8_t byte : render_section(model, plane).rgb) ASSERT_EQ(byte, 14) << where;
  }
}

TEST(Layers, EmptyModelIsADarkPicture) {
  const SectionPlane plane = anatomical_section(AnatomicalPlane::kAxial, Point<Patient>(), 50, 16, 9);
  const Image image = render_section(Model{}, plane);
  ASSERT_EQ(image.rgb.size(), 3u * 16 * 9);
  for (const std::uint8_t byte : image.rgb) ASSERT_EQ(byte, 26);
}

}  // namespace
}  // namespace palpate
