#include "palpate/model/make_model.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "palpate/model/memory_forecast.h"
#include "palpate/model/model_preparation.h"
#include "palpate/servo/servo.h"

namespace palpate {
namespace {

using ::testing::HasSubstr;

// a block of a single deformable tissue
ModelParts soft_block(ElasticConstants of, double cell_mm = 0) {
  GridGeometry grid;
  grid.dims = {8, 8, 8};
  ModelParts parts;
  parts.labels = std::make_shared<const Bricks<LabelId>>(grid, LabelId{1});
  parts.tissue_of_label = {-1, 0};
  parts.segments.push_back({1, "liver", {}, 0, 1});
  Tissue tissue;
  tissue.name = "organ";
  tissue.elastic = of;
  parts.tissues = {tissue};
  parts.tissue_law = TissueLaw::kElastic;
  parts.tissue_cell_mm = cell_mm;
  parts.tools = {Tool{}};
  return parts;
}

// a block of rigid bone in a margin of air
ModelParts block_of_bone() {
  GridGeometry grid;
  grid.dims = {8, 8, 12};
  Volume<LabelId> labels(grid);
  for (int k = 0; k < 8; ++k)
    for (int j = 0; j < 8; ++j)
      for (int i = 0; i < 8; ++i) labels.at(i, j, k) = 1;
  ModelParts parts;
  parts.labels = label_bricks(labels);
  parts.tissue_of_label = {-1, 0};
  parts.segments.push_back({1, "bone", {}, 0, 1});
  Tissue bone;
  bone.name = "bone";
  bone.stiffness_N_per_mm = 1.5;
  parts.tissues = {bone};
  return parts;
}

TEST(MakeModel, InvalidElasticConstantsAreRejected) {
  const auto complaint = [](ElasticConstants of, double cell_mm = 0) {
    const auto made = make_model(soft_block(of, cell_mm));
    return made.ok() ? std::string("no error") : made.error().what;
  };
  const double no_number = std::numeric_limits<double>::quiet_NaN();
  for (const double modulus : {kElasticModulusRange.min_kPa, kElasticModulusRange.max_kPa})
    for (const double ratio : {0.0, kMaxPoissonsRatio})
      EXPECT_EQ(complaint({modulus, ratio}), "no error") << modulus << " kPa, " << ratio;
  for (const double modulus : {0.0, -1.0, 0.09, 100'001.0, no_number, HUGE_VAL})
    EXPECT_THAT(complaint({modulus, 0.45}), HasSubstr("tissue \"organ\" has a Young's modulus of"))
        << modulus;
  for (const double ratio : {-0.1, 0.5, no_number})
    EXPECT_THAT(complaint({10, ratio}), HasSubstr("tissue \"organ\" has a Poisson's ratio of")) << ratio;
  EXPECT_EQ(complaint({10, 0.45}, 1), "no error");
  for (const double cell_mm : {-1.0, no_number, HUGE_VAL})
    EXPECT_THAT(complaint({10, 0.45}, cell_mm), HasSubstr("the cell size is")) << cell_mm;
}

TEST(MakeModel, InvalidRelaxationIsRejected) {
  const auto complaint = [](const Relaxation& of) {
    ModelParts parts = soft_block({10, 0.45});
    parts.tissues[0].relaxation = of;
    const auto made = make_model(std::move(parts));
    return made.ok() ? std::string("no error") : made.error().what;
  };
  const double no_number = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(complaint({}), "no error");
  EXPECT_EQ(complaint({{{{0.5, 0.01}, {0.4999, 1000}}}}), "no error");
  for (const double part : {-0.1, 1.0, no_number, HUGE_VAL})
    EXPECT_THAT(complaint({{{{part, 1}, {}}}}), HasSubstr("tissue \"organ\" has a relaxation by")) << part;
  for (const double time_s : {-1.0, 0.0, 0.009, 1001.0, no_number})
    EXPECT_THAT(complaint({{{{0.5, time_s}, {}}}}), HasSubstr("a relaxation time of")) << time_s;
  EXPECT_THAT(complaint({{{{0.5, 1}, {0.5, 2}}}}), HasSubstr("a relaxation of the whole modulus"));
  EXPECT_THAT(complaint({{{{}, {0.5, 2}}}}), HasSubstr("first term is empty"));
}

TEST(MakeModel, RelaxationTimesBeyondTheMaximumAreRejected) {
  ModelParts parts = soft_block({10, 0.45});
  const auto add = [&](double time_s) {
    Tissue tissue = parts.tissues[0];
    tissue.relaxation = {{{{0.1, time_s}, {0.1, 2 * time_s}}}};
    parts.tissues.push_back(tissue);
  };
  for (std::size_t n = 0; n < kMaxRelaxationTimes / 2; ++n) add(0.5 + 0.01 * static_cast<double>(n));
  const auto made = make_model(ModelParts(parts));
  ASSERT_TRUE(made.ok()) << made.error().message();
  EXPECT_EQ((*made)->relaxation_times.count, kMaxRelaxationTimes);
  add(7);
  const auto too_many = make_model(ModelParts(parts));
  ASSERT_FALSE(too_many.ok());
  EXPECT_THAT(too_many.error().what, HasSubstr("more than 16 different times"));
  // tissue that is not deformable has no relaxation times
  parts.tissue_law = TissueLaw::kLayers;
  EXPECT_FALSE((*make_model(std::move(parts)))->relaxation_times.any());
}

// The same block in a grid with more background at its end: bricks and their positions are equal, but World,
// which depends on the grid's centre, is not.
TEST(MakeModel, HashCoversTheGridSize) {
  const auto hash_of = [](std::array<int, 3> dims) {
    ModelParts parts = soft_block({10, 0.45});
    parts.tissue_law = TissueLaw::kLayers;
    parts.tissues[0].stiffness_N_per_mm = 0.5;
    GridGeometry grid;
    grid.dims = dims;
    Volume<LabelId> labels(grid);
    for (int k = 2; k < 8; ++k)
      for (int j = 2; j < 8; ++j)
        for (int i = 2; i < 8; ++i) labels.at(i, j, k) = 1;
    parts.labels = label_bricks(labels);
    const auto made = make_model(std::move(parts));
    EXPECT_TRUE(made.ok()) << made.error().message();
    return (*made)->content_hash;
  };
  const std::uint64_t hash = hash_of({12, 12, 12});
  EXPECT_EQ(hash_of({12, 12, 12}), hash);
  EXPECT_NE(hash_of({13, 12, 12}), hash);
  EXPECT_NE(hash_of({12, 13, 12}), hash);
  EXPECT_NE(hash_of({12, 12, 13}), hash);
}

// forces of a tip pressed 2 mm into the block and withdrawn
std::vector<std::array<double, 3>> pressed_forces_N(const Model& model, ForceMethod method) {
  Parameters parameters;
  parameters.method = method;
  SessionState state;
  DeviceState device;
  Wrench wrench;
  TickRecord record;
  std::vector<std::array<double, 3>> forces_N;
  for (int n = 0; n < 1200; ++n) {
    const double depth_mm = 2 - std::abs(n - 800) * 0.01;
    device.tip = model.X_WorldPatient * Point<Patient>(3.4, 3.6, 7.5 - depth_mm);
    tick(model, parameters, {&device, 1}, 1e-3, state, {&wrench, 1}, record);
    forces_N.push_back(record.device[0].force_N);
  }
  return forces_N;
}

TEST(PreparedFor, ProxyAloneComputesNoField) {
  const auto made = make_model(block_of_bone());
  ASSERT_TRUE(made.ok()) << made.error().message();
  EXPECT_EQ((*made)->field, nullptr);
  const ForceMethod proxy = ForceMethod::kProxy, trilinear = ForceMethod::kTrilinear;
  const auto by_proxy = prepared_for(*made, {&proxy, 1});
  ASSERT_TRUE(by_proxy.ok()) << by_proxy.error().message();
  EXPECT_EQ((*by_proxy)->field, nullptr);
  for (const ForceMethodInfo& info : kDirectMethods) {
    EXPECT_FALSE((*by_proxy)->has(info.method)) << info.name;
    EXPECT_EQ((*by_proxy)->rendered_method(info.method), proxy) << info.name;
  }

  const auto by_both = prepared_for(*by_proxy, {&trilinear, 1});
  ASSERT_TRUE(by_both.ok()) << by_both.error().message();
  ASSERT_NE((*by_both)->field, nullptr);
  EXPECT_TRUE((*by_both)->has(trilinear));
  EXPECT_EQ((*by_both)->content_hash, (*by_proxy)->content_hash) << "a run may change the method";
  EXPECT_EQ((*by_both)->rendered_method(ForceMethod::kSpline), trilinear);

  const auto forces_N = pressed_forces_N(**by_proxy, proxy);
  EXPECT_GT(std::ranges::max(forces_N, {}, [](const auto& f) { return f[1]; })[1], 1);
  EXPECT_EQ(forces_N, pressed_forces_N(**by_both, proxy)) << "to the bit";
  EXPECT_EQ(forces_N, pressed_forces_N(**by_proxy, trilinear)) << "the proxy stands in";
}

TEST(PreparedFor, AnyDirectMethodComputesTheFieldAndTrilinear) {
  for (const bool eight_bits : {false, true})
    for (const ForceMethodInfo& info : kDirectMethods) {
      SCOPED_TRACE(info.name);
      ModelParts parts = block_of_bone();
      parts.eight_bits = eight_bits;
      const auto made = make_model(std::move(parts));
      ASSERT_TRUE(made.ok()) << made.error().message();
      const auto ready = prepared_for(*made, {&info.method, 1});
      ASSERT_TRUE(ready.ok()) << ready.error().message();
      ASSERT_NE((*ready)->field, nullptr);
      EXPECT_EQ((*ready)->field->bytes_per_voxel(), eight_bits ? 1 : 2);
      EXPECT_TRUE((*ready)->has(info.method));
      EXPECT_TRUE((*ready)->has(ForceMethod::kTrilinear));
      EXPECT_FALSE((*ready)->has(ForceMethod::kProxy));
      EXPECT_EQ(*prepared_for(*ready, {&info.method, 1}), *ready) << "nothing to add";
    }
}

TEST(PreparedFor, HashCoversTheFieldBeforeItIsComputed) {
  const auto hash_of = [](bool eight_bits, std::optional<double> width_mm) {
    ModelParts parts = block_of_bone();
    parts.eight_bits = eight_bits;
    parts.ramp_width_mm = width_mm;
    const auto made = make_model(std::move(parts));
    EXPECT_TRUE(made.ok());
    return (*made)->content_hash;
  };
  const std::uint64_t hash = hash_of(false, 4);
  EXPECT_EQ(hash_of(false, 4), hash);
  EXPECT_NE(hash_of(true, 4), hash);
  EXPECT_NE(hash_of(false, 5), hash);
}

TEST(MemoryForecast, CountsTheFieldOnlyIfItIsComputed) {
  const ModelParts parts = block_of_bone();
  const auto by_proxy = forecast_memory(parts, {.proxy = true, .field = false});
  const auto by_both = forecast_memory(parts, {.proxy = true, .field = true});
  ASSERT_TRUE(by_proxy.ok() && by_both.ok());
  EXPECT_EQ(by_proxy->field, 0u);
  EXPECT_EQ(by_proxy->peak_of_field, 0u);
  EXPECT_GT(by_both->field, 0u);
  EXPECT_EQ(by_proxy->surfaces, by_both->surfaces);
  EXPECT_EQ(by_both->permanent(), by_proxy->permanent() + by_both->field);
  const auto made = make_model(block_of_bone());
  EXPECT_EQ(memory_of_ramp_field(**made).permanent, by_both->field);
}

TEST(ModelPreparation, GroupsSharingAStructureAreSequential) {
  using Groups = std::vector<std::vector<LabelId>>;
  using Goes = std::vector<std::vector<std::size_t>>;
  EXPECT_EQ(disjoint_batches(Groups{}), Goes{});
  EXPECT_EQ(disjoint_batches(Groups{{1, 2}, {3}, {4, 5}}), (Goes{{0, 1, 2}}));
  // typical layers: all, the stiffer ones, the stiffest; and a group disjoint from the second
  EXPECT_EQ(disjoint_batches(Groups{{1, 2, 3}, {2, 3}, {3}, {1}, {4}}), (Goes{{0, 4}, {1, 3}, {2}}));
}

TEST(MakeModel, AScanBelongsToTheModelOnlyWhereEnergiesFollowIt) {
  const auto hash_of = [](double full_HU, float HU) {
    ModelParts parts = block_of_bone();
    Volume<float> scan(parts.labels->geometry());
    std::ranges::fill(scan.voxels(), HU);
    parts.scan = std::make_shared<const Volume<float>>(std::move(scan));
    parts.full_density_HU = full_HU;
    return (*make_model(std::move(parts)))->content_hash;
  };
  const std::uint64_t without = (*make_model(block_of_bone()))->content_hash;
  EXPECT_EQ(hash_of(0, 500), without);
  EXPECT_NE(hash_of(1700, 500), without);
  EXPECT_NE(hash_of(1700, 500), hash_of(1700, 501));
  EXPECT_NE(hash_of(1700, 500), hash_of(1500, 500));
  EXPECT_EQ(hash_of(1700, 500), hash_of(1700, 500));
}

TEST(MakeModel, ADensityNeedsAScanOnTheGridOfTheLabels) {
  ModelParts parts = block_of_bone();
  parts.full_density_HU = 1700;
  const auto without_scan = make_model(parts);
  ASSERT_FALSE(without_scan.ok());
  EXPECT_THAT(without_scan.error().what, HasSubstr("there is none"));
  parts.scan = std::make_shared<const Volume<float>>(GridGeometry{});
  const auto elsewhere = make_model(parts);
  ASSERT_FALSE(elsewhere.ok());
  EXPECT_THAT(elsewhere.error().what, HasSubstr("another grid"));
  parts.full_density_HU = -1;
  EXPECT_FALSE(make_model(parts).ok());
}

}  // namespace
}  // namespace palpate
