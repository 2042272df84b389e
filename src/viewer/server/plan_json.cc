#include "server/plan_json.h"

#include "palpate/base/printable.h"
#include "palpate/json/json.h"

namespace palpate::server {
namespace {

Json allowed_json(const std::optional<double>& within) {
  return within ? Json(*within) : Json();
}

Json trajectory_json(const ViewedPlan::Trajectory& trajectory) {
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
  Json json = {
      {"type", "plan"}, {"version", plan.version}, {"saved", plan.saved}, {"can_change", plan.can_change}};
  json["trajectories"] = Json::array();
  for (const ViewedPlan::Trajectory& trajectory : plan.trajectories)
    json["trajectories"].push_back(trajectory_json(trajectory));
  json["keep_away"] = Json::array();
  for (const ViewedPlan::KeepAway& keep : plan.keep_away)
    json["keep_away"].push_back({{"label", keep.label}, {"mm", keep.mm}});
  return json.dump();
}

}  // namespace palpate::server
