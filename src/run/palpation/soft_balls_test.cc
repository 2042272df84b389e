// A ball of each tissue preset, palpated by the default hand in the scene recommended for it.
#include <gtest/gtest.h>

#include <string>

#include "base/test_files.h"
#include "palpate/loading/loading.h"
#include "palpate/palpation/palpation.h"
#include "palpate/volume_io/write_volume.h"

namespace palpate {
namespace {

LabelMap ball(const std::string& name, int radius_mm) {
  GridGeometry grid;
  const int edge = 2 * radius_mm + 16;
  grid.dims = {edge, edge, edge};
  LabelMap map;
  map.layers.emplace_back(grid);
  const Eigen::Vector3d centre = Eigen::Vector3d::Constant(radius_mm + 8);
  for (int k = 0; k < edge; ++k)
    for (int j = 0; j < edge; ++j)
      for (int i = 0; i < edge; ++i)
        map.layers[0].at(i, j, k) = (Eigen::Vector3d(i, j, k) - centre).norm() < radius_mm;
  map.segments = {{1, name, {}, 0, 1}};
  return map;
}

class SoftBalls : public ::testing::TestWithParam<const char*> {};

TEST_P(SoftBalls, AreHeldByTheDefaultHand) {
  for (const int radius_mm : {8, 16}) {
    SCOPED_TRACE(::testing::Message() << "radius " << radius_mm << " mm");
    const test::TemporaryFolder folder;
    const auto file = folder / "ball.seg.nrrd";
    ASSERT_TRUE(write_labels(file, ball(GetParam(), radius_mm)).ok());
    auto loaded = load_scene_or_data_set({file.string()});
    ASSERT_TRUE(loaded.ok()) << loaded.error().message();
    ASSERT_EQ(loaded->scene.tissues.size(), 1u);
    EXPECT_TRUE(loaded->scene.tissues[0].touchable);
    const auto result = simulate(*loaded, {}, {}, {});
    ASSERT_TRUE(result.ok()) << result.error().message();
    EXPECT_EQ(result->failed_steps, 0u) << (result->problems.empty() ? "" : result->problems.back());
    ASSERT_EQ(result->holds.size(), 1u);
    EXPECT_GE(result->holds[0].held_s, 0.7);
  }
}

INSTANTIATE_TEST_SUITE_P(Presets, SoftBalls,
                         ::testing::Values("bone", "cartilage", "meniscus", "disc", "ligament", "muscle",
                                           "fat", "skin", "vessel", "nerve", "kidney", "spleen", "lung",
                                           "heart", "gland", "lymph node", "tumour", "brain", "liver"),
                         [](const auto& preset) {
                           std::string name = preset.param;
                           std::erase(name, ' ');
                           return name;
                         });

}  // namespace
}  // namespace palpate
