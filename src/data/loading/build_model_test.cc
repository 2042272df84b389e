#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <string>
#include <utility>

#include "base/test_files.h"
#include "palpate/direct/direct_methods.h"
#include "palpate/loading/loading.h"
#include "palpate/palpation/palpation.h"
#include "palpate/scene/tissue_presets.h"
#include "palpate/volume_io/volume_io.h"

namespace palpate {
namespace {

constexpr const char* kScene = R"(
title = "two balls"
[[tissue]]
name = "bone"
labels = ["hard", 2]
stiffness = 1.5
[[tissue]]
name = "cartilage"
labels = ["soft"]
stiffness = 0.5
rests_on = ["bone"]
[[tissue]]
name = "fat"
labels = ["shown"]
touchable = false
stiffness = 0.1
[preparation]
method = "union-gaussian"
sigma = 1.0
)";

GridGeometry grid_of(double spacing_mm, int n, Point<Patient> origin = {}) {
  GridGeometry grid;
  grid.dims = {n, n, n};
  grid.spacing_mm = Eigen::Vector3d::Constant(spacing_mm);
  grid.origin = origin;
  return grid;
}

// blocks of labels 1 ... 4 along x
LabelMap blocks(const GridGeometry& grid) {
  LabelMap map;
  map.layers.emplace_back(grid);
  for (int k = 8; k < grid.dims[2] - 8; ++k)
    for (int j = 8; j < grid.dims[1] - 8; ++j)
      for (int i = 0; i < grid.dims[0]; ++i)
        map.layers[0].at(i, j, k) = static_cast<LabelId>(1 + 4 * i / grid.dims[0]);
  map.segments = {{1, "hard", {1, 2, 3}, 0, 1},
                  {2, "also hard", {}, 0, 2},
                  {3, "soft", {}, 0, 3},
                  {4, "shown", {}, 0, 4}};
  return map;
}

Scene scene_of(const std::string& text) {
  auto scene = parse_scene(text, "test.toml");
  EXPECT_TRUE(scene.ok()) << (scene.ok() ? "" : scene.error().message());
  return *scene;
}

// error message if touchable tissue is required and there is none; such a model can still be displayed
std::string why_not_touchable(const Scene& scene, const Result<std::shared_ptr<const Model>>& model) {
  if (!model) return "no model: " + model.error().message();
  const auto touchable = require_touchable_tissue({scene, *model, ""});
  return touchable ? "" : touchable.error().what;
}

// an unfinished scene: no tissue is touchable, or none of them has a voxel
TEST(BuildModel, BuildsADisplayModelWithoutTouchableTissue) {
  const LabelMap labels = blocks(grid_of(1, 40));
  for (const char* preparation : {"", "[preparation]\nmethod = \"union-gaussian\"\nbits = 8\n"})
    for (const char* tissue : {"labels = [1]\ntouchable = false\n", "labels = [9]\noptional = true\n"}) {
      const Scene scene = scene_of("[[tissue]]\nname = \"a\"\n" + std::string(tissue) + preparation);
      const auto model = build_model(scene, &labels, nullptr);
      ASSERT_TRUE(model.ok()) << model.error().message();
      EXPECT_FALSE(has_touchable_tissue(**model));
      EXPECT_EQ((*model)->labels->dense().voxels(), labels.layers[0].voxels());
      const Volume<float> field = (*model)->field->values();
      EXPECT_TRUE(std::all_of(field.voxels().begin(), field.voxels().end(), [](float v) { return v == 0; }));
      EXPECT_EQ((*model)->force_field(ForceMethod::kTrilinear).sample(Point<Patient>(20, 20, 20)).value, 0);
      // every method either becomes ready or returns an error; none of them crashes
      for (const ForceMethodInfo& info : kForceMethods)
        (void)prepared_with_cache(*model, {&info.method, 1}).ok();

      const LoadedScene loaded{scene, *model, ""};
      const auto touchable = require_touchable_tissue(loaded);
      ASSERT_FALSE(touchable.ok());
      EXPECT_EQ(touchable.error().kind, ErrorKind::kBadInput);
      EXPECT_FALSE(simulate(loaded, Script{}, {}, "").ok());
    }
  const auto is_touchable = build_model(scene_of(kScene), &labels, nullptr);
  EXPECT_TRUE(has_touchable_tissue(**is_touchable));
}

TEST(BuildModel, LabelsBecomeTissuesLevelsAndAForce) {
  const LabelMap labels = blocks(grid_of(1, 40));
  const auto model = build_model(scene_of(kScene), &labels, nullptr);
  ASSERT_TRUE(model.ok()) << model.error().message();
  const Model& m = **model;
  EXPECT_EQ(m.tissue_of(1)->name, "bone");
  EXPECT_EQ(m.tissue_of(2)->name, "bone");
  EXPECT_EQ(m.tissue_of(3)->name, "cartilage");
  EXPECT_FALSE(m.is_touchable(4));
  EXPECT_EQ(m.tissues[1].rests_on, std::vector<int>{0});
  EXPECT_NEAR(m.level_of_label[3], 0.5 / 1.5, 1.0 / 255);
  EXPECT_EQ(m.level_of_label[4], 0.f);
  EXPECT_NEAR(m.force_field(ForceMethod::kTrilinear).full_force_N(), 1.5 * std::sqrt(2 * M_PI), 1e-9);
  // the field reaches the weights deep inside, and 0 for tissues that are not touchable
  EXPECT_NEAR(sample_value(*m.field, Point<Patient>(10, 20, 20)), 1, 1e-3);
  EXPECT_NEAR(sample_value(*m.field, Point<Patient>(25, 20, 20)), 0.5 / 1.5, 4e-3);
  EXPECT_NEAR(sample_value(*m.field, Point<Patient>(36, 20, 20)), 0, 1e-3);
}

TEST(BuildModel, HashDependsOnHapticPropertiesOnly) {
  const LabelMap labels = blocks(grid_of(1, 30));
  const auto hash_of = [&](const std::string& text) {
    return (*build_model(scene_of(text), &labels, nullptr))->content_hash;
  };
  const std::string text = kScene;
  EXPECT_EQ(hash_of(text), hash_of(text));
  const auto changed = [&](const std::string& from, const std::string& to) {
    std::string other = text;
    other.replace(other.find(from), from.size(), to);
    return other;
  };
  EXPECT_EQ(hash_of(text), hash_of(changed("two balls", "another title")));
  EXPECT_NE(hash_of(text), hash_of(changed("stiffness = 0.5", "stiffness = 0.6")));
  EXPECT_NE(hash_of(text), hash_of(changed("sigma = 1.0", "sigma = 1.1")));
  LabelMap other = labels;
  other.layers[0].at(10, 10, 10) = 0;
  EXPECT_NE(hash_of(text), (*build_model(scene_of(text), &other, nullptr))->content_hash);
}

TEST(BuildModel, HashFollowsEveryTool) {
  const LabelMap labels = blocks(grid_of(1, 30));
  const auto hash_with = [&](const std::string& tools) {
    const auto model =
        build_model(scene_of("[[tissue]]\nname = 'bone'\nlabels = [1]\n" + tools), &labels, nullptr);
    PALPATE_CHECK(model.ok());
    return (*model)->content_hash;
  };
  std::vector<std::uint64_t> hashes;
  for (const char* tools :
       {"", "[tool]\nradius = 1\n", "[second_tool]\n", "[second_tool]\nradius = 1\n",
        "[tool]\nradius = 1\n[second_tool]\n", "[tool]\npoints = [[0, 0, 0], [0, 0, 0]]\n",
        "[tool]\nkind = 'burr'\n", "[second_tool]\nkind = 'burr'\n",
        "[tool]\nkind = 'burr'\n[second_tool]\nkind = 'burr'\npedal = 2\n"})
    hashes.push_back(hash_with(tools));
  std::ranges::sort(hashes);
  EXPECT_EQ(std::ranges::adjacent_find(hashes), hashes.end());
  // cutting energies are part of the hash with every tool
  const auto with_energy = [&](const std::string& table) {
    return hash_with("cutting_energy = 50\n[" + table + "]\nkind = 'burr'\n");
  };
  EXPECT_NE(with_energy("second_tool"), hash_with("[second_tool]\nkind = 'burr'\n"));
  EXPECT_NE(hash_with("cutting_energy = 50\n[second_tool]\n"), hash_with("[second_tool]\n"));
}

// the law may change during a session, so the moduli belong to the hash under every law
TEST(BuildModel, HashFollowsModuliUnderEveryLaw) {
  const LabelMap labels = blocks(grid_of(1, 30));
  const auto model_with = [&](const std::string& rest) {
    const auto model =
        build_model(scene_of("[[tissue]]\nname = 'bone'\nlabels = [1]\n" + rest), &labels, nullptr);
    PALPATE_CHECK(model.ok());
    return *model;
  };
  const auto hash_with = [&](const std::string& rest) { return model_with(rest)->content_hash; };
  const std::string modulus = "youngs_modulus = 10\n", ratio = "poissons_ratio = 0.3\n",
                    elastic = "[yielding]\nlaw = 'elastic'\n";
  EXPECT_EQ(hash_with(modulus), hash_with(modulus + "[yielding]\nlaw = 'layers'\n"));
  EXPECT_EQ(hash_with(modulus + elastic), hash_with(modulus + elastic + "relaxation = true\n"));

  std::vector<std::uint64_t> hashes;
  for (const std::string& rest :
       {std::string(), modulus, modulus + ratio, modulus + "relaxation = [[0.3, 2]]\n", elastic,
        elastic + "cell = 1.5\n", modulus + elastic, modulus + ratio + elastic,
        "youngs_modulus = 11\n" + elastic, modulus + elastic + "cell = 1.5\n",
        modulus + "relaxation = [[0.3, 2]]\n" + elastic, modulus + "relaxation = [[0.3, 3]]\n" + elastic})
    hashes.push_back(hash_with(rest));
  std::ranges::sort(hashes);
  EXPECT_EQ(std::ranges::adjacent_find(hashes), hashes.end());

  const auto model = model_with(modulus + ratio + elastic + "cell = 1.5\n");
  EXPECT_EQ(model->tissue_law, TissueLaw::kElastic);
  EXPECT_EQ(model->tissue_cell_mm, 1.5);
  EXPECT_EQ(model->tissues[0].elastic, (ElasticConstants{10, 0.3}));
  EXPECT_EQ(model_with(elastic)->tissue_cell_mm, 0) << "chosen from the voxels";
  EXPECT_FALSE(model->relaxation_times.any());
  const auto relaxing = model_with(modulus + "relaxation = [[0.3, 9], [0.1, 2]]\n" + elastic);
  EXPECT_EQ(relaxing->relaxation_times.count, 2u);
  EXPECT_EQ(relaxing->relaxation_times.time_s[0], 2);
  EXPECT_TRUE(model_with(modulus + "relaxation = [[0.3, 9]]\n[yielding]\nlaw = 'neo-hookean'\n")
                  ->relaxation_times.any());
  EXPECT_EQ(relaxing->tissues[0].relaxation.total_fraction(), 0.4);
  EXPECT_FALSE(model_with(elastic)->tissues[0].elastic.has_value());
}

TEST(BuildModel, ProtectedStructuresApplyToEveryDevice) {
  const LabelMap labels = blocks(grid_of(1, 30));
  const auto spared = [&](const std::string& tools) {
    const auto model = build_model(
        scene_of("[[tissue]]\nname = 'bone'\nlabels = [1]\nprotection = 'keep'\n" + tools), &labels, nullptr);
    PALPATE_CHECK(model.ok());
    const auto ready = prepared_with_cache(*model, std::array{ForceMethod::kProxy});
    PALPATE_CHECK(ready.ok());
    return std::pair((*ready)->protected_structures.size(), (*ready)->surfaces.at(0).is_protected);
  };
  EXPECT_EQ(spared("[tool]\nkind = 'burr'\n"), (std::pair<std::size_t, bool>(1, true)));
  EXPECT_EQ(spared("[second_tool]\nkind = 'burr'\n"), (std::pair<std::size_t, bool>(1, true)));
  EXPECT_EQ(spared("[second_tool]\n"), (std::pair<std::size_t, bool>(0, false)));
}

TEST(BuildModel, NoGoStructuresAlwaysReportDistances) {
  const LabelMap labels = blocks(grid_of(1, 30));
  const auto reported = [&](const std::string& more) {
    const auto model = build_model(scene_of(std::string(kScene) + more), &labels, nullptr);
    PALPATE_CHECK(model.ok());
    return (*model)->reported_distances.structures;
  };
  const std::string region = "[[no_go]]\nname = 'there'\nstructures = [2]\n",
                    plane = "[[no_go]]\nname = 'behind'\npoint = [0, 0, 0]\noutward = 'left'\n";
  EXPECT_EQ(reported(""), std::vector<LabelId>());
  EXPECT_EQ(reported(plane), std::vector<LabelId>());
  EXPECT_EQ(reported(region), std::vector<LabelId>{2});
  EXPECT_EQ(reported("[distances]\nstructures = 'all'\n" + region),
            reported("[distances]\nstructures = 'all'\n"));
  EXPECT_EQ(reported("[distances]\nreach = 5\n" + region), std::vector<LabelId>{2});
}

TEST(BuildModel, IsReadyForTheScenesMethodAndItsSettingsAreHashed) {
  const LabelMap labels = blocks(grid_of(1, 30));
  const auto hash_with = [&](const std::string& force) {
    const auto model = build_model(scene_of(std::string(kScene) + force), &labels, nullptr);
    PALPATE_CHECK(model.ok());
    return (*model)->content_hash;
  };
  const auto plain = build_model(scene_of(kScene), &labels, nullptr);
  EXPECT_TRUE((*plain)->has(ForceMethod::kTrilinear));
  EXPECT_FALSE((*plain)->has(ForceMethod::kSmoothSphere));
  const auto smooth =
      build_model(scene_of(std::string(kScene) + "[force]\nmethod = 'smooth-sphere'\n"), &labels, nullptr);
  EXPECT_TRUE((*smooth)->has(ForceMethod::kTrilinear));
  EXPECT_TRUE((*smooth)->has(ForceMethod::kSmoothSphere));
  EXPECT_EQ((*smooth)->content_hash, (*plain)->content_hash) << "a run may change the method";
  EXPECT_NE(hash_with("[force]\nsphere_sigma = 1.5\n"), (*plain)->content_hash);
  EXPECT_NE(hash_with("[force]\nnormals = 'octahedral16'\n"), (*plain)->content_hash);
}

TEST(BuildModel, ASphereThatReachesTooFarIsTheScenesError) {
  const LabelMap labels = blocks(grid_of(0.3, 90));
  const auto model =
      build_model(scene_of("[[tissue]]\nname = 'bone'\nlabels = [1]\n[preparation]\nsigma = 10\n"
                           "[force]\nmethod = 'smooth-sphere'\n"),
                  &labels, nullptr);
  ASSERT_FALSE(model.ok());
  EXPECT_EQ(model.error().kind, ErrorKind::kBadInput);
  EXPECT_FALSE(model.error().where.empty());
}

TEST(BuildModel, ABurrTakesTwoVoxels) {
  const std::string scene = "[[tissue]]\nname = 'bone'\nlabels = [1]\n[tool]\nkind = 'burr'\ndiameter = 2\n";
  const LabelMap fine = blocks(grid_of(1, 30)), coarse = blocks(grid_of(1.1, 30));
  EXPECT_TRUE(build_model(scene_of(scene), &fine, nullptr).ok());
  const auto model = build_model(scene_of(scene), &coarse, nullptr);
  ASSERT_FALSE(model.ok());
  EXPECT_EQ(model.error().kind, ErrorKind::kBadInput);
  EXPECT_NE(model.error().message().find("2 mm is too small for voxels of 1.1 mm"), std::string::npos)
      << model.error().message();
  // for a cone the thin end decides
  for (const bool tip : {true, false}) {
    const auto cone =
        build_model(scene_of(scene + "shape = 'cone'\nlength = 8\ntip_diameter = " + (tip ? "1.8\n" : "3\n")),
                    tip ? &fine : &coarse, nullptr);
    ASSERT_FALSE(cone.ok());
    const std::string message = cone.error().message();
    EXPECT_NE(message.find(tip ? "1.8 mm at its tip is too small" : "2 mm is too small"), std::string::npos)
        << message;
    EXPECT_NE(message.find(tip ? "a larger `tip_diameter`" : "a larger `diameter`"), std::string::npos)
        << message;
  }
}

TEST(BuildModel, TheSecondToolsBurrTakesTwoVoxelsToo) {
  const LabelMap coarse = blocks(grid_of(1.1, 30));
  const auto model = build_model(
      scene_of("[[tissue]]\nname = 'bone'\nlabels = [1]\n[second_tool]\nkind = 'burr'\ndiameter = 2\n"),
      &coarse, nullptr);
  ASSERT_FALSE(model.ok());
  EXPECT_NE(model.error().message().find("a larger `diameter` under [second_tool]"), std::string::npos)
      << model.error().message();
}

TEST(BuildModel, AbsentLabelsAreErrorsWithTheirLine) {
  LabelMap labels = blocks(grid_of(1, 30));
  labels.segments.erase(labels.segments.begin() + 2);
  const auto model = build_model(scene_of(kScene), &labels, nullptr);
  ASSERT_FALSE(model.ok());
  EXPECT_NE(model.error().where.find("test.toml:"), std::string::npos) << model.error().message();
  EXPECT_NE(model.error().what.find("soft"), std::string::npos);
}

TEST(BuildModel, ACoarserScanMovesOntoTheLabelsGridWithAWarning) {
  const LabelMap labels = blocks(grid_of(1, 30));
  Volume<float> scan(grid_of(2, 15));
  for (int k = 0; k < 15; ++k)
    for (int j = 0; j < 15; ++j)
      for (int i = 0; i < 15; ++i) scan.at(i, j, k) = static_cast<float>(2 * i);  // its x in mm
  std::vector<std::string> warnings;
  const auto model =
      build_model(scene_of(kScene), &labels, &scan, {}, [&](const std::string& w) { warnings.push_back(w); });
  ASSERT_TRUE(model.ok());
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_NE(warnings[0].find("resampled"), std::string::npos);
  EXPECT_TRUE((*model)->scan->geometry().same_grid(labels.geometry()));
  EXPECT_NEAR((*model)->scan->at(11, 5, 5), 11, 1e-5);
}

TEST(BuildModel, CoarserLabelsMoveOntoTheScansGridByNearestNeighbour) {
  const LabelMap labels = blocks(grid_of(1, 30));
  const Volume<float> scan(grid_of(0.5, 40));
  std::vector<std::string> warnings;
  const auto model =
      build_model(scene_of(kScene), &labels, &scan, {}, [&](const std::string& w) { warnings.push_back(w); });
  ASSERT_TRUE(model.ok());
  EXPECT_EQ(warnings.size(), 2u) << "moved, and part of the labels lies outside";
  EXPECT_TRUE((*model)->labels->geometry().same_grid(scan.geometry()));
  const Volume<LabelId> touchable_labels = (*model)->labels->dense();
  for (const LabelId label : touchable_labels.voxels()) ASSERT_LE(label, 4) << "no label is invented";
  EXPECT_EQ((*model)->labels->at(20, 30, 30), labels.layers[0].at(10, 15, 15));
}

TEST(BuildModel, NoOverlapIsAnError) {
  const LabelMap labels = blocks(grid_of(1, 30));
  const Volume<float> scan(grid_of(2, 15, Point<Patient>(500, 0, 0)));
  const auto model = build_model(scene_of(kScene), &labels, &scan);
  ASSERT_FALSE(model.ok());
  EXPECT_EQ(model.error().kind, ErrorKind::kBadInput);
  EXPECT_NE(model.error().message().find("overlap"), std::string::npos) << model.error().message();
}

TEST(BuildModel, ThresholdTissueOfARawScanIsTouchable) {
  // a ramp of HU along x: 0 at x = 10, 300 at x = 20
  Volume<float> scan(grid_of(1, 40));
  for (int k = 0; k < 40; ++k)
    for (int j = 0; j < 40; ++j)
      for (int i = 0; i < 40; ++i) scan.at(i, j, k) = static_cast<float>(30 * (i - 10));
  const auto model =
      build_model(scene_of("[data]\nscan = \"x.nrrd\"\n[[tissue]]\nname = \"bone\"\nthreshold = [60, 240]\n"
                           "stiffness = 1.0\n[preparation]\nmethod = 'union-gaussian'\nsigma = 0.0\n"),
                  nullptr, &scan);
  ASSERT_TRUE(model.ok()) << model.error().message();
  EXPECT_NEAR(sample_value(*(*model)->field, Point<Patient>(15, 20, 20)), 0.5, 0.01);
  EXPECT_NEAR(sample_value(*(*model)->field, Point<Patient>(12, 20, 20)), 0, 0.01);
  const Segment* bone = (*model)->find("bone");
  ASSERT_NE(bone, nullptr);
  EXPECT_EQ((*model)->labels->at(15, 20, 20), bone->id);
  EXPECT_EQ((*model)->labels->at(14, 20, 20), 0);
  const Point<Patient> x(15, 20, 20);
  const ContactSite site = find_contact_site(**model, x, sample_central_differences(*(*model)->field, x));
  EXPECT_EQ(site.label, bone->id);
}

TEST(BuildModel, NestedSegmentsKeepTheirVoxelsAndWithoutATissueTakeTheOuterOnes) {
  // a block of bone; half of it is a region without a tissue, the other half cartilage
  const GridGeometry grid = grid_of(1, 30);
  LabelMap labels;
  labels.layers.assign(2, Volume<LabelId>(grid));
  for (int k = 8; k < 22; ++k)
    for (int j = 8; j < 22; ++j)
      for (int i = 8; i < 22; ++i) {
        labels.layers[0].at(i, j, k) = 1;
        labels.layers[1].at(i, j, k) = i < 15 ? 1 : 2;
      }
  labels.segments = {{1, "hard", {}, 0, 1}, {2, "region", {}, 1, 1}, {3, "soft", {}, 1, 2}};
  const auto model =
      build_model(scene_of("[[tissue]]\nname = \"bone\"\nlabels = [\"hard\"]\nstiffness = 1.5\n"
                           "[[tissue]]\nname = \"cartilage\"\nlabels = [\"soft\"]\nstiffness = 0.5\n"),
                  &labels, nullptr);
  ASSERT_TRUE(model.ok()) << model.error().message();
  EXPECT_EQ((*model)->labels->at(10, 15, 15), 2);
  EXPECT_EQ((*model)->tissue_of(2)->name, "bone")
      << "a region that no tissue takes is felt as what it lies in";
  EXPECT_EQ((*model)->labels->at(20, 15, 15), 3) << "the innermost is touched, and not the stiffest";
  EXPECT_EQ((*model)->enclosing_suffix(1), "");
  EXPECT_EQ((*model)->enclosing_suffix(2), " (within hard)");
  EXPECT_EQ((*model)->enclosing_suffix(3), " (within hard)");
}

TEST(BuildModel, StiffestOverlappingSegmentIsTouchedAndUntouchableOnesHideNothing) {
  const GridGeometry grid = grid_of(1, 30);
  LabelMap labels;
  labels.layers.assign(3, Volume<LabelId>(grid));
  for (int k = 8; k < 22; ++k)
    for (int j = 8; j < 22; ++j)
      for (int i = 4; i < 26; ++i) {
        labels.layers[0].at(i, j, k) = i < 16;
        labels.layers[1].at(i, j, k) = i >= 14;
        labels.layers[2].at(i, j, k) = i == 8;
      }
  labels.segments = {{1, "hard", {}, 0, 1}, {2, "soft", {}, 1, 1}, {3, "lumen", {}, 2, 1}};
  const auto model =
      build_model(scene_of("[[tissue]]\nname = \"bone\"\nlabels = [\"hard\"]\nstiffness = 1.5\n"
                           "[[tissue]]\nname = \"cartilage\"\nlabels = [\"soft\"]\nstiffness = 0.5\n"
                           "[[tissue]]\nname = \"air\"\nlabels = [\"lumen\"]\ntouchable = false\n"),
                  &labels, nullptr);
  ASSERT_TRUE(model.ok()) << model.error().message();
  EXPECT_EQ((*model)->labels->at(14, 15, 15), 1);
  EXPECT_EQ((*model)->labels->at(16, 15, 15), 2);
  EXPECT_EQ((*model)->labels->at(8, 15, 15), 1) << "it is said not to be felt, and lies in what is";
}

TEST(BuildModel, ThresholdTissuesThatOverlapDoNotDependOnTheirOrder) {
  Volume<float> scan(grid_of(1, 30), -1000.f);
  for (int k = 8; k < 22; ++k)
    for (int j = 8; j < 22; ++j)
      for (int i = 8; i < 22; ++i) scan.at(i, j, k) = 1000;
  const std::string soft = "[[tissue]]\nname = \"soft\"\nthreshold = [-300, 0]\ntouchable = false\n";
  const std::string bone = "[[tissue]]\nname = \"bone\"\nthreshold = [200, 600]\nstiffness = 1.0\n";
  for (const std::string& tissues : {soft + bone, bone + soft}) {
    const auto model = build_model(scene_of("[data]\nscan = \"x.nrrd\"\n" + tissues), nullptr, &scan);
    ASSERT_TRUE(model.ok()) << model.error().message();
    EXPECT_EQ((*model)->name_of((*model)->labels->at(15, 15, 15)), "bone");
  }
}

TEST(BuildModel, LabelsOutsideTheScanHaveNoContact) {
  // a fill value of 0 would be on the threshold's ramp
  const LabelMap labels = blocks(grid_of(1, 40));
  const Volume<float> scan(grid_of(2, 8), -900.f);
  std::vector<std::string> warnings;
  const auto model = build_model(scene_of("[data]\nscan = \"x.nrrd\"\nlabels = \"y.nrrd\"\n"
                                          "[[tissue]]\nname = \"bone\"\nlabels = [1]\n"
                                          "[[tissue]]\nname = \"fat\"\nthreshold = [-500, -200]\n"
                                          "[force]\nmethod = \"trilinear\"\n"),
                                 &labels, &scan, {}, [&](const std::string& w) { warnings.push_back(w); });
  ASSERT_TRUE(model.ok()) << model.error().message();
  EXPECT_EQ(sample_value(*(*model)->field, Point<Patient>(35, 35, 35)), 0);
  EXPECT_THAT(warnings, ::testing::Contains(::testing::HasSubstr("beyond the scan")));
}

TEST(BuildModel, AThresholdThatNothingReachesIsAnError) {
  const Volume<float> scan(grid_of(1, 20), 40.f);
  const Scene scene =
      scene_of("[data]\nscan = \"x.nrrd\"\n[[tissue]]\nname = \"bone\"\nthreshold = [3000, 4000]\n");
  EXPECT_NE(why_not_touchable(scene, build_model(scene, nullptr, &scan)).find("no voxel"), std::string::npos);
}

TEST(BuildModel, ReportsASideThatContradictsTheAnatomy) {
  LabelMap map;
  map.layers.emplace_back(grid_of(1, 40, Point<Patient>(-20, -20, -20)));
  for (int k = 0; k < 40; ++k) {
    map.layers[0].at(20, 20, k) = 1;
    map.layers[0].at(32, 20, k) = 2;
  }
  map.segments = {{1, "tibia", {}, 0, 1}, {2, "fibula", {}, 0, 2}};
  std::vector<std::string> warnings;
  const Warn warn = [&](const std::string& w) { warnings.push_back(w); };
  const std::string tissue =
      "[[tissue]]\nname = \"bone\"\nlabels = [1, 2]\n[preparation]\nmethod = 'union-gaussian'\n";
  EXPECT_EQ((*build_model(scene_of("side = \"left\"\n" + tissue), &map, nullptr, {}, warn))->side,
            Side::kLeft);
  EXPECT_TRUE(warnings.empty());
  EXPECT_EQ((*build_model(scene_of("side = \"right\"\n" + tissue), &map, nullptr, {}, warn))->side,
            Side::kRight);
  EXPECT_EQ(warnings.size(), 1u);
  // without orientation the side is unknown
  const auto lost = *build_model(scene_of(tissue), &map, nullptr, {}, warn, false);
  EXPECT_EQ(lost->side, Side::kUnknown);
  EXPECT_FALSE(lost->oriented);
  EXPECT_EQ(warnings.size(), 2u);
}

TEST(BuildModel, TheFibulaTellsTheSide) {
  const auto side_with_fibula_at = [](double x_mm) {
    LabelMap map;
    map.layers.emplace_back(grid_of(1, 40, Point<Patient>(-20, -20, -20)));
    for (int k = 0; k < 40; ++k) {
      map.layers[0].at(20, 20, k) = 1;
      map.layers[0].at(20 + static_cast<int>(x_mm), 20, k) = 2;
    }
    map.segments = {{1, "tibia", {}, 0, 1}, {2, "fibula", {}, 0, 2}};
    return (*build_model(scene_of("[[tissue]]\nname = \"bone\"\nlabels = [1, 2]\n"), &map, nullptr))->side;
  };
  EXPECT_EQ(side_with_fibula_at(12), Side::kLeft);
  EXPECT_EQ(side_with_fibula_at(-12), Side::kRight);
  EXPECT_EQ(side_with_fibula_at(2), Side::kUnknown);
}

// ---- inward ramps

// kScene with inward ramps and further settings
std::string with_ramps(const std::string& settings = "") {
  std::string text = kScene;
  const std::string founding = "method = \"union-gaussian\"\nsigma = 1.0\n";
  return text.replace(text.find(founding), founding.size(), settings);
}

constexpr const char* kByTrilinear = "[force]\nmethod = \"trilinear\"\n";

TEST(BuildModel, RampsAreTheUsualPreparationAndTellTheForce) {
  const LabelMap labels = blocks(grid_of(1, 40));
  const auto by_proxy = build_model(scene_of(with_ramps()), &labels, nullptr);
  ASSERT_TRUE(by_proxy.ok()) << by_proxy.error().message();
  EXPECT_EQ((*by_proxy)->field, nullptr) << "a scene rendered by the proxy";
  const auto model = build_model(scene_of(with_ramps() + kByTrilinear), &labels, nullptr);
  ASSERT_TRUE(model.ok()) << model.error().message();
  const Model& m = **model;
  EXPECT_EQ(m.content_hash, (*by_proxy)->content_hash) << "a run may change the method";
  EXPECT_EQ(m.ramp_width_mm, 4);
  for (const ForceMethod method :
       {ForceMethod::kTrilinear, ForceMethod::kSpline, ForceMethod::kStoredNormals})
    EXPECT_DOUBLE_EQ((*make_force_field(m, method))->full_force_N(), 1.5 * 4);
  EXPECT_NEAR((*make_force_field(m, ForceMethod::kSmoothSphere))->full_force_N(), 1.5 * std::sqrt(2 * M_PI),
              0.2)
      << "spheres read the labels, as wide as sigma";
  // bone, the gap between two bones, cartilage, and a tissue that is not touchable
  const auto force_N = [&](double x_mm) { return 6 * sample_value(*m.field, Point<Patient>(x_mm, 20, 20)); };
  EXPECT_EQ(force_N(5), 6);
  EXPECT_LT(force_N(9), 2);
  EXPECT_GT(force_N(25), 1.5);
  EXPECT_EQ(force_N(30), 0);
  EXPECT_EQ(force_N(36), 0);
}

TEST(BuildModel, SettingsOfRampsAreHashed) {
  const LabelMap labels = blocks(grid_of(1, 30));
  const auto hash_of = [&](const std::string& text) {
    return (*build_model(scene_of(text), &labels, nullptr))->content_hash;
  };
  EXPECT_EQ(hash_of(with_ramps()), hash_of(with_ramps("ramp_width = 4\n")));
  EXPECT_NE(hash_of(with_ramps()), hash_of(with_ramps("ramp_width = 4.5\n")));
  EXPECT_NE(hash_of(with_ramps()), hash_of(with_ramps("bits = 8\n")));
  EXPECT_NE(hash_of(with_ramps()), hash_of(kScene));
}

TEST(BuildModel, ARampTakesTwoVoxels) {
  const LabelMap labels = blocks(grid_of(3, 30));
  const auto narrow = build_model(scene_of(with_ramps("ramp_width = 5\n")), &labels, nullptr);
  ASSERT_FALSE(narrow.ok());
  EXPECT_EQ(narrow.error().where, "test.toml");
  EXPECT_THAT(narrow.error().message(),
              ::testing::HasSubstr("the ramp width is 5 mm, and voxels are up to 3 mm wide"));
  EXPECT_THAT(narrow.error().message(), ::testing::HasSubstr("6 mm"));
  EXPECT_EQ((*build_model(scene_of(with_ramps()), &labels, nullptr))->ramp_width_mm, 6);
  const LabelMap coarse = blocks(grid_of(7, 30));
  // the proxy does not use ramps
  EXPECT_EQ((*build_model(scene_of(with_ramps()), &coarse, nullptr))->ramp_width_mm, 12);
  EXPECT_FALSE(build_model(scene_of(with_ramps("ramp_width = 12\n")), &coarse, nullptr).ok());
}

TEST(BuildModel, ThresholdRampHasContactFromItsMiddle) {
  Volume<float> scan(grid_of(1, 40));
  for (int k = 0; k < 40; ++k)
    for (int j = 0; j < 40; ++j)
      for (int i = 0; i < 40; ++i) scan.at(i, j, k) = static_cast<float>(30 * (i - 10));
  const auto scene = [](const std::string& threshold) {
    return scene_of("[data]\nscan = \"x.nrrd\"\n[[tissue]]\nname = \"bone\"\nthreshold = " + threshold +
                    "\n" + kByTrilinear);
  };
  const auto model = build_model(scene("[60, 240]"), nullptr, &scan);
  ASSERT_TRUE(model.ok()) << model.error().message();
  EXPECT_EQ(sample_value(*(*model)->field, Point<Patient>(14, 20, 20)), 0);
  EXPECT_GT(sample_value(*(*model)->field, Point<Patient>(15, 20, 20)), 0);
  const Scene above = scene("[800, 1800]");
  EXPECT_NE(why_not_touchable(above, build_model(above, nullptr, &scan)).find("no voxel"), std::string::npos)
      << "nothing reaches 1300";
}

TEST(BuildModel, ThinStructuresAreReportedInOneLine) {
  LabelMap map;
  map.layers.emplace_back(grid_of(1, 40));
  for (int k = 5; k < 35; ++k)
    for (int j = 5; j < 35; ++j) {
      for (int i = 5; i < 20; ++i) map.layers[0].at(i, j, k) = 1;
      map.layers[0].at(25, j, k) = 2;
      map.layers[0].at(30, j, k) = 3;
    }
  map.segments = {{1, "thick", {}, 0, 1}, {2, "sheet", {}, 0, 2}, {3, "leaf", {}, 0, 3}};
  std::vector<std::string> warnings;
  const auto model =
      build_model(scene_of("[[tissue]]\nname = \"bone\"\nlabels = [1, 2, 3]\nstiffness = 0.4\n" +
                           std::string(kByTrilinear)),
                  &map, nullptr, {}, [&](const std::string& w) { warnings.push_back(w); });
  ASSERT_TRUE(model.ok());
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_EQ(warnings[0], "thin: sheet gives at most 0.4 N, leaf 0.4 N of 0.5 N (direct methods)");
}

TEST(BuildModel, TissuesMergedIntoOneContactLayerAreACaveat) {
  constexpr int kTissues = kMaxLayers + 1;
  LabelMap map;
  map.layers.emplace_back(grid_of(1, 40));
  std::string scene;
  double stiffness_N_per_mm = 0.1;
  for (int n = 1; n <= kTissues; ++n, stiffness_N_per_mm *= n == 4 ? 1.1 : 1.25) {
    for (int k = 2; k < 38; ++k)
      for (int j = 2; j < 38; ++j)
        for (int i = 2 * n; i < 2 * n + 2; ++i) map.layers[0].at(i, j, k) = static_cast<LabelId>(n);
    map.segments.push_back(
        {static_cast<LabelId>(n), "slab " + std::to_string(n), {}, 0, static_cast<LabelId>(n)});
    const std::string number = std::to_string(n);
    scene += "[[tissue]]\nname = \"t" + number + "\"\nlabels = [" + number +
             "]\nstiffness = " + std::to_string(stiffness_N_per_mm) + "\n";
  }
  std::vector<std::string> warnings;
  const auto model = build_model(scene_of(scene), &map, nullptr, {},
                                 [&](const std::string& warning) { warnings.push_back(warning); });
  ASSERT_TRUE(model.ok()) << model.error().message();
  ASSERT_EQ((*model)->caveats.size(), 1u);
  EXPECT_EQ(
      (*model)->caveats[0].text,
      "tissues of 0.156 to 0.172 N/mm share one layer where they touch, up to 9 % too soft: contact has "
      "at most 12 layers of stiffness");
  EXPECT_EQ(std::count(warnings.begin(), warnings.end(), (*model)->caveats[0].text), 1);
}

TEST(BuildModel, TheSplineOfARampNeitherGrowsItNorPulls) {
  const LabelMap labels = blocks(grid_of(1, 30));
  const auto model = build_model(scene_of(with_ramps() + "[force]\nmethod = 'b-spline'\n"), &labels, nullptr);
  ASSERT_TRUE(model.ok()) << model.error().message();
  const ForceField& spline = (*model)->force_field(ForceMethod::kSpline);
  const GridGeometry& grid = (*model)->labels->geometry();
  double smallest = 0, max_beyond_N = 0;
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) {
        const Point<Patient> centre = grid.X_PatientVoxel() * Point<Voxel>(i, j, k);
        if (!(*model)->is_touchable((*model)->labels->at(i, j, k))) {
          ASSERT_EQ(spline.sample(centre).value, 0);
        }
        const Point<Patient> between = centre + Vector<Patient>(0.5, 0.4, 0.3);
        smallest = std::min(smallest, spline.sample(between).value);
        if (sample_value(*(*model)->field, between) == 0)
          max_beyond_N = std::max(max_beyond_N, spline.full_force_N() * spline.sample(between).value);
      }
  EXPECT_EQ(smallest, 0);
  std::printf("b-spline: at most %.3f N beyond the voxel around a structure\n", max_beyond_N);
  EXPECT_LT(max_beyond_N, 0.05);
}

