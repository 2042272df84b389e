#include "server/scene_json.h"

#include <cmath>

#include "palpate/base/printable.h"
#include "palpate/json/json.h"
#include "palpate_version.h"
#include "server/error_json.h"
#include "server/pose_message.h"
#include "server/task_json.h"

namespace palpate::server {
namespace {

// keys in the order of the document; unknown and non-finite values become null
std::string text_of(const Json& json) {
  return json.dump();
}

// names come from files, and go to a page
Json shown(const std::string& name) {
  return printable_name(name);
}

Json colour_json(const Rgb& colour) {
  return {colour.r, colour.g, colour.b};
}

Json matrix_json(const Eigen::Matrix4d& matrix) {
  Json rows = Json::array();
  for (int row = 0; row < 4; ++row)
    rows.push_back({matrix(row, 0), matrix(row, 1), matrix(row, 2), matrix(row, 3)});
  return rows;
}

Json volume_json(const ViewedScene& scene, const VolumeFacts& facts) {
  const GridGeometry& grid = scene.labels->geometry();
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
  matrix.topLeftCorner<3, 3>() = X_PatientVoxel.linear();
  matrix.topRightCorner<3, 1>() = X_PatientVoxel.translation();
  Json json;
  json["hash"] = facts.hash;
  json["dims"] = grid.dims;
  json["patient_from_voxel"] = matrix_json(matrix);
  json["scan"] = nullptr;
  if (scene.scan)
    json["scan"] = {
        {"scale", facts.scale}, {"offset", facts.offset}, {"window", scene.window}, {"range", facts.range}};
  json["labels"] = {{"type", facts.wide_labels ? "uint16" : "uint8"}};
  return json;
}

// originator of the stop from the point of view of the viewer that receives it
const char* who_stopped(const ViewedState& state, std::uint32_t recipient) {
  switch (state.stopped_by) {
    case StoppedBy::kSession:
      return "palpate";
    case StoppedBy::kKey:
      return "key";
    case StoppedBy::kViewer:
      return state.stopped_by_viewer == recipient ? "you" : "viewer";
  }
  return "palpate";
}

Json contact_json(const ContactProperties& properties) {
  Json json = Json::object();
  for (const ContactProperty& property : kContactProperties)
    json[std::string(property.name)] = properties.*property.value;
  return json;
}

Json tissues_json(const ViewedScene& scene, const ViewedState& state) {
  Json tissues = Json::array();
  for (std::size_t t = 0; t < scene.tissues.size(); ++t) {
    const ViewedTissue& tissue = scene.tissues[t];
    Json json = {{"name", shown(tissue.name)},
                 {"touchable", tissue.touchable},
                 {"protection", tissue.protection},
                 {"colour", colour_json(tissue.colour)},
                 {"opacity", tissue.opacity}};
    json.update(contact_json(t < state.tissues.size() ? state.tissues[t] : ContactProperties{0, 0, 0, 0}));
    json["rests_on"] = tissue.rests_on;
    tissues.push_back(std::move(json));
  }
  return tissues;
}

Json structures_json(const ViewedScene& scene) {
  Json structures = Json::array();
  for (const ViewedStructure& structure : scene.structures)
    structures.push_back({{"label", structure.label},
                          {"name", shown(structure.name)},
                          {"colour", colour_json(structure.colour)},
                          {"tissue", structure.tissue},
                          {"within", structure.within}});
  return structures;
}

Json field_json(const std::string& text) {
  return shown(text);
}
Json field_json(const std::optional<std::string>& text) {
  return text ? shown(*text) : Json();
}
template <class Value>
Json field_json(const Value& value) {
  return value;
}
template <class Fields>
Json fields_json(const Fields& fields);
Json field_json(const std::vector<ViewedTool::Capsule>& capsules) {
  Json json = Json::array();
  for (const ViewedTool::Capsule& capsule : capsules) json.push_back(fields_json(capsule));
  return json;
}
template <class Fields>
Json fields_json(const Fields& fields) {
  Json json = Json::object();
  visit_fields(fields, [&](const char* name, const auto& value) { json[name] = field_json(value); });
  return json;
}

// exactly one of the three shapes is not null
Json no_go_json(const ViewedNoGo& region) {
  const auto* label = std::get_if<LabelId>(&region.shape);
  const auto* plane = std::get_if<ViewedNoGo::Plane>(&region.shape);
  const auto* ball = std::get_if<ViewedNoGo::Ball>(&region.shape);
  Json json = {{"name", shown(region.name)}, {"keep_away_mm", region.keep_away_mm}};
  json["label"] = label ? Json(*label) : Json();
  json["plane"] = plane ? Json{{"point_mm", plane->point_mm}, {"outward", plane->outward}} : Json();
  json["ball"] = ball ? Json{{"centre_mm", ball->centre_mm}, {"radius_mm", ball->radius_mm}} : Json();
  return json;
}

Json recording_json(const ViewedRecording& recording) {
  Json contacts = Json::array(), events = Json::array();
  for (const ViewedRecording::Contact& contact : recording.contacts)
    contacts.push_back({contact.begin_s, contact.end_s, contact.label, contact.max_N, contact.device});
  for (const ViewedRecording::Event& event : recording.events)
    events.push_back({{"time_s", event.time_s},
                      {"kind", event.kind},
                      {"changed", event.changed},
                      {"tissue", event.tissue < 0 ? Json() : Json(event.tissue)},
                      {"by", event.by},
                      {"viewer", event.viewer == 0 ? Json() : Json(event.viewer)}});
  return {{"ticks", recording.ticks},
          {"begin_s", recording.begin_s},
          {"end_s", recording.end_s},
          {"contacts", contacts},
          {"contacts_left_out", recording.omitted_contacts},
          {"events", events},
          {"events_left_out", recording.omitted_events},
          {"force_N", recording.force_N}};
}

// role and permissions of the receiver
void add_who(Json& json, const AuthenticatedViewer& who, bool has_tasks, bool stores_runs) {
  json["role"] = name_of(who.role);
  json["learner"] = who.learner.empty() ? Json() : shown(who.learner);
  json["may"] = permissions_of(who.role, has_tasks, stores_runs);
}

// the learner is disclosed to teachers and to that learner only
Json lesson_json(const ViewedState::Lesson& lesson, const StateRecipient& recipient) {
  const bool is_reported = recipient.who.role == Role::kTeacher ||
                           (recipient.who.role == Role::kLearner && recipient.who.learner == lesson.learner);
  Json learners;
  if (recipient.who.role == Role::kTeacher) {
    learners = Json::array();
    for (const ListedLearner& listed : recipient.learners)
      learners.push_back(
          {{"learner", shown(listed.learner)}, {"here", listed.is_here}, {"pointer", listed.has_pointer}});
  }
  return {{"learner", is_reported && !lesson.learner.empty() ? shown(lesson.learner) : Json()},
          {"of_another", recipient.who.role == Role::kLearner && !lesson.is_for(recipient.who.learner)},
          {"task", lesson.task.empty() ? Json() : shown(lesson.task)},
          {"names", recipient.shows_hidden_names},
          {"redacted", recipient.redacted},
          {"learners", std::move(learners)},
          {"over", lesson.is_over}};
}

Json playback_json(const ViewedState::Playback& playback) {
  return {{"playing", playback.playing},
          {"speed", playback.speed},
          {"failed", playback.failure ? error_json(*playback.failure) : Json()}};
}

// permitted ranges of the force limit and of every contact property
Json limits_json(const ViewedScene& scene, const ViewedState& state) {
  Json json = {{"max_force_N", state.max_force_N},
               {"min_max_force_N", scene.max_force_range.min},
               {"max_max_force_N", scene.max_force_range.max}};
  for (const ContactProperty& property : kContactProperties)
    json[std::string(property.name)] = {property.range.min, property.range.max};
  return json;
}

}  // namespace

std::string hash_text(std::uint64_t hash) {
  constexpr std::string_view kDigits = "0123456789abcdef";
  std::string text;
  for (int shift = 60; shift >= 0; shift -= 4) text += kDigits[hash >> shift & 15];
  return text;
}

std::string scene_json(const ViewedScene& scene, const ViewedState& state, const VolumeFacts& facts,
                       const AuthenticatedViewer& who, bool stores_runs) {
  Json json;
  json["protocol"] = kProtocolVersion;
  json["palpate"] = PALPATE_VERSION;
  add_who(json, who, !scene.tasks.empty(), stores_runs);
  json["side"] = scene.side;
  json["oriented"] = scene.oriented;
  json["caveats"] = Json::array();
  for (const ViewedCaveat& caveat : scene.caveats)
    json["caveats"].push_back({{"concerns", caveat.concerns}, {"text", shown(caveat.text)}});
  json["modality"] = scene.modality;
  json["volume"] = volume_json(scene, facts);
  json["world_from_patient"] = scene.world_from_patient;
  json["structures"] = structures_json(scene);
  json["tissues"] = tissues_json(scene, state);
  json["tools"] = Json::array();
  for (const ViewedTool& tool : scene.tools) json["tools"].push_back(fields_json(tool));
  // for older viewers, which support a single tool
  json["tool"] = json["tools"].front();
  json["methods"] = scene.methods;
  json["laws"] = scene.laws;
  json["device"] = {{"name", shown(scene.device_name)},
                    {"simulated", scene.simulated},
                    {"input", scene.input},
                    {"peak_force_N", scene.peak_force_N},
                    {"continuous_force_N", scene.continuous_force_N},
                    {"max_stiffness_N_per_mm", scene.max_stiffness_N_per_mm}};
  json["limits"] = limits_json(scene, state);
  json["rate_hz"] = scene.rate_hz;
  json["recording"] = scene.recording ? recording_json(*scene.recording) : Json();
  json["tasks"] = Json::array();
  for (const ViewedTask& task : scene.tasks) json["tasks"].push_back(task_json(task));
  json["distances"] = scene.distance_reach_mm ? Json{{"reach_mm", *scene.distance_reach_mm}} : Json();
  json["no_go"] = Json::array();
  for (const ViewedNoGo& region : scene.no_go) json["no_go"].push_back(no_go_json(region));
  return text_of(json);
}

std::string state_json(const ViewedState& state, const StateRecipient& recipient) {
  Json json;
  json["type"] = "state";
  visit_settings(
      [&](const auto& setting) { json[std::string(setting.name)] = message_value(state.*setting.value); });
  json[std::string(kLawSetting)] = state.law;
  json["law_awaited"] = state.law_awaited.empty() ? Json() : Json(state.law_awaited);
  json["law_failed"] = state.law_failure ? error_json(*state.law_failure) : Json();
  json["law_cells"] = state.law_cell_mm > 0
                          ? Json{{"mm", state.law_cell_mm}, {"requested_mm", state.requested_cell_mm}}
                          : Json();
  json["method_awaited"] = state.method_awaited.empty() ? Json() : Json(state.method_awaited);
  json["method_failed"] = state.method_failure ? error_json(*state.method_failure) : Json();
  json["motor_is_on"] = state.motor_is_on;
  json["emergency_stop"] = state.stop.has_value();
  json["stop"] = state.stop ? Json(*state.stop) : Json();
  json["stopped_by"] = state.stop ? Json(who_stopped(state, recipient.number)) : Json();
  json["model_version"] = state.model_version;
  json["strokes"] = {{"undo", state.strokes_to_undo}, {"redo", state.strokes_to_redo}};
  json["removed"] = Json::array();
  for (const auto& [label, mm3] : state.removed_mm3)
    json["removed"].push_back({{"label", label}, {"mm3", mm3}});
  json["broken_off_mm3"] = state.broken_off_mm3;
  json["nearest"] = Json::array();
  for (const auto& [label, mm] : state.nearest_mm) json["nearest"].push_back({{"label", label}, {"mm", mm}});
  json["tissues"] = Json::array();
  for (const ContactProperties& tissue : state.tissues) json["tissues"].push_back(contact_json(tissue));
  json["armed"] = state.armed;
  json["recording"] = state.recording;
  json["playback"] = state.playback ? playback_json(*state.playback) : Json();
  json["viewers"] = recipient.viewers;
  const bool is_holder = recipient.pointer_owner != 0 && recipient.pointer_owner == recipient.number;
  json["pointer"] = is_holder;
  json["pointer_by"] = recipient.pointer_owner == 0 ? Json() : Json(is_holder ? "you" : "viewer");
  json["lesson"] = lesson_json(state.lesson, recipient);
  return text_of(json);
}

std::string navigation_json(const ViewedNavigation& navigation) {
  const auto shown_mm = [](double mm) { return std::round(100 * mm) / 100; };
  Json json = {{"type", "navigation"},
               {"device", navigation.device},
               {"seen", navigation.is_visible},
               {"fre_mm", shown_mm(navigation.fre_mm)}};
  json["tre_mm"] = navigation.tip ? Json(shown_mm(navigation.tip->rms_mm)) : Json();
  json["tre_95_mm"] = navigation.tip ? Json(shown_mm(navigation.tip->max_mm)) : Json();
  json["far"] = navigation.tip && navigation.tip->is_far;
  return text_of(json);
}

std::string welcome_json(const AuthenticatedViewer& who, bool has_tasks, bool stores_runs) {
  Json json{{"type", "welcome"}};
  add_who(json, who, has_tasks, stores_runs);
  json["protocol"] = kProtocolVersion;
  return text_of(json);
}

std::string sweeps_json(std::uint64_t first, std::span<const SweepRecord> sweeps) {
  Json json = {{"type", "cut"}, {"first", first}};
  json["sweeps"] = Json::array();
  for (const SweepRecord& sweep : sweeps) {
    Json row = sweep.from_mm;
    for (const double mm : sweep.to_mm) row.push_back(mm);
    row.push_back(sweep.radius_mm);
    if (sweep.axis_mm != std::array<double, 3>{}) {
      for (const double mm : sweep.axis_mm) row.push_back(mm);
      row.push_back(sweep.end_radius_mm);
    }
    json["sweeps"].push_back(std::move(row));
  }
  return text_of(json);
}

std::string done_json(std::int64_t id) {
  return text_of({{"type", "done"}, {"id", id}});
}

std::string consent_request_json(std::int64_t id) {
  return text_of({{"type", "asked"}, {"id", id}});
}

std::string refused_json(std::int64_t id, const Error& error) {
  Json json = {{"type", "refused"}, {"id", id}};
  json.update(error_json(error));
  return text_of(json);
}

}  // namespace palpate::server
