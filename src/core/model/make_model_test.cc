#include "palpate/model/make_model.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "palpate/model/preparing.h"

namespace palpate {
namespace {

using ::testing::HasSubstr;

// a block of a single deformable tissue
ModelParts yielding_block(ElasticConstants of, double cell_mm = 0) {
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

TEST(MakeModel, ElasticConstantsWithoutASolutionAreRefused) {
  const auto complaint = [](ElasticConstants of, double cell_mm = 0) {
    const auto made = make_model(yielding_block(of, cell_mm));
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
    EXPECT_THAT(complaint({10, 0.45}, cell_mm), HasSubstr("cells of")) << cell_mm;
}

TEST(MakeModel, ARelaxationThatNoneHasIsRefused) {
  const auto complaint = [](const Relaxation& of) {
    ModelParts parts = yielding_block({10, 0.45});
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

TEST(MakeModel, TissuesRelaxWithSoManyDifferentTimesAndNoMore) {
  ModelParts parts = yielding_block({10, 0.45});
  const auto add = [&](double time_s) {
    Tissue tissue = parts.tissues[0];
    tissue.relaxation = {{{{0.1, time_s}, {0.1, 2 * time_s}}}};
    parts.tissues.push_back(tissue);
  };
  for (std::size_t n = 0; n < kMaxRelaxationTimes / 2; ++n) add(0.5 + 0.01 * static_cast<double>(n));
  const auto made = make_model(ModelParts(parts));
  ASSERT_TRUE(made.ok()) << made.error().message();
  EXPECT_EQ(made->model->relaxation_times.count, kMaxRelaxationTimes);
  add(7);
  const auto too_many = make_model(ModelParts(parts));
  ASSERT_FALSE(too_many.ok());
  EXPECT_THAT(too_many.error().what, HasSubstr("more than 16 different times"));
  // tissue that is not deformable has no relaxation times
  parts.tissue_law = TissueLaw::kLayers;
  EXPECT_FALSE(make_model(std::move(parts))->model->relaxation_times.any());
}

// The same block in a grid with more background at its end: bricks and their positions are equal, but World,
// which depends on the grid's centre, is not.
TEST(MakeModel, AGridsSizeIsPartOfTheHash) {
  const auto hash_of = [](std::array<int, 3> dims) {
    ModelParts parts = yielding_block({10, 0.45});
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
    return made->model->content_hash;
  };
  const std::uint64_t hash = hash_of({12, 12, 12});
  EXPECT_EQ(hash_of({12, 12, 12}), hash);
  EXPECT_NE(hash_of({13, 12, 12}), hash);
  EXPECT_NE(hash_of({12, 13, 12}), hash);
  EXPECT_NE(hash_of({12, 12, 13}), hash);
}

TEST(Preparing, GroupsWithAStructureInCommonGoOneAfterTheOther) {
  using Groups = std::vector<std::vector<LabelId>>;
  using Goes = std::vector<std::vector<std::size_t>>;
  EXPECT_EQ(disjoint_batches(Groups{}), Goes{});
  EXPECT_EQ(disjoint_batches(Groups{{1, 2}, {3}, {4, 5}}), (Goes{{0, 1, 2}}));
  // typical layers: all, the stiffer ones, the stiffest; and a group disjoint from the second
  EXPECT_EQ(disjoint_batches(Groups{{1, 2, 3}, {2, 3}, {3}, {1}, {4}}), (Goes{{0, 4}, {1, 3}, {2}}));
}

}  // namespace
}  // namespace palpate