// motivating defect: between close bones the smoothed field does not reach 0
TEST(BuildModel, TheGapsOfAKneeAreFree) {
  PALPATE_SHARED_FILE(file, "knee_spl/seg.nrrd");
  const auto knee = read_labels(file);
  ASSERT_TRUE(knee.ok()) << knee.error().message();
  const auto built = [&](const std::string& preparation) {
    const auto model = build_model(scene_of("[[tissue]]\nname = \"bone\"\nlabels = [95, 96, 97, 98]\n"
                                            "[preparation]\n" +
                                            preparation + kByTrilinear),
                                   &knee->labels, nullptr);
    PALPATE_CHECK(model.ok());
    return *model;
  };
  const auto value_at = [](const Model& model, int k, int j, int i) {
    return 255 *
           sample_value(*model.field, model.labels->geometry().X_PatientVoxel() * Point<Voxel>(i, j, k));
  };
  const auto founding = built("method = 'union-gaussian'\nsigma = 1.5\n");
  EXPECT_NEAR(value_at(*founding, 43, 272, 238), 50, 3);
  EXPECT_NEAR(value_at(*founding, 72, 345, 271), 102, 4);

  const auto ramps = built("");
  EXPECT_EQ(value_at(*ramps, 43, 272, 238), 0);
  EXPECT_EQ(value_at(*ramps, 72, 345, 271), 0);
  const auto field = std::get<Volume<std::uint16_t>>(ramps->field->storage());
  const Volume<LabelId> touchable_labels = ramps->labels->dense();
  std::size_t outside = 0, inside = 0;
  for (std::size_t v = 0; v < field.voxels().size(); ++v) {
    const bool touchable = ramps->is_touchable(touchable_labels.voxels()[v]);
    outside += !touchable && field.voxels()[v] != 0 ? 1 : 0;
    inside += touchable && field.voxels()[v] == 0 ? 1 : 0;
  }
  EXPECT_EQ(outside, 0u);
  EXPECT_EQ(inside, 0u);
}

