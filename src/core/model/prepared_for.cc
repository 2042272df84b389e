#include <algorithm>
#include <utility>
#include <variant>
#include <vector>

#include "model/surface_reach.h"
#include "model/surfaces_needed.h"
#include "palpate/base/for_each_index.h"
#include "palpate/model/make_model.h"

namespace palpate {

Result<std::shared_ptr<const Model>> prepared_for(std::shared_ptr<const Model> model,
                                                  std::span<const ForceMethod> methods,
                                                  const ModelPreparation& preparation,
                                                  const Progress& progress) {
  if (model == nullptr || model->labels == nullptr)
    return Error{ErrorKind::kBadInput, "there is no model to prepare", "model", "make one by make_model()"};
  if (model->is_touchable(model->labels->outside()))
    return Error{ErrorKind::kBadInput, "the background label belongs to a touchable tissue", "labels",
                 "surround the labels with background, as label_bricks() does"};
  std::vector<ForceMethod> direct(methods.begin(), methods.end());
  const bool proxy = std::erase(direct, ForceMethod::kProxy) > 0;
  auto ready = with_direct_methods(std::move(model), direct, preparation, progress);
  if (!ready) return ready;
  if (proxy && !(*ready)->has(ForceMethod::kProxy))
    ready = with_surfaces(*std::move(ready), preparation, progress);
  return ready ? with_distances(*std::move(ready), preparation, progress) : ready;
}

std::vector<LabelId> tracked_structures(const std::vector<NoGoRegion>& no_go,
                                        const ReportedDistances& distances) {
  std::vector<LabelId> tracked = distances.structures;
  for (const NoGoRegion& region : no_go)
    if (const auto* structure = std::get_if<NoGoStructure>(&region.shape))
      tracked.push_back(structure->label);
  std::sort(tracked.begin(), tracked.end());
  tracked.erase(std::unique(tracked.begin(), tracked.end()), tracked.end());
  return tracked;
}

Result<std::shared_ptr<const Model>> with_distances(std::shared_ptr<const Model> model,
                                                    const ModelPreparation& preparation,
                                                    const Progress& progress) {
  const std::vector<LabelId> tracked = tracked_structures(model->no_go, model->reported_distances);
  if (tracked.empty() || !model->distance_trees.structures().empty()) return model;
  PALPATE_CHECK(model->carving == nullptr);

  // reuses the proxy's surfaces where they exist, builds others for structures that touch or are not
  // touchable
  std::vector<std::shared_ptr<const Surface>> surfaces(tracked.size());
  std::vector<std::vector<LabelId>> missing;
  for (std::size_t n = 0; n < tracked.size(); ++n) {
    const auto& labels = model->label_of_surface;
    const auto found = std::lower_bound(labels.begin(), labels.end(), tracked[n]);
    if (found != labels.end() && *found == tracked[n])
      surfaces[n] = model->surfaces[static_cast<std::size_t>(found - labels.begin())].surface;
    if (surfaces[n] == nullptr) missing.push_back({tracked[n]});
  }
  if (!missing.empty()) {
    const auto options = touchable_surface_options(model->tools, model->labels->geometry());
    if (!options) return options.error();
    auto made = preparation.outer_surfaces(*model->labels, missing, *options, progress);
    if (!made) return made.error();
    auto next = made->begin();
    for (auto& surface : surfaces)
      if (surface == nullptr) surface = std::move(*next++);
  }

  std::vector<TrackedStructure> structures(tracked.size());
  const auto count = static_cast<int>(tracked.size());
  const bool done = for_each_index(count, worker_count(0, count), [&](int /*worker*/, int index) {
    if (progress.stopped()) return false;
    const auto n = static_cast<std::size_t>(index);
    const auto& reported = model->reported_distances.structures;
    structures[n] = {tracked[n], std::make_shared<const SurfaceTree>(surfaces[n]),
                     std::binary_search(reported.begin(), reported.end(), tracked[n])};
    return true;
  });
  if (!done) return Progress::interrupted();
  auto more = std::make_shared<Model>(*model);
  more->distance_trees = DistanceTrees(std::move(structures), model->reported_distances.reach_mm);
  for (NoGoRegion& region : more->no_go)
    if (auto* structure = std::get_if<NoGoStructure>(&region.shape))
      structure->tracked = static_cast<int>(
          std::lower_bound(tracked.begin(), tracked.end(), structure->label) - tracked.begin());
  return std::shared_ptr<const Model>(std::move(more));
}

}  // namespace palpate
