#include "palpate/rendering/volume_picture.h"

#include <gtest/gtest.h>

#include "sampling/test_targets.h"

namespace palpate {
namespace {

constexpr ViewFrom kAll[] = {ViewFrom::kAnterior, ViewFrom::kPosterior, ViewFrom::kLeft,
                             ViewFrom::kRight,    ViewFrom::kSuperior,  ViewFrom::kInferior};

VolumePictureRequest request_from(ViewFrom from, double turn_deg = 0, double tilt_deg = 0) {
  VolumePictureRequest request;
  request.from = from;
  request.turn_deg = turn_deg;
  request.tilt_deg = tilt_deg;
  request.pixels = kMinSectionPixels;
  return request;
}

void expect_near(const Vector<Patient>& a, const Vector<Patient>& b) {
  EXPECT_LT((a - b).norm(), 1e-12) << a.eigen().transpose() << ", not " << b.eigen().transpose();
}

TEST(VolumePicture, HangsAsInRadiology) {
  const GridGeometry grid = test::make_grid({20, 30, 40}, 3);
  for (const ViewFrom from : kAll) {
    const VolumeCamera camera = camera_of(grid, request_from(from));
    expect_near(camera.into(), -direction_to(from));
    EXPECT_NEAR(camera.right.dot(camera.down), 0, 1e-12);
  }
  // the patient's left is on the right from the front and from the feet; anterior is on the left from the
  // left
  expect_near(camera_of(grid, request_from(ViewFrom::kAnterior)).right, {1, 0, 0});
  expect_near(camera_of(grid, request_from(ViewFrom::kInferior)).right, {1, 0, 0});
  expect_near(camera_of(grid, request_from(ViewFrom::kLeft)).right, {0, 1, 0});
  // from the front, a quarter turn leads to the left, and a tilt by 90 degrees to the head
  expect_near(camera_of(grid, request_from(ViewFrom::kAnterior, 90)).into(), {-1, 0, 0});
  expect_near(camera_of(grid, request_from(ViewFrom::kAnterior, 0, 90)).into(), {0, 0, -1});
}

TEST(VolumePicture, ShowsAllOfTheVolume) {
  for (int kind = 0; kind < 4; ++kind) {
    const GridGeometry grid = test::make_grid({20, 30, 40}, kind);
    for (const bool perspective : {false, true}) {
      VolumePictureRequest request = request_from(ViewFrom::kLeft, 25, -30);
      request.perspective = perspective;
      const VolumeCamera camera = camera_of(grid, request);
      double largest = 0;
      for (int corner = 0; corner < 8; ++corner) {
        const Point<Voxel> voxel((corner & 1) != 0 ? 19.5 : -0.5, (corner & 2) != 0 ? 29.5 : -0.5,
                                 (corner & 4) != 0 ? 39.5 : -0.5);
        const Vector<Patient> off = grid.X_PatientVoxel() * voxel - camera.focus;
        const double larger = perspective ? camera.eye_mm / (camera.eye_mm + off.dot(camera.into())) : 1;
        for (const Vector<Patient>& displacement : {camera.right, camera.down})
          largest = std::max(largest, std::abs(off.dot(displacement)) * larger / (camera.width_mm / 2));
      }
      EXPECT_LE(largest, 1);
      EXPECT_GE(largest, 0.8);
    }
  }
}

/// A block in the patient's left half appears at its position; clipped parts do not.
TEST(VolumePicture, DrawsStructuresWhereTheyAre) {
  GridGeometry grid = test::make_grid({40, 40, 40}, 0);
  Volume<LabelId> labels(grid);
  for (int k = 10; k < 30; ++k)
    for (int j = 10; j < 30; ++j)
      for (int i = 22; i < 38; ++i) labels.at(i, j, k) = 1;
  Model model;
  model.labels = label_bricks(labels);
  model.segments.push_back({1, "block", {200, 30, 20}, 0, 1});
  model.side = Side::kLeft;
  const std::vector<StructureAppearance> appearances = structure_appearances(model);
  auto renderer = VolumeRenderer::make(*model.labels, appearances);
  ASSERT_TRUE(renderer);
  const auto reds = [&](const VolumePictureRequest& request) {
    const Image image = volume_picture(*renderer, model, appearances, request);
    std::array<int, 2> halves{};
    for (int y = image.height / 4; y < image.height * 3 / 4; ++y)
      for (int x = 0; x < image.width; ++x) {
        const std::uint8_t* pixel = &image.rgb[3 * (static_cast<std::size_t>(y) * image.width + x)];
        if (pixel[0] > 100 && pixel[1] < 80 && pixel[2] < 80) ++halves[x < image.width / 2 ? 0 : 1];
      }
    return halves;
  };
  const auto front = reds(request_from(ViewFrom::kAnterior)), back = reds(request_from(ViewFrom::kPosterior));
  EXPECT_EQ(front[0], 0);
  EXPECT_GT(front[1], 5000);
  EXPECT_EQ(back[1], 0);
  EXPECT_GT(back[0], 5000);
  VolumePictureRequest cut = request_from(ViewFrom::kAnterior);
  cut.cut = ViewFrom::kLeft;
  EXPECT_EQ(reds(cut), (std::array{0, 0}));
  cut.cut = ViewFrom::kRight;
  EXPECT_EQ(reds(cut)[0], 0);
  EXPECT_NEAR(reds(cut)[1], front[1], 0.01 * front[1]);
}

}  // namespace
}  // namespace palpate