TEST(BuildModel, RejectsASceneWithoutTouchableTissue) {
  const LabelMap labels = blocks(grid_of(1, 30));
  const Scene scene = scene_of("[[tissue]]\nname = \"fat\"\nlabels = [4]\ntouchable = false\n");
  EXPECT_NE(why_not_touchable(scene, build_model(scene, &labels, nullptr))
                .find("the scene has no touchable tissue"),
            std::string::npos);
}

// with its own scene; the nodules' modulus is the given multiple
TEST(BuildModel, PhantomNameSetsNoduleStiffness) {
  const auto elastic_of = [](const std::string& name, const std::string& structure) {
    const auto loaded = load_scene_or_data_set({name});
    PALPATE_CHECK(loaded.ok());
    const Model& model = *loaded->model;
    EXPECT_EQ(model.tissue_law, TissueLaw::kElastic);
    return model.tissue_of(model.find(structure)->id)->elastic;
  };
  const std::string block = "palpation-block:spacing=2", dome = "palpation-dome:spacing=2";
  for (const std::string& name : {block, dome}) {
    EXPECT_EQ(elastic_of(name, "soft_tissue"), (ElasticConstants{10, 0.45}));
    EXPECT_EQ(elastic_of(name, "nodule"), (ElasticConstants{100, 0.45}));
    EXPECT_EQ(elastic_of(name, "plate"), std::nullopt) << "rigid";
    EXPECT_EQ(elastic_of(name + ",stiffness=2.5", "nodule"), (ElasticConstants{25, 0.45}));
    EXPECT_EQ(elastic_of(name + ",stiffness=2.5", "soft_tissue"), (ElasticConstants{10, 0.45}));
    EXPECT_EQ(elastic_of(name + ",nodules=0", "soft_tissue"), (ElasticConstants{10, 0.45}));
  }
  EXPECT_EQ(elastic_of("abdominal-wall:spacing=1.1,edge=0", "liver"), (ElasticConstants{6.3, 0.45, 15}));
}

