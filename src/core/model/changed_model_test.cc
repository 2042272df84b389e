#include "palpate/model/changed_model.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "contact/test_model.h"
#include "palpate/direct/direct_methods.h"
#include "palpate/loading/loading.h"
#include "palpate/model/make_model.h"
#include "palpate/servo/servo.h"

namespace palpate {
namespace {

using ::testing::HasSubstr;

// bone of 1.5 N/mm with a shell of cartilage of 0.75 N/mm, prepared for every method
std::shared_ptr<const Model> ball() {
  Model model =
      testing::with_exact_surfaces(testing::with_every_method(testing::ball_model({1, 1, 1}, 1.0, 3)), 3);
  model.content_hash = 42;
  return std::make_shared<const Model>(std::move(model));
}

constexpr std::size_t kBoneTissue = 0, kCartilageTissue = 1;

std::shared_ptr<const Model> stiffened(const Model& current, const Model& prepared, std::size_t tissue,
                                       double stiffness) {
  ModelChange change = current_values(current, tissue);
  change.contact.stiffness_N_per_mm = stiffness;
  auto next = changed_model(current, prepared, change);
  PALPATE_CHECK(next.ok());
  return *next;
}

TEST(ChangedModel, UnchangedPartsAreShared) {
  const auto made = ball();
  ModelChange change = current_values(*made, kCartilageTissue);
  change.contact.stiffness_N_per_mm = 0.6;
  change.contact.static_friction = 0.4;
  change.contact.friction = 0.3;
  change.contact.viscosity_N_s_per_mm = 0.002;
  const auto next = changed_model(*made, *made, change);
  ASSERT_TRUE(next.ok()) << next.error().message();
  const Model& model = **next;
  EXPECT_EQ(model.version, made->version + 1);
  EXPECT_NE(model.content_hash, made->content_hash);
  EXPECT_EQ(model.labels, made->labels);
  EXPECT_EQ(model.field, made->field);
  ASSERT_EQ(model.surfaces.size(), made->surfaces.size());
  for (std::size_t s = 0; s < model.surfaces.size(); ++s) {
    EXPECT_EQ(model.surfaces[s].surface, made->surfaces[s].surface);
    const bool shell = model.label_of_surface[s] == testing::kCartilage;
    EXPECT_EQ(model.surfaces[s].stiffness_N_per_mm, shell ? 0.6 : made->surfaces[s].stiffness_N_per_mm);
    EXPECT_EQ(model.surfaces[s].static_friction, shell ? 0.4 : made->surfaces[s].static_friction);
    EXPECT_EQ(model.surfaces[s].friction, shell ? 0.3 : made->surfaces[s].friction);
  }
  EXPECT_EQ(model.tissues[kCartilageTissue].viscosity_N_s_per_mm, 0.002);
  EXPECT_EQ(model.tissues[kBoneTissue].stiffness_N_per_mm, 1.5);
  // the same change of the same version yields the same model
  EXPECT_EQ((*changed_model(*made, *made, change))->content_hash, model.content_hash);
}

TEST(ChangedModel, FieldsAreAvailableOnlyForTheirStiffnesses) {
  const auto made = ball();
  ModelChange rougher = current_values(*made, kCartilageTissue);
  rougher.contact.static_friction = 0.5;
  const auto second = *changed_model(*made, *made, rougher);
  EXPECT_TRUE(fields_match(*second, *made));
  EXPECT_EQ(second->methods, made->methods);

  const auto third = stiffened(*second, *made, kCartilageTissue, 0.5);
  EXPECT_FALSE(fields_match(*third, *made));
  EXPECT_TRUE(third->has(ForceMethod::kProxy));
  EXPECT_TRUE(third->has(ForceMethod::kTrilinear)) << "a tick requires the trilinear method";
  EXPECT_FALSE(third->has(ForceMethod::kSpline));
  EXPECT_FALSE(third->has(ForceMethod::kSmoothSphere));

  const auto fourth = stiffened(*third, *made, kCartilageTissue, 0.75);
  EXPECT_TRUE(fields_match(*fourth, *made));
  EXPECT_EQ(fourth->methods, made->methods);
}

// A direct method's force is F_full times the field, scaled by most / (stiffest tissue): if the stiffest
// tissue becomes softer, the field must be scaled by the same ratio to stay below what a hand can hold.
TEST(ChangedModel, TrilinearFieldIsScaledToTheStiffestTissue) {
  const auto made = ball();
  const double made_N = made->force_field(ForceMethod::kTrilinear).full_force_N();
  const auto soft_shell = stiffened(*made, *made, kCartilageTissue, 0.3);
  EXPECT_EQ(soft_shell->force_field(ForceMethod::kTrilinear).full_force_N(), made_N);
  const auto softer = stiffened(*soft_shell, *made, kBoneTissue, 0.5);
  EXPECT_NEAR(softer->force_field(ForceMethod::kTrilinear).full_force_N(), made_N / 3, 1e-12);
  const auto harder = stiffened(*softer, *made, kBoneTissue, 6);
  EXPECT_EQ(harder->force_field(ForceMethod::kTrilinear).full_force_N(), made_N);
}

// pressed onto the bone through the shell, which was punctured at 0.3 N, while both tissues are edited
// alternately
TEST(ChangedModel, EditsKeepTheForceWhileATissueIsPunctured) {
  Model ball_to_puncture = *ball();
  ball_to_puncture.tissues[kCartilageTissue].puncture_N = 0.3;
  ball_to_puncture.surfaces[1].puncture_N = 0.3;
  // it surrounds the bone, so that the proxy lies within it
  const SignedField around = testing::sampled_distance(
      ball_to_puncture.labels->geometry(),
      [](const Eigen::Vector3d& p) { return p.norm() - testing::kBoneRadius_mm - 3; }, 4);
  ball_to_puncture.surfaces[1].surface =
      std::make_shared<const Surface>(around, around, testing::steepest_of(around));
  const auto made = std::make_shared<const Model>(std::move(ball_to_puncture));
  ModelVersions now{made, made};
  Parameters parameters;
  parameters.method = ForceMethod::kProxy;
  parameters.viscosity = parameters.passivity = false;
  SessionState state;
  TickRecord record;
  Wrench wrench;
  double min_N = 1;
  for (int n = 0; n < 3000; ++n) {
    DeviceState device;
    device.tip = Point<World>(testing::kBoneRadius_mm - 1 + 7 * std::max(0.0, 1 - n / 400.0), 0, 0);
    if (n >= 1200 && n % 200 == 0) {
      const std::size_t tissue = n % 400 == 0 ? kCartilageTissue : kBoneTissue;
      ModelChange change = current_values(*now.current, tissue);
      change.contact.stiffness_N_per_mm -= 0.02;
      now = next_version(now, change).value();
    }
    tick(*now.current, parameters, {&device, 1}, 1e-3, state, {&wrench, 1}, record);
    if (n < 1200) continue;
    ASSERT_FALSE(record.device[0].flags & (kFlagInside | kFlagRuptured)) << n;
    min_N = std::min(min_N, wrench.force_N.x());
  }
  EXPECT_EQ(now.current->version, 10u);
  EXPECT_GT(min_N, 0.95) << "1.5 N/mm less some, a millimetre deep, at most 3 N and never let go";
}

// Scene with two balls of bone, each in a shell of cartilage, surrounded by fat.
LabelMap shelled_balls() {
  GridGeometry grid;
  grid.dims = {60, 36, 36};
  LabelMap map;
  map.layers.emplace_back(grid);
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) {
        const double r = Eigen::Vector3d(i % 30 - 15, j - 18, k - 18).norm();
        map.layers[0].at(i, j, k) = static_cast<LabelId>(r < 9 ? 1 + i / 30 : r < 13 ? 3 : r < 16 ? 4 : 0);
      }
  map.segments = {
      {1, "left", {}, 0, 1}, {2, "right", {}, 0, 2}, {3, "shell", {}, 0, 3}, {4, "fat", {}, 0, 4}};
  return map;
}

std::shared_ptr<const Model> built(double left, double right, double shell, const std::string& more) {
  const auto tissue = [](const char* name, double stiffness, const char* rest) {
    return "[[tissue]]\nname = \"" + std::string(name) + "\"\nlabels = [\"" + name +
           "\"]\nstiffness = " + std::to_string(stiffness) + "\n" + rest;
  };
  const auto scene = parse_scene(tissue("left", left, "") + tissue("right", right, "") +
                                     tissue("shell", shell, "rests_on = [\"left\", \"right\"]\n") +
                                     tissue("fat", 0.2, "touchable = false\n") + more,
                                 "test.toml");
  PALPATE_CHECK(scene.ok());
  const LabelMap labels = shelled_balls();
  auto model = build_model(*scene, &labels, nullptr);
  PALPATE_CHECK(model.ok());
  std::vector<ForceMethod> methods;
  for (const ForceMethodInfo& info : kDirectMethods) methods.push_back(info.method);
  auto ready = prepared_with_cache(*model, methods);
  PALPATE_CHECK(ready.ok());
  return *ready;
}

// oracle: the scene built with the new stiffnesses from the start
TEST(ChangedModel, RebuiltFieldsEqualAFreshScene) {
  for (const std::string more : {"", "[preparation]\nbits = 8\n", "[preparation]\nramp_width = 3\n"}) {
    SCOPED_TRACE(more);
    const auto made = built(1.5, 1.2, 0.5, more), oracle = built(0.9, 1.3, 0.7, more);
    ModelVersions now{made, made};
    const double requested[] = {0.9, 1.3, 0.7};
    for (std::size_t tissue = 0; tissue < 3; ++tissue) {
      ModelChange change = current_values(*now.current, tissue);
      change.contact.stiffness_N_per_mm = requested[tissue];
      auto next = next_version(now, change);
      ASSERT_TRUE(next.ok()) << next.error().message();
      now = *std::move(next);
      EXPECT_EQ(now.prepared, made);
    }
    ASSERT_TRUE(can_compute_fields(*now.current));
    const auto last = next_version(now, {now.current->version + 1, ModelChange::kFieldsRebuilt});
    ASSERT_TRUE(last.ok()) << last.error().message();
    const Model &current = *(*last).current, &expected = *oracle;
    EXPECT_EQ((*last).prepared, (*last).current);
    EXPECT_EQ(current.version, 5u);
    EXPECT_EQ(current.level_of_label, expected.level_of_label);
    EXPECT_EQ(current.field->bytes_per_voxel(), expected.field->bytes_per_voxel());
    EXPECT_EQ(current.field->values().voxels(), expected.field->values().voxels());
    const unsigned seed = 20;
    SCOPED_TRACE("seed " + std::to_string(seed));
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> x(-1, 60), y(-1, 36);
    for (const ForceMethodInfo& info : kDirectMethods) {
      ASSERT_TRUE(current.has(info.method)) << info.name;
      const ForceField &a = current.force_field(info.method), &b = expected.force_field(info.method);
      EXPECT_EQ(a.full_force_N(), b.full_force_N()) << info.name;
      for (int n = 0; n < 300; ++n) {
        const Point<Patient> at(x(random), y(random), y(random));
        EXPECT_EQ(a.sample(at).value, b.sample(at).value) << info.name;
        EXPECT_EQ(a.sample(at).gradient, b.sample(at).gradient) << info.name;
      }
    }
  }
}

TEST(ChangedModel, UnionGaussianCannotBeRebuilt) {
  const auto made = ball();
  EXPECT_FALSE(can_compute_fields(*made));
  EXPECT_FALSE(next_version({made, made}, {2, ModelChange::kFieldsRebuilt}).ok());
}

TEST(ChangedModel, LawChangeWithinAGroupNeedsNoNewSurfaces) {
  Model soft = *ball();
  soft.tissues[0].elastic = ElasticConstants{20, 0.45};
  const auto layers = std::make_shared<const Model>(soft);
  soft.tissue_law = TissueLaw::kElastic;
  const auto elastic = std::make_shared<const Model>(soft);
  for (const auto& [from, to] :
       {std::pair(layers, TissueLaw::kChainMail), std::pair(elastic, TissueLaw::kNeoHookean)}) {
    const ModelChange change = change_of_law(*from, to);
    ASSERT_TRUE(change.is_of_law());
    EXPECT_FALSE(change.is_of_tissue() || change.is_of_stroke());
    EXPECT_EQ(law_of(change), to);
    EXPECT_FALSE(has_other_surfaces(*from, to));
    const auto next = next_version({from, from}, change);
    ASSERT_TRUE(next.ok()) << next.error().message();
    EXPECT_EQ(next->current->tissue_law, to);
    EXPECT_EQ(next->current->tissue_cell_factor, 1);
    EXPECT_EQ(next->current->version, from->version + 1);
    EXPECT_NE(next->current->content_hash, from->content_hash);
    EXPECT_EQ(next->current->field, from->field);
    EXPECT_EQ(next->current->surfaces[0].surface, from->surfaces[0].surface);
    EXPECT_EQ(next->prepared, from);
  }
  const auto rigid = ball();
  EXPECT_FALSE(under_law(*rigid, TissueLaw::kChainMail).ok());
  EXPECT_THAT(check_law(*rigid, TissueLaw::kElastic).error().what, HasSubstr("has a Young's modulus"));
  // without surfaces, only changes that need none
  Model bare = *layers;
  bare.surfaces.clear();
  EXPECT_TRUE(check_law(bare, TissueLaw::kChainMail).ok());
  EXPECT_THAT(check_law(bare, TissueLaw::kElastic).error().what, HasSubstr("deforms only with the proxy"));
  // the coarser cells of a slower machine are part of the change
  const auto coarser = next_version({elastic, elastic}, change_of_law(*elastic, TissueLaw::kNeoHookean, 1.6));
  ASSERT_TRUE(coarser.ok());
  EXPECT_EQ(coarser->current->tissue_cell_factor, 1.6);
  for (const double none : {-1.0, 0.5, 2.5, std::nan(""), 1e300})
    EXPECT_FALSE(
        next_version({elastic, elastic}, change_of_law(*elastic, TissueLaw::kNeoHookean, none)).ok());

  LawHistory laws(TissueLaw::kElastic, 1.25);
  laws.on_event({2, 0});
  laws.on_event({5, ModelChange::kLaw + static_cast<std::uint32_t>(TissueLaw::kNeoHookean), 1.6});
  laws.on_event({3, ModelChange::kLaw + static_cast<std::uint32_t>(TissueLaw::kLayers)});
  laws.on_event({7, ModelChange::kLaw + static_cast<std::uint32_t>(TissueLaw::kElastic), 7});
  EXPECT_EQ(laws.cell_factor_at(4), 1.25);
  EXPECT_EQ(laws.cell_factor_at(5), 1.6);
  EXPECT_EQ(laws.cell_factor_at(9), 1.6) << "coarsening above kMaxTissueCellFactor is ignored";
  EXPECT_FALSE(laws.any([](TissueLaw law) { return law == TissueLaw::kLayers; }));
  EXPECT_EQ(laws.at(0), TissueLaw::kElastic);
  EXPECT_EQ(laws.at(4), TissueLaw::kElastic);
  EXPECT_EQ(laws.at(5), TissueLaw::kNeoHookean);
  EXPECT_EQ(laws.at(6), TissueLaw::kNeoHookean);
  EXPECT_EQ(laws.at(4000), TissueLaw::kElastic);
}

TEST(ChangedModel, InvalidValuesAreRejectedWithTheSceneMessages) {
  const auto made = ball();
  const auto error_of = [&](std::size_t tissue, auto&& edit) {
    ModelChange change = current_values(*made, kBoneTissue);
    if (tissue < made->tissues.size()) change = current_values(*made, tissue);
    change.tissue = static_cast<std::uint32_t>(tissue);
    edit(change);
    const auto next = changed_model(*made, *made, change);
    return next.ok() ? Error{ErrorKind::kBadInput, "no error", "", ""} : next.error();
  };
  const auto stiffness = [](double value) {
    return [value](ModelChange& change) { change.contact.stiffness_N_per_mm = value; };
  };
  EXPECT_EQ(error_of(0, [](ModelChange&) {}).what, "no error");
  EXPECT_THAT(error_of(0, stiffness(20.01)).what,
              HasSubstr("stiffness = 20.01 is outside 0.001 ... 20 N/mm"));
  EXPECT_EQ(error_of(0, stiffness(20.01)).where, "stiffness_N_per_mm");
  EXPECT_THAT(error_of(0, stiffness(-1)).what, HasSubstr("is outside"));
  EXPECT_THAT(error_of(0, stiffness(std::nan(""))).what, HasSubstr("not a finite number"));
  EXPECT_THAT(error_of(0, stiffness(INFINITY)).what, HasSubstr("not a finite number"));
  EXPECT_THAT(error_of(1, stiffness(1.6)).what, HasSubstr("is stiffer than \"bone\" (1.5 N/mm)"));
  EXPECT_THAT(error_of(0, stiffness(0.7)).what, HasSubstr("\"cartilage\" (0.75 N/mm) is stiffer than"));
  const auto slippery = error_of(1, [](ModelChange& change) { change.contact.static_friction = 0.05; });
  EXPECT_THAT(slippery.what, HasSubstr("static_friction = 0.05 is less than friction = 0.1"));
  EXPECT_EQ(slippery.where, "static_friction");
  EXPECT_EQ(error_of(1, [](ModelChange& change) { change.contact.friction = 2.5; }).where, "friction");
  EXPECT_EQ(error_of(1, [](ModelChange& change) { change.contact.viscosity_N_s_per_mm = 0.2; }).where,
            "viscosity_N_s_per_mm");
  EXPECT_THAT(error_of(3, [](ModelChange&) {}).what, HasSubstr("no tissue 3"));
  EXPECT_THAT(error_of(0, [](ModelChange& change) { change.version = 7; }).what,
              HasSubstr("version 7 of the model does not follow version 1"));
}

// a plate of bone with a rod of 4 mm on it, on voxels of 0.5 mm, for a burr
std::shared_ptr<const Model> plate_with_rod() {
  GridGeometry grid;
  grid.dims = {24, 24, 24};
  grid.spacing_mm = Eigen::Vector3d::Constant(0.5);
  Volume<LabelId> labels(grid);
  for (int i = 2; i < 22; ++i)
    for (int j = 2; j < 22; ++j)
      for (int k = 2; k < 8; ++k) labels.at(i, j, k) = 1;
  for (int i = 11; i < 14; ++i)
    for (int j = 11; j < 14; ++j)
      for (int k = 8; k < 16; ++k) labels.at(i, j, k) = 1;
  ModelParts parts;
  parts.labels = label_bricks(labels);
  parts.segments = {{1, "bone", {}, 0, 1}};
  Tissue bone;
  bone.name = "bone";
  bone.stiffness_N_per_mm = 1.5;
  parts.tissues = {bone};
  parts.tissue_of_label = {-1, 0};
  parts.tools[0].radius_mm = 2;
  parts.tools[0].burr = BurrSettings{};
  constexpr ForceMethod kProxyAlone[] = {ForceMethod::kProxy};
  auto ready = prepared_for(*make_model(std::move(parts)), kProxyAlone);
  PALPATE_CHECK(ready.ok());
  return *ready;
}

TEST(ChangedModel, AFragmentIsRemovedFromTheSurfaceAndAgainFromTheRecordedCuts) {
  const auto model = plate_with_rod();
  const Point<Patient> foot(6, 6, 5), top(6, 6, 7.5);
  ASSERT_LT(model->surfaces[0].surface->distance_mm(top), 0);
  std::vector<Cut> cuts{{0, {foot, foot, 1.2, 1}}};
  const auto carving = carved_with_fragments(*model, cuts);
  ASSERT_GT(cuts.size(), 1u);
  const auto next = carving->applied_to(*model);
  EXPECT_GT(next->surfaces[0].surface->distance_mm(top), 0.5);
  EXPECT_LT(next->surfaces[0].surface->distance_mm(Point<Patient>(3, 3, 2.5)), -0.5) << "the plate stays";
  const auto replayed = next_version({model, model}, {2, ModelChange::kCut}, cuts);
  ASSERT_TRUE(replayed.ok()) << replayed.error().message();
  EXPECT_EQ(replayed->current->content_hash, next->content_hash);
  EXPECT_EQ(replayed->current->labels->content_hash(), next->labels->content_hash());
  EXPECT_EQ(replayed->current->surfaces[0].surface->content_hash(),
            next->surfaces[0].surface->content_hash());
  const auto undone = next_version({next, model}, {3, ModelChange::kUndo});
  ASSERT_TRUE(undone.ok());
  EXPECT_EQ(undone->current->content_hash, model->content_hash);
  EXPECT_EQ(undone->current->surfaces[0].surface, model->surfaces[0].surface);
}

}  // namespace
}  // namespace palpate
