#include "link/plan_json.h"

#include <nlohmann/json.hpp>

#include "palpate/base/printable.h"

namespace palpate::link {
namespace {

using PlanJson = nlohmann::ordered_json;

PlanJson allowed_json(const std::optional<double>& within) {
  return within ? PlanJson(*within) : PlanJson();
}

PlanJson trajectory_json(const ViewedPlan::Trajectory& trajectory) {
  return {{"name", printable_name(trajectory.name)},
          {"entry_mm", trajectory.entry_mm},
          {"target_mm", trajectory.target_mm},
          {"entry_within_mm", allowed_json(trajectory.entry_within_mm)},
          {"target_within_mm", allowed_json(trajectory.target_within_mm)},
          {"angle_within_deg", allowed_json(trajectory.angle_within_deg)},
          {"depth_within_mm", allowed_json(trajectory.depth_within_mm)}};
}

}  // namespace

std::string plan_json(const ViewedPlan& plan) {
  PlanJson json = {
      {"type", "plan"}, {"version", plan.version}, {"saved", plan.saved}, {"can_change", plan.can_change}};
  json["trajectories"] = PlanJson::array();
  for (const ViewedPlan::Trajectory& trajectory : plan.trajectories)
    json["trajectories"].push_back(trajectory_json(trajectory));
  json["keep_away"] = PlanJson::array();
  for (const ViewedPlan::KeepAway& keep : plan.keep_away)
    json["keep_away"].push_back({{"label", keep.label}, {"mm", keep.mm}});
  return json.dump(-1, ' ', false, PlanJson::error_handler_t::replace);
}

}  // namespace palpate::link
