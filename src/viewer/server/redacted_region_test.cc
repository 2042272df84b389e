#include "server/redacted_region.h"

#include <gtest/gtest.h>

#include "palpate/tasks/task.h"

namespace palpate::server {
namespace {

using Extent = ViewedTask::Region::Extent;

std::array<double, 3> numbers(const Eigen::Vector3d& v) {
  return {v.x(), v.y(), v.z()};
}

/// A slab of label 1 with a block of label 2 on its left end, which has contact, and one of label 3 beside
/// it, which has none.
Volume<LabelId> slab() {
  GridGeometry grid;
  grid.dims = {40, 24, 16};
  grid.spacing_mm = {0.5, 0.6, 0.8};
  grid.origin = Point<Patient>(-4, 3, 7);
  Volume<LabelId> labels(grid);
  for (int k = 4; k < 12; ++k)
    for (int j = 4; j < 18; ++j)
      for (int i = 4; i < 34; ++i) labels.at(i, j, k) = LabelId(k < 8 ? 1 : i < 10 ? 2 : i < 16 ? 3 : 0);
  return labels;
}

// implemented in two modules that may not depend on each other, while a page shows either
TEST(RedactedRegion, EqualsTheSessionsRegionView) {
  const Volume<LabelId> labels = slab();
  Model model;
  model.labels = label_bricks(labels);
  model.segments = {{1, "slab", {}, 0, 1}, {2, "block", {}, 0, 2}, {3, "fluff", {}, 0, 3}};
  model.tissues.resize(2);
  model.tissues[1].touchable = false;
  model.tissue_of_label = {-1, 0, 0, 1};
  ViewedScene scene;
  scene.labels = model.labels;
  scene.structures = {{1, "slab", {}, 0}, {2, "block", {}, 0}, {3, "fluff", {}, 1}};
  scene.tissues = {{"touchable", true, {}, 1, {}}, {"not felt", false, {}, 1, {}}};

  std::vector<std::pair<std::string, Extent>> regions;
  regions.emplace_back("structures = [\"slab\"]", Extent{{1}, {}, {}, {}, 0, {}});
  regions.emplace_back("structures = [\"slab\", \"block\"]\nhalf = \"left\"",
                       Extent{{1, 2}, {}, {}, std::array{1.0, 0.0, 0.0}, 0, {}});
  regions.emplace_back("structures = [\"slab\"]\nlandmark = \"left\"\nradius = 4",
                       Extent{{1}, {}, std::array{1.0, 0.0, 0.0}, {}, 4, {}});
  regions.emplace_back("structures = [\"slab\"]\nplane_point = [6, 6, 11]\nplane_normal = \"superior\"",
                       Extent{{1}, {}, {}, {}, 0, {{{6, 6, 11}, {0, 0, 1}}}});
  regions.emplace_back("structures = [\"block\"]\npoint = [2, 9, 15]\nradius = 2.5",
                       Extent{{2}, std::array{2.0, 9.0, 15.0}, {}, {}, 2.5, {}});
  for (const auto& [text, extent] : regions) {
    SCOPED_TRACE(text);
    const auto task =
        parse_task("title = \"T\"\n[[region]]\nname = \"r\"\n" + text +
                       "\n[[step]]\nname = \"s\"\nregion = \"r\"\n[[metric]]\nname = \"time\"\n",
                   "task.toml");
    ASSERT_TRUE(task.ok()) << task.error().message();
    const auto found = resolve_task(*task, model);
    ASSERT_TRUE(found.ok()) << found.error().message();
    const RegionView view = view_of(found->regions[0], model);
    const ViewedTask::Region region = region_in(scene, {"r", {}, 0, {}, extent});
    EXPECT_EQ(region.centre_mm, numbers(view.centre_mm));
    EXPECT_EQ(region.radius_mm, view.radius_mm);
    EXPECT_EQ(region.outward, numbers(view.outward));
    const RegionExtent of_region(*scene.labels, extent);
    for (double x = -4; x < 16; x += 1.7)
      for (double z = 7; z < 20; z += 1.3)
        EXPECT_EQ(of_region.contains_point({x, 9, z}), found->regions[0].contains_point({x, 9, z}))
            << x << " " << z;
  }
}

TEST(RedactedRegion, WithoutVoxelsCoversTheWholeVolume) {
  ViewedScene scene;
  scene.labels = label_bricks(slab());
  scene.structures = {{1, "slab", {}, -1}};
  const auto whole = region_in(scene, {"r", {1, 2, 3}, 4, {0, 0, 1}});
  const auto none = region_in(scene, {"r", {1, 2, 3}, 4, {0, 0, 1}, Extent{{7}, {}, {}, {}, 0, {}}});
  EXPECT_EQ(whole.centre_mm, numbers(scene.labels->geometry().centre().eigen()));
  EXPECT_EQ(none.centre_mm, whole.centre_mm);
  EXPECT_EQ(none.radius_mm, whole.radius_mm);
  EXPECT_EQ(whole.outward, (std::array<double, 3>{}));
  // a sphere does not depend on labels
  const auto ball =
      region_in(scene, {"r", {1, 2, 3}, 4, {}, Extent{{}, std::array{1.0, 2.0, 3.0}, {}, {}, 4, {}}});
  EXPECT_EQ(ball.centre_mm, (std::array<double, 3>{1, 2, 3}));
  EXPECT_EQ(ball.radius_mm, 4);
}

}  // namespace
}  // namespace palpate::server
