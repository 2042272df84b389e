#include <gtest/gtest.h>

#include <set>
#include <variant>

#include "palpate/loading/loading.h"
#include "palpate/tissue/soft_tissue_solver.h"

namespace palpate {
namespace {

// actual memory of a model's bricks
MemoryForecast measured_memory(const Model& model) {
  MemoryForecast memory;
  memory.labels = model.labels->bytes();
  if (model.field)
    memory.field = std::visit([](const auto& bricks) { return bricks.bytes(); }, model.field->bricks());
  std::set<const Surface*> visited;
  for (const ContactSurface& surface : model.surfaces)
    if (surface.surface && visited.insert(surface.surface.get()).second)
      memory.surfaces += surface.surface->distance_field().bricks().bytes() +
                         surface.surface->normal_field().bricks().bytes();
  return memory;
}

double over(std::uint64_t forecast, std::uint64_t measured) {
  return static_cast<double>(forecast) / static_cast<double>(measured);
}

TEST(MemoryOf, StandsAsPredicted) {
  // at 0.36 mm the forecast of the field is exact and that of the surfaces 1.26 times too large
  for (const char* const knee : {"knee-phantom:spacing=1", "knee-phantom:spacing=0.7"}) {
    SCOPED_TRACE(knee);
    SceneMemory predicted;
    const auto loaded =
        load_scene_or_data_set({knee}, {}, {}, {}, [&](const SceneMemory& memory) { predicted = memory; });
    ASSERT_TRUE(loaded.ok());
    const ForceMethod proxy = ForceMethod::kProxy;
    const auto ready = prepared_with_cache(loaded->model, {&proxy, 1});
    ASSERT_TRUE(ready.ok());
    const MemoryForecast is = measured_memory(**ready);
    EXPECT_EQ(predicted.model.labels, is.labels);
    EXPECT_EQ(predicted.model.field, 0u) << "the scene is rendered by the proxy";
    EXPECT_EQ(is.field, 0u);
    const ForceMethod trilinear = ForceMethod::kTrilinear;
    const auto direct = prepared_with_cache(*ready, {&trilinear, 1});
    ASSERT_TRUE(direct.ok());
    const FieldMemory field = memory_of_ramp_field(**direct);
    EXPECT_GT(over(field.permanent, measured_memory(**direct).field), 0.95);
    EXPECT_LT(over(field.permanent, measured_memory(**direct).field), 1.25);
    EXPECT_GT(over(predicted.model.surfaces, is.surfaces), 0.97);
    EXPECT_LT(over(predicted.model.surfaces, is.surfaces), 1.25);
  }
}

TEST(MemoryOf, StatesTheCellsOfSoftTissue) {
  SceneMemory predicted;
  const auto loaded = load_scene_or_data_set({"palpation-block:spacing=1.5,width=44,thickness=25"}, {}, {},
                                             {}, [&](const SceneMemory& memory) { predicted = memory; });
  ASSERT_TRUE(loaded.ok());
  ASSERT_TRUE(is_elastic(loaded->model->tissue_law));
  EXPECT_EQ(predicted.tissue_cell_mm, 1.5);
  EXPECT_EQ(solver_cell_mm(*loaded->model), predicted.tissue_cell_mm);
  const auto layers = memory_of_scene_or_data_set({"knee-phantom:spacing=3"});
  ASSERT_TRUE(layers.ok());
  EXPECT_EQ(layers->tissue_cell_mm, 0);
}

}  // namespace
}  // namespace palpate
