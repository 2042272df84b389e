#include "plan_comparison.h"

#include <array>
#include <cmath>

#include "palpate/json/json.h"
#include "palpate/loading/loading.h"
#include "palpate/palpation/recorded_model.h"
#include "scoring.h"

namespace palpate::app {
namespace {

Json json_of(const Point<Patient>& p) {
  return {p.x(), p.y(), p.z()};
}
Json json_of(const RunPoint& point) {
  return {{"tick", point.tick}, {"time_s", point.time_s}, {"at_mm", json_of(point.at)}};
}
Json json_of(const ToleratedValue& figure) {
  return {{"value", number_or_null(figure.value)},
          {"allowed", number_or_null(figure.allowed)},
          {"kept", figure.is_within_limit()}};
}
Json json_of(const VolumeResult& volume) {
  return {{"planned_mm3", volume.planned_mm3},
          {"removed_mm3", volume.removed_mm3},
          {"left_mm3", volume.remaining_mm3()}};
}

Json json_of(const PlanTrajectory& planned, const TrajectoryResult& done) {
  const bool is_entered = done.entry_kind != EntryKind::kNone;
  const bool is_deep = !std::isnan(done.depth_mm), is_near = !std::isnan(done.target_error_mm.value);
  return {{"name", planned.name},
          {"planned_entry_mm", json_of(planned.entry)},
          {"planned_target_mm", json_of(planned.target)},
          {"planned_depth_mm", planned.length_mm()},
          {"entry_made", word_of(done.entry_kind)},
          {"entry", is_entered ? json_of(done.entry) : Json(nullptr)},
          {"nearest", is_near ? json_of(done.nearest) : Json(nullptr)},
          {"deepest", is_deep ? json_of(done.deepest) : Json(nullptr)},
          {"entry_error_mm", json_of(done.entry_error_mm)},
          {"target_error_mm", json_of(done.target_error_mm)},
          {"lateral_mm", number_or_null(done.lateral_mm)},
          {"along_mm", number_or_null(done.along_mm)},
          {"angle_deg", json_of(done.angle_deg)},
          {"off_line_mm", number_or_null(done.line_rms_mm)},
          {"depth_mm", number_or_null(done.depth_mm)},
          {"depth_error_mm", json_of(done.depth_error_mm)},
          {"shaft_deg", number_or_null(done.shaft_deg)},
          {"kept", done.is_within_limit()}};
}

}  // namespace

Result<PlannedScene> scene_of_plan(const PlanFile& plan, std::shared_ptr<const Model> model,
                                   Console& console) {
  const Progress progress = console.progress();
  auto found = resolve_plan(plan, *model);
  if (!found) return found.error();
  if (has_touchable_tissue(*model)) {
    constexpr std::array kProxyAlone = {ForceMethod::kProxy};
    auto ready = prepared_with_cache(std::move(model), kProxyAlone, progress);
    if (!ready) return ready.error();
    model = *std::move(ready);
  }
  auto distances = structure_distances(*model, progress);
  if (!distances) return distances.error();
  return PlannedScene{std::move(model), *std::move(found), *std::move(distances)};
}

Result<PlanComparison> compare_run(const PlannedScene& scene, const RecordingSource& recording,
                                   const std::string& name, std::size_t device, Console& console) {
  const auto named = [&](Error error) {
    if (error.where.empty() && error.kind != ErrorKind::kInterrupted) error.where = name;
    return error;
  };
  if (const auto same = check_recorded_model(recording.head().header, *scene.model); !same)
    return named(same.error());
  auto made =
      compare_recording(scene.plan, *scene.model, scene.distances, recording, device, console.progress());
  if (!made) return named(made.error());
  return made;
}

Json json_of(const PlannedScene& scene, const PlanComparison& made) {
  const Model& model = *scene.model;
  const PlanFile& plan = scene.plan.file;
  Json json{{"plan", plan.title},
            {"kept", made.is_within_limit()},
            {"ticks", made.ticks},
            {"time_s", made.time_s},
            {"cut_short", made.cut_short},
            {"missing_s", made.missing_s},
            {"without_place", made.invalid_ticks},
            {"trajectories", Json::array()},
            {"regions", Json::array()},
            {"volumes", Json::array()},
            {"structures", Json::array()},
            {"breaches", Json::array()},
            {"more_breaches", made.omitted_violations}};
  for (std::size_t n = 0; n < made.trajectories.size(); ++n)
    json["trajectories"].push_back(json_of(plan.trajectories[n], made.trajectories[n]));
  for (std::size_t n = 0; n < made.regions.size(); ++n) {
    Json region{{"name", plan.regions[n].name}};
    region.update(json_of(made.regions[n]));
    json["regions"].push_back(region);
  }
  for (const StructureVolume& volume : made.volumes) {
    Json structure{{"name", model.name_of(volume.label)}, {"label", volume.label}};
    structure.update(json_of(volume.in_plan));
    structure["outside_mm3"] = volume.outside_mm3;
    json["volumes"].push_back(structure);
  }
  for (const StructureClearance& approach : made.approaches) {
    const bool is_known = !std::isnan(approach.nearest_mm);
    Json over_time = Json::array();
    for (const float mm : approach.over_time_mm) over_time.push_back(number_or_null(static_cast<double>(mm)));
    json["structures"].push_back({{"name", model.name_of(approach.label)},
                                  {"label", approach.label},
                                  {"nearest_mm", number_or_null(approach.nearest_mm)},
                                  {"nearest", is_known ? json_of(approach.nearest) : Json(nullptr)},
                                  {"requested_mm", number_or_null(approach.requested_mm)},
                                  {"kept", approach.is_within_limit()},
                                  {"below_s", approach.below_s},
                                  {"over_time_mm", over_time}});
  }
  json["times_s"] = made.times_s;
  for (const ClearanceViolation& violation : made.violations)
    json["breaches"].push_back({{"name", model.name_of(violation.label)},
                                {"label", violation.label},
                                {"requested_mm", violation.requested_mm},
                                {"nearest_mm", violation.nearest_mm},
                                {"begin", json_of(violation.begin)},
                                {"nearest", json_of(violation.nearest)},
                                {"last_tick", violation.last_tick},
                                {"end_s", violation.end_s}});
  return json;
}

}  // namespace palpate::app
