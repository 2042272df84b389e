#include "session/live_model.h"

#include <algorithm>
#include <string>
#include <utility>

#include "palpate/base/check.h"
#include "palpate/device/rendered_stiffness.h"
#include "palpate/palpation/logged_loop.h"
#include "session/refusal.h"
#include "session/viewed_scene.h"

namespace palpate {

void LiveModel::apply(const Lock& /*held*/, ModelVersions next, const ModelChange& change, RequestedBy by) {
  set_model_logged(*loop_.get(), loop_.log(), by, next.current, change);
  versions_ = std::move(next);
}

void LiveModel::apply_cuts(const Lock& /*held*/, std::span<const Cut> cuts,
                           std::shared_ptr<const Model> next) {
  set_cut_model_logged(*loop_.get(), loop_.log(), cuts, next);
  versions_.current = std::move(next);
}

void LiveModel::set_prepared(const Lock& /*held*/, ModelVersions same) {
  PALPATE_CHECK(loop_.get()->set_model(same.current).ok());
  versions_ = std::move(same);
}

Result<ModelChange> LiveModel::check(const Lock& /*held*/, const TissueRequest& request,
                                     ForceMethod method) const {
  const Model& model = *versions_.current;
  if (request.tissue < 0 || static_cast<std::size_t>(request.tissue) >= model.tissues.size())
    return invalid_value("there is no such tissue", "tissue",
                         "tissues are numbered from 0, in the order of the scene");
  const ModelChange before = current_values(model, static_cast<std::size_t>(request.tissue));
  ModelChange change = before;
  change.contact = request.changes.applied_to(before.contact);
  if (change == before) return change;
  const bool is_stiffness_changed = change.contact.stiffness_N_per_mm != before.contact.stiffness_N_per_mm;
  if (model.is_deformable(model.tissues[static_cast<std::size_t>(request.tissue)]) && is_stiffness_changed)
    return refusal("this tissue yields, and its stiffness follows from its Young's modulus",
                   "stiffness_N_per_mm", "change youngs_modulus in the scene file, and open it again");
  if (auto next = changed_model(model, *versions_.prepared, change); !next) return next.error();
  if (is_stiffness_changed && (method != ForceMethod::kProxy || !model.has(method)))
    return refusal(
        "the field that " + std::string(name_of(method)) + " reads was prepared for the current stiffness",
        "stiffness_N_per_mm", "choose the proxy, which applies a new stiffness at once");
  return change;
}

Result<void> LiveModel::edit(const Lock& lock, const ModelChange& change, RequestedBy by) {
  auto next = changed_model(*versions_.current, *versions_.prepared, change);
  if (!next) return next.error();
  apply(lock, {*std::move(next), versions_.prepared}, change, by);
  return {};
}

double LiveModel::rendered_stiffness_N_per_mm(const Lock& /*held*/, const TickRecord& tick,
                                              std::size_t device_number) const {
  const DeviceTick& device = tick.device[device_number];
  const auto method = static_cast<ForceMethod>(tick.method);
  const RenderedStiffness gains(device);
  const Model &model = *versions_.current, &prepared = *versions_.prepared;
  const Tissue* tissue = model.tissue_of(device.label);
  if (device.label == 0 || !tissue) return 0;
  const bool by_proxy = method == ForceMethod::kProxy && model.has(method);
  if (by_proxy && model.is_deformable(*tissue)) return deformable_stiffness_N_per_mm(device);
  if (by_proxy) return gains.by_proxy(tissue->stiffness_N_per_mm);
  // the fields encode the stiffnesses that they were generated for
  const double stiffest = model.max_stiffness_N_per_mm();
  const double own = prepared.tissue_of(device.label)->stiffness_N_per_mm;
  const double remaining_fraction = std::min(1.0, stiffest / prepared.max_stiffness_N_per_mm());
  const double all_points = stiffest * static_cast<double>(model.tool_of(device_number).points_mm.size());
  return gains.at_device(own * remaining_fraction * gains.direct_method_factor(all_points));
}

}  // namespace palpate
