#include "palpate/model/make_model.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>
#include <utility>

namespace palpate {
namespace {

using ::testing::HasSubstr;

// a block of one tissue that yields
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
    for (const double ratio : {0.0, kMostPoissonsRatio})
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

}  // namespace
}  // namespace palpate