// bones are rigid, and every soft tissue of a knee has a modulus
TEST(BuildModel, SoftTissueOfTheKneePhantomHasAModulus) {
  const auto loaded = load_scene_or_data_set({"knee-phantom:spacing=2,lesion=6"});
  ASSERT_TRUE(loaded.ok()) << loaded.error().message();
  const Model& model = *loaded->model;
  EXPECT_EQ(model.tissue_law, TissueLaw::kLayers);
  int soft = 0;
  for (const Segment& segment : model.segments) {
    const Tissue* tissue = model.tissue_of(segment.id);
    ASSERT_NE(tissue, nullptr) << segment.name;
    const bool bone = segment.name == "femur" || segment.name == "tibia" || segment.name == "fibula" ||
                      segment.name == "patella";
    EXPECT_EQ(tissue->elastic.has_value(), !bone) << segment.name;
    soft += !bone;
  }
  EXPECT_EQ(soft, 12);
}

// words that suggest a preset are recognised in names derived from file names
TEST(BuildModel, PresetTermsAreAnatomyWords) {
  // also names of people, which may occur in file names
  const std::set<std::string> names_of_people{"costa", "hoffa", "lien"};
  for (const TissuePreset& preset : tissue_presets())
    for (const auto* words : {&preset.kind_words, &preset.structure_names})
      for (const std::string& word : *words) {
        const std::string name = "left " + word + (word == "white matter" ? "" : " 3");
        EXPECT_EQ(structure_in_name("DOE^CANARY_" + name), names_of_people.contains(word) ? "" : name);
      }
}

}  // namespace
}  // namespace palpate
