#include "server/task_json.h"

#include <cmath>

#include "palpate/base/printable.h"
#include "palpate/json/json.h"
#include "server/error_json.h"

namespace palpate::server {
namespace {

// unknown and non-finite values become null
std::string line_of(const Json& json) {
  return json.dump();
}

template <class Value>
Json or_null(const std::optional<Value>& value) {
  return value ? Json(*value) : Json();
}

// a thousandth of a second, millimetre or newton is below the display's resolution
double thousandths(double value) {
  return std::round(1000 * value) / 1000;
}

Json point_json(const std::array<double, 3>& point) {
  return {thousandths(point[0]), thousandths(point[1]), thousandths(point[2])};
}

Json events_json(const std::vector<ViewedTaskEvent>& events) {
  Json list = Json::array();
  for (const ViewedTaskEvent& event : events)
    list.push_back(
        {{"kind", event.kind}, {"part", event.part}, {"time_s", event.time_s}, {"force_N", event.force_N}});
  return list;
}

const char* phase_text(ViewedTraining::Phase phase) {
  switch (phase) {
    case ViewedTraining::Phase::kNone:
      return "none";
    case ViewedTraining::Phase::kRunning:
      return "running";
    case ViewedTraining::Phase::kStoring:
      return "keeping";
    case ViewedTraining::Phase::kOver:
      return "over";
  }
  return "none";
}

Json steps_json(const std::vector<bool>& done) {
  Json list = Json::array();
  for (const bool one : done) list.push_back(one);
  return list;
}

}  // namespace

Json task_json(const ViewedTask& task) {
  Json json;
  json["name"] = printable_name(task.name);
  json["title"] = printable_name(task.title);
  json["briefing"] = printable(task.briefing);
  json["quiz"] = task.quiz;
  json["ordered"] = task.ordered;
  json["ends_with_steps"] = task.ends_with_steps;
  json["time_limit_s"] = or_null(task.time_limit_s);
  json["answer_s"] = or_null(task.answer_s);
  json["to_find"] = task.to_find;
  json["in_a_row"] = task.in_a_row;
  json["scope"] =
      task.scope ? Json{{"optics_deg", task.scope->optics_deg}, {"back_mm", task.scope->back_mm}} : Json();
  json["regions"] = Json::array();
  for (const ViewedTask::Region& region : task.regions)
    json["regions"].push_back({{"name", printable_name(region.name)},
                               {"middle_mm", region.centre_mm},
                               {"radius_mm", region.radius_mm},
                               {"outward", region.outward}});
  json["steps"] = Json::array();
  for (const ViewedTask::Step& step : task.steps)
    json["steps"].push_back({{"name", printable_name(step.name)},
                             {"kind", step.kind},
                             {"region", step.region},
                             {"force_N", step.force_N},
                             {"seconds", step.seconds},
                             {"coverage", step.coverage},
                             {"seen", step.in_scope_view}});
  json["forces"] = Json::array();
  for (const ViewedTask::Force& force : task.forces)
    json["forces"].push_back(
        {{"labels", force.labels}, {"band_N", or_null(force.band_N)}, {"limit_N", or_null(force.limit_N)}});
  json["protected"] = Json::array();
  for (const ViewedTask::Protected& part : task.protections)
    json["protected"].push_back({{"labels", part.labels}, {"limit_N", part.limit_N}});
  json["metrics"] = Json::array();
  for (const ViewedTask::Metric& metric : task.metrics)
    json["metrics"].push_back(
        {{"name", metric.name},
         {"unit", metric.unit},
         {"labels", metric.labels},
         {"more_is_better", metric.more_is_better},
         {"at_least", or_null(metric.at_least)},
         {"at_most", or_null(metric.at_most)},
         {"basis", metric.basis.empty() ? Json() : Json(printable_name(metric.basis))}});
  return json;
}

std::string training_json(const ViewedTraining& training) {
  Json json;
  json["type"] = "task";
  json["phase"] = phase_text(training.phase);
  json["run"] = training.run;
  json["task"] = training.run == 0 ? Json() : Json(printable_name(training.task));
  json["time_s"] = thousandths(training.time_s);
  json["done"] = steps_json(training.done);
  json["share"] = Json::array();
  for (const double fraction : training.fraction) json["share"].push_back(thousandths(fraction));
  json["forces_N"] = Json::array();
  for (const double force_N : training.forces_N) json["forces_N"].push_back(thousandths(force_N));
  json["protected_N"] = Json::array();
  for (const double force_N : training.protected_N) json["protected_N"].push_back(thousandths(force_N));
  json["touch_N"] = thousandths(training.touch_N);
  json["unseen"] = training.unseen;
  json["missing_s"] = training.missing_s;
  json["events"] = events_json(training.events);
  json["events_before"] = training.events_before;
  json["keeps"] = training.is_stored;
  return line_of(json);
}

std::string debriefing_json(const ViewedDebriefing& debriefing) {
  Json json;
  json["type"] = "debriefing";
  json["run"] = debriefing.run;
  json["task"] = printable_name(debriefing.task);
  json["end"] = debriefing.end;
  json["in_band"] = debriefing.in_band;
  json["time_s"] = debriefing.time_s;
  json["missing_s"] = debriefing.missing_s;
  json["ticks"] = debriefing.ticks;
  json["first_tick"] = debriefing.first_tick;
  json["last_tick"] = debriefing.last_tick;
  json["metrics"] = Json::array();
  for (const ViewedDebriefing::Metric& metric : debriefing.metrics)
    json["metrics"].push_back({{"value", metric.value}, {"in_band", metric.in_band}, {"best", metric.best}});
  json["done"] = steps_json(debriefing.done);
  json["events"] = events_json(debriefing.events);
  json["more_events"] = debriefing.more_events;
  json["samples"] = Json::array();
  for (const ViewedDebriefing::Sample& sample : debriefing.samples) {
    Json row = {thousandths(sample.time_s)};
    for (const double mm : sample.tip_mm) row.push_back(thousandths(mm));
    row.push_back(thousandths(sample.touch_N));
    for (std::size_t n = 0; n < debriefing.forces; ++n) row.push_back(thousandths(sample.forces_N[n]));
    json["samples"].push_back(std::move(row));
  }
  json["patches"] = Json::array();
  for (const ViewedDebriefing::Patch& patch : debriefing.patches) {
    Json row = point_json(patch.centre_mm);
    row.push_back(patch.covered ? 1 : 0);
    json["patches"].push_back(std::move(row));
  }
  json["patches_left_out"] = debriefing.omitted_patches;
  json["answer_mm"] = debriefing.answer_mm ? point_json(*debriefing.answer_mm) : Json();
  json["to_find_mm"] = debriefing.to_find_mm ? point_json(*debriefing.to_find_mm) : Json();
  json["runs"] = debriefing.runs;
  json["in_a_row"] = debriefing.in_a_row;
  json["kept"] = or_null(debriefing.run_id);
  json["not_stored"] = debriefing.not_stored ? error_json(*debriefing.not_stored) : Json();
  return line_of(json);
}

}  // namespace palpate::server
