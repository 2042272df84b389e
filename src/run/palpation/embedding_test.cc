// Organs in an otherwise empty abdomen, embedded in a tissue of the unlabelled voxels inside the body.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <string>
#include <vector>

#include "base/test_files.h"
#include "palpate/loading/loading.h"
#include "palpate/palpation/run_setup.h"
#include "palpate/scene/named_values.h"
#include "palpate/scene/new_scene.h"
#include "palpate/volume_io/write_volume.h"
#include "palpation/force_sweep.h"

namespace palpate {
namespace {

using ::testing::HasSubstr;

constexpr double kVoxel_mm = 1.5;
constexpr LabelId kLiver = 1, kKidney = 2, kSkin = 3;

struct Abdomen {
  LabelMap labels;
  Volume<float> scan;
};

// a cylinder of 40 mm along the patient's axis, which the volume cuts, with a liver of 14 mm and a kidney of
// 8 mm
Abdomen abdomen(bool with_skin) {
  GridGeometry grid;
  grid.dims = {60, 60, 40};
  grid.spacing_mm = Eigen::Vector3d::Constant(kVoxel_mm);
  Abdomen made{{}, Volume<float>(grid)};
  made.labels.layers.emplace_back(grid);
  const Eigen::Vector3d centre(44, 44, 29), liver(34, 38, 29), kidney(62, 54, 29);
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) {
        const Eigen::Vector3d at = kVoxel_mm * Eigen::Vector3d(i, j, k);
        const double from_axis_mm = (at - centre).head<2>().norm();
        made.scan.at(i, j, k) =
            from_axis_mm < 40 ? 20.0f + static_cast<float>((i * 7 + j * 5 + k) % 9) : -1000;
        LabelId& label = made.labels.layers[0].at(i, j, k);
        if ((at - liver).norm() < 14) label = kLiver;
        if ((at - kidney).norm() < 8) label = kKidney;
        if (with_skin && from_axis_mm < 40 && from_axis_mm > 37) label = kSkin;
      }
  made.labels.segments = {{kLiver, "liver", {}, 0, kLiver}, {kKidney, "kidney_left", {}, 0, kKidney}};
  if (with_skin) made.labels.segments.push_back({kSkin, "skin", {}, 0, kSkin});
  return made;
}

struct Bedded {
  std::string scene;
  LoadedScene loaded;
};

Result<Bedded> bedded(const Abdomen& abdomen, bool with_scan, TissueLaw law) {
  const test::TemporaryFolder folder;
  const auto labels = folder / "labels.seg.nrrd", scan = folder / "ct.nrrd";
  PALPATE_CHECK(write_labels(labels, abdomen.labels).ok() && write_volume(scan, abdomen.scan).ok());
  NewSceneInput input;
  input.labels = labels;
  input.label_map = &abdomen.labels;
  if (with_scan) {
    input.scan = scan;
    input.scan_volume = &abdomen.scan;
  }
  input.law = law;
  input.embed = true;
  const auto text = new_scene_text(input, folder.path());
  PALPATE_CHECK(text.ok());
  auto loaded = load_scene_or_data_set({test::write_text(folder / "scene.toml", *text).string()});
  if (!loaded) return loaded.error();
  return Bedded{*text, *std::move(loaded)};
}

class Embedding : public ::testing::TestWithParam<TissueLaw> {};

TEST_P(Embedding, APressAtTheSkinReachesTheOrgansWithSmallForcesThatRise) {
  for (const bool with_skin : {true, false}) {
    SCOPED_TRACE(with_skin ? "within a labelled skin" : "within a scan");
    const auto made = bedded(abdomen(with_skin), !with_skin, GetParam());
    ASSERT_TRUE(made.ok()) << made.error().message();
    EXPECT_THAT(made->scene, HasSubstr("embedding = true"));
    EXPECT_EQ(made->scene.find("air_below") != std::string::npos, !with_skin);
    const auto setup = set_up_run(made->loaded, Script{}, {}, {});
    ASSERT_TRUE(setup.ok()) << setup.error().message();
    const Model& model = *setup->model;
    const LabelId embedding = model.find("embedding")->id;
    EXPECT_LT(model.tissue_of(embedding)->opacity, 0.5);
    for (const LabelId organ : {kLiver, kKidney})
      EXPECT_LT(model.tissue_of(embedding)->stiffness_N_per_mm, model.tissue_of(organ)->stiffness_N_per_mm);

    // from the front (LPS: -y) onto the liver's middle, whose surface lies 20 mm below the skin; deformable
    // tissue is pressed to a third of its thickness
    const bool is_layered = GetParam() == TissueLaw::kLayers;
    const double depth_mm = is_layered ? 30 : 27;
    const Point<Patient> start(34, -4, 29);
    const auto swept = sweep_force(model, setup->parameters, start, {0, 1, 0}, depth_mm, 1000);
    ASSERT_FALSE(swept.empty());
    EXPECT_EQ(swept.front().label, with_skin ? kSkin : embedding);
    EXPECT_GE(swept.back().depth_mm, depth_mm - 0.1) << "the contact was lost";
    // with layers the tip ends inside the liver, unless a stiffer skin carries all of the force; deformable
    // tissue displaces the liver, whose depth of 20 mm hides it from a tip of this radius
    if (is_layered) {
      EXPECT_EQ(swept.back().deepest, with_skin ? kSkin : kLiver);
    }
    const auto beside = sweep_force(model, setup->parameters, {34, -4, 52}, {0, 1, 0}, depth_mm, 1000);
    ASSERT_FALSE(beside.empty());
    if (!with_skin && is_layered) {
      EXPECT_GT(swept.back().force_N, 1.05 * beside.back().force_N);
    }
    double before_N = 0;
    for (const SweptForce& at : swept) {
      EXPECT_GE(at.force_N, before_N - 0.02) << at.depth_mm;
      before_N = at.force_N;
    }
    EXPECT_GT(swept.back().force_N, 0.05);
    EXPECT_LT(swept.back().force_N, 12);
  }
}

INSTANTIATE_TEST_SUITE_P(Laws, Embedding, ::testing::Values(TissueLaw::kLayers, TissueLaw::kElastic),
                         [](const auto& law) { return std::string(name_of(law.param, kTissueLaws)); });

TEST(EmbeddingError, ReportsAnEmptyInside) {
  const auto made = bedded(abdomen(false), false, TissueLaw::kLayers);
  ASSERT_FALSE(made.ok());
  EXPECT_THAT(made.error().what, HasSubstr("no unlabelled voxel lies inside the body"));
  EXPECT_THAT(made.error().remedy, HasSubstr("name the scan"));
}

}  // namespace
}  // namespace palpate
