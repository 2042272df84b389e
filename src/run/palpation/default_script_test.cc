// Tests of the default script: which structures it presses, and how it reports those that it cannot reach.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdio>
#include <string>
#include <vector>

#include "base/test_files.h"
#include "palpate/loading/loading.h"
#include "palpate/palpation/palpation.h"
#include "palpate/scene/new_scene.h"
#include "palpate/volume_io/write_volume.h"

namespace palpate {
namespace {

using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr int kEdge = 48;

struct Ball {
  Eigen::Vector3d centre;
  double radius_mm;
  LabelId label;
};

// later balls overwrite earlier ones
LabelMap balls(const std::vector<Ball>& balls, std::vector<std::string> names) {
  GridGeometry grid;
  grid.dims = {kEdge, kEdge, kEdge};
  LabelMap map;
  map.layers.emplace_back(grid);
  for (int k = 0; k < kEdge; ++k)
    for (int j = 0; j < kEdge; ++j)
      for (int i = 0; i < kEdge; ++i)
        for (const Ball& ball : balls)
          if ((Eigen::Vector3d(i, j, k) - ball.centre).norm() < ball.radius_mm)
            map.layers[0].at(i, j, k) = ball.label;
  for (std::size_t n = 0; n < names.size(); ++n)
    map.segments.push_back({static_cast<LabelId>(n + 1), names[n], {}, 0, static_cast<LabelId>(n + 1)});
  return map;
}

Result<SimulationResult> palpated(const LabelMap& labels, const std::string& more_of_scene = "",
                                  const SimulationOptions& options = {}) {
  const test::TemporaryFolder folder;
  const auto file = folder / "labels.seg.nrrd";
  PALPATE_CHECK(write_labels(file, labels).ok());
  NewSceneInput input;
  input.labels = file;
  input.label_map = &labels;
  const auto text = new_scene_text(input, folder.path());
  PALPATE_CHECK(text.ok());
  auto loaded =
      load_scene_or_data_set({test::write_text(folder / "scene.toml", *text + more_of_scene).string()});
  if (!loaded) return loaded.error();
  return simulate(*loaded, {}, options, {});
}

const Eigen::Vector3d kMiddle = Eigen::Vector3d::Constant(0.5 * kEdge);

TEST(DefaultScript, ACoveredStructureIsNamedWithItsCover) {
  const auto result = palpated(balls({{kMiddle, 16, 2}, {kMiddle, 10, 1}}, {"brain", "skull"}));
  ASSERT_TRUE(result.ok()) << result.error().message();
  EXPECT_EQ(result->failed_steps, 0u);
  EXPECT_THAT(result->problems, ElementsAre("brain is not palpated: it is covered by skull"));
  ASSERT_EQ(result->holds.size(), 1u);
  EXPECT_EQ(result->holds[0].structure, "skull");
  EXPECT_EQ(result->summary.problems, result->problems);
}

TEST(DefaultScript, NamesObstructedStructuresAndTheObstacle) {
  // a shell around a hollow around the brain
  const auto result =
      palpated(balls({{kMiddle, 21, 2}, {kMiddle, 18, 0}, {kMiddle, 10, 1}}, {"brain", "skull"}));
  ASSERT_TRUE(result.ok()) << result.error().message();
  EXPECT_EQ(result->failed_steps, 0u);
  EXPECT_THAT(result->problems,
              ElementsAre("brain is not palpated: there is no free path to it: skull is in front of it"));
}

TEST(DefaultScript, NamesABlockingNoGoRegion) {
  const auto labels = balls({{{14, 24, 24}, 8, 1}, {{36, 24, 24}, 6, 2}}, {"muscle", "femur"});
  const auto result = palpated(labels,
                               "\n[[no_go]]\nname = \"around the femur\"\ncentre = [36, 24, 24]\nradius = 9\n"
                               "keep_away = 1\nstiffness = 1\n");
  ASSERT_TRUE(result.ok()) << result.error().message();
  EXPECT_EQ(result->failed_steps, 0u);
  EXPECT_THAT(result->problems,
              Contains("femur is not palpated: the no-go region around the femur keeps the tool "
                       "away from it"));
}

TEST(DefaultScript, SoftStructurePressMatchesTheMethodsDescent) {
  for (const ForceMethod method : {ForceMethod::kProxy, ForceMethod::kTrilinear}) {
    SCOPED_TRACE(name_of(method));
    SimulationOptions options;
    options.method = method;
    const auto result = palpated(balls({{kMiddle, 16, 1}}, {"liver"}), "", options);
    ASSERT_TRUE(result.ok()) << result.error().message();
    EXPECT_EQ(result->failed_steps, 0u);
    ASSERT_EQ(result->problems.size(), 1u);
    double press_N = 0, depth_mm = 0, reached_N = 0;
    char by[20] = "";
    ASSERT_EQ(std::sscanf(result->problems[0].c_str(),
                          "liver is pressed with %lf N: a descent of %lf mm gives %lf N (%18[a-z])", &press_N,
                          &depth_mm, &reached_N, by),
              4)
        << result->problems[0];
    EXPECT_EQ(by, name_of(method));
    EXPECT_LE(press_N, std::max(0.05, 0.61 * reached_N));
    ASSERT_EQ(result->holds.size(), 1u);
    EXPECT_NEAR(result->holds[0].mean_force_N, press_N, 0.3 * press_N);
  }
}

TEST(DefaultScript, ErrorExplainsWhyNothingIsReachable) {
  auto labels = balls({{kMiddle, 16, 2}, {kMiddle, 10, 1}}, {"brain", "something"});
  // the cover is not felt, and the brain adjoins the border of the scan on all sides
  for (LabelId& label : labels.layers[0].voxels()) label = 1;
  const auto result = palpated(labels);
  ASSERT_FALSE(result.ok());
  EXPECT_THAT(result.error().what,
              HasSubstr("the tool cannot reach any touchable structure: brain is not palpated: "
                        "the scan cuts it off on all sides"));
}

}  // namespace
}  // namespace palpate
