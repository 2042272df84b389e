#include "session/measured_cells.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "loading/test_loading.h"
#include "palpate/loading/loading.h"
#include "palpate/palpation/run_setup.h"
#include "session/tip_source.h"

namespace palpate {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

std::shared_ptr<const Model> ball_under(TissueLaw law) {
  Model model = testing::ball_model({1, 1, 1}, 1.0, 8);
  model.tissue_law = law;
  model.tissues[1].elastic = ElasticConstants{20, 0.45};
  constexpr ForceMethod kProxyAlone[] = {ForceMethod::kProxy};
  return prepared_with_cache(std::make_shared<const Model>(std::move(model)), kProxyAlone).value();
}

TEST(MeasuredCells, AreCoarserWhereAFrameTakesTooLong) {
  const auto model = ball_under(TissueLaw::kElastic);
  const MeasuredCells none_is_fast_enough = with_measured_cells(model, 1, 0);
  EXPECT_EQ(none_is_fast_enough.model->tissue_cell_factor, 2);
  EXPECT_EQ(none_is_fast_enough.model->content_hash, model->content_hash);
  EXPECT_EQ(solver_cell_mm(*none_is_fast_enough.model), 2 * solver_cell_mm(*model));
  EXPECT_THAT(none_is_fast_enough.warning, HasSubstr("cells of 2 mm instead of 1"));
}

TEST(MeasuredCells, AreAsTheSceneHasThemElsewhere) {
  const auto model = ball_under(TissueLaw::kElastic);
  const MeasuredCells fast = with_measured_cells(model, 2, 1e3);
  EXPECT_EQ(fast.model, model);
  EXPECT_THAT(fast.warning, IsEmpty());
  // the law of layers needs no solver
  const auto layers = ball_under(TissueLaw::kLayers);
  EXPECT_EQ(with_measured_cells(layers, 1, 0).model, layers);
  // a model with a factor is returned unchanged
  auto warning = std::make_shared<Model>(*model);
  warning->tissue_cell_factor = 1.6;
  EXPECT_EQ(with_measured_cells(warning, 1, 0).model, warning);
}

// the session may release the model that the hand planned its path in, once it uses coarser cells
TEST(MeasuredCells, HandKeepsItsModel) {
  LoadedScene loaded = testing::loaded_ball();
  const auto script = parse_script("[[step]]\napproach = \"ball\"\n", "test script");
  ASSERT_TRUE(script);
  auto setup = set_up_run(loaded, *script, {}, {});
  ASSERT_TRUE(setup) << setup.error().message();
  std::string warning;
  const auto tip = tip_source_for(*setup, {}, {}, warning);
  ASSERT_TRUE(tip) << tip.error().message();
  const std::weak_ptr<const Model> planned_in = setup->model;
  setup->model.reset();
  loaded.model.reset();
  EXPECT_FALSE(planned_in.expired());
}

}  // namespace
}  // namespace palpate
