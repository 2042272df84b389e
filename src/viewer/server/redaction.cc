#include "server/redaction.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "palpate/base/hash.h"
#include "server/redacted_labels.h"
#include "server/redacted_region.h"
#include "server/viewed_vectors.h"
#include "server/volume_payload.h"

namespace palpate::server {
namespace {

constexpr std::size_t kLabels = std::size_t{std::numeric_limits<LabelId>::max()} + 1;

/// Flags that follow from poses, forces, the device or requests. The others depend on the structures in
/// contact.
constexpr std::uint32_t kVisibleFlags = kFlagNotFinite | kFlagOutside | kFlagPaused | kFlagRotationIgnored |
                                        kFlagThermal | kFlagRamp | kFlagStale | kFlagJump | kFlagDeviceFault |
                                        kFlagHalted | kFlagEmergencyStop | kFlagClutched | kFlagBlend;
/// Relative tolerance within which a force counts as being at its limit.
constexpr double kAtLimit = 1 - 1e-6;

double norm(const std::array<double, 3>& v) {
  return std::hypot(v[0], v[1], v[2]);
}

/// Drops the reason of a failure, because it may name structures.
std::optional<Error> without_reason(const std::optional<Error>& failure) {
  if (!failure) return std::nullopt;
  return Error{failure->kind, "could not be prepared", failure->where, ""};
}

}  // namespace

bool has_quiz(const ViewedScene& scene) {
  return std::ranges::any_of(scene.tasks, &ViewedTask::quiz);
}

Redaction::Redaction(const ViewedScene& scene) : hidden_(kLabels), scene_(scene) {
  for (const ViewedTask& task : scene.tasks)
    for (const LabelId label : task.quiz ? task.to_find : std::vector<LabelId>()) hidden_[label] = label != 0;
  // caveats may describe hidden tissues
  scene_.caveats.clear();
  scene_.labels = redacted_labels(scene.labels, hidden_);
  has_wide_labels_ = needs_wide_labels(*scene_.labels);
  hide_tissues(scene);
  hide_structures(scene);
  hide_no_go();
  hide_recording();
  hide_in_tasks();
  scene_.content_hash = content_hash();
  // distances are measured to the surfaces of all structures, hidden ones included
  scene_.distance_reach_mm.reset();
  is_cut_ = std::ranges::any_of(scene_.tools, &ViewedTool::cuts);
  contact_ = std::make_unique<const RedactedContact>(scene_);
}

// differs from the hash under which a client may have cached the original voxels
std::uint64_t Redaction::content_hash() const {
  constexpr std::uint64_t kRedacted = 0x7665696c;
  std::uint64_t hash = kHashSeed;
  hash_word(hash, kRedacted);
  for (const int dim : scene_.labels->geometry().dims) hash_word(hash, static_cast<std::uint64_t>(dim));
  hash_word(hash, scene_.labels->content_hash());
  if (scene_.scan) {
    const std::vector<float>& voxels = scene_.scan->voxels();
    hash_bytes(hash, voxels.data(), voxels.size() * sizeof voxels[0]);
  }
  return hash_finish(hash);
}

// drops tissues that only hidden structures belong to
void Redaction::hide_tissues(const ViewedScene& whole) {
  std::vector<bool> is_hidden(whole.tissues.size()), is_visible(whole.tissues.size());
  for (const ViewedStructure& structure : whole.structures)
    if (structure.tissue >= 0)
      (hidden_[structure.label] ? is_hidden : is_visible)[static_cast<std::size_t>(structure.tissue)] = true;
  tissue_index_.assign(whole.tissues.size(), -1);
  scene_.tissues.clear();
  for (std::size_t t = 0; t < whole.tissues.size(); ++t) {
    if (is_hidden[t] && !is_visible[t]) continue;
    tissue_index_[t] = static_cast<int>(scene_.tissues.size());
    scene_.tissues.push_back(whole.tissues[t]);
    scene_.tissues.back().name = "tissue " + std::to_string(scene_.tissues.size());
  }
  for (ViewedTissue& tissue : scene_.tissues) {
    std::vector<int> rests_on;
    for (const int below : tissue.rests_on)
      if (const int index = tissue_index_[static_cast<std::size_t>(below)]; index >= 0)
        rests_on.push_back(index);
    tissue.rests_on = std::move(rests_on);
  }
}

void Redaction::hide_structures(const ViewedScene& whole) {
  scene_.structures.clear();
  for (const ViewedStructure& structure : whole.structures) {
    if (hidden_[structure.label]) continue;
    scene_.structures.push_back(structure);
    ViewedStructure& redacted = scene_.structures.back();
    redacted.name = "structure " + std::to_string(scene_.structures.size());
    redacted.within.clear();
    if (redacted.tissue >= 0) redacted.tissue = tissue_index_[static_cast<std::size_t>(redacted.tissue)];
  }
}

void Redaction::hide_no_go() {
  const auto label_of = [](const ViewedNoGo& region) { return std::get_if<LabelId>(&region.shape); };
  // as soon as one region is a structure, the deepest region and its depth depend on voxels
  reports_no_go_ = !scene_.no_go.empty() && std::ranges::none_of(scene_.no_go, [&](const ViewedNoGo& region) {
    return label_of(region) != nullptr;
  });
  std::erase_if(scene_.no_go, [&](const ViewedNoGo& region) {
    const LabelId* label = label_of(region);
    return label != nullptr && hidden_[*label];
  });
  for (std::size_t n = 0; n < scene_.no_go.size(); ++n)
    scene_.no_go[n].name = "region " + std::to_string(n + 1);
}

// the contact intervals of structures would reveal hidden boundaries
void Redaction::hide_recording() {
  if (!scene_.recording) return;
  ViewedRecording& recording = *scene_.recording;
  recording.contacts.clear();
  recording.omitted_contacts = 0;
  std::erase_if(recording.events, [&](const ViewedRecording::Event& event) {
    return event.tissue >= 0 && tissue_index_[static_cast<std::size_t>(event.tissue)] < 0;
  });
  for (ViewedRecording::Event& event : recording.events)
    if (event.tissue >= 0) event.tissue = tissue_index_[static_cast<std::size_t>(event.tissue)];
}

void Redaction::hide_in_tasks() {
  const auto leave_out = [this](std::vector<LabelId>& labels) {
    std::erase_if(labels, [this](LabelId label) { return is_hidden(label); });
  };
  for (ViewedTask& task : scene_.tasks) {
    if (task.quiz) task.to_find.clear();
    for (ViewedTask::Region& region : task.regions) {
      if (region.extent && !region.extent->labels.empty()) {
        leave_out(region.extent->labels);
        // a region of hidden structures only has no place
        if (region.extent->labels.empty()) region.extent.reset();
      }
      region = region_in(scene_, region);
    }
    for (ViewedTask::Force& force : task.forces) leave_out(force.labels);
    for (ViewedTask::Protected& part : task.protections) leave_out(part.labels);
    for (ViewedTask::Metric& metric : task.metrics) leave_out(metric.labels);
  }
}

TickRecord Redaction::of(const TickRecord& tick) const {
  TickRecord redacted;
  redacted.tick = tick.tick;
  redacted.time_s = tick.time_s;
  redacted.model_version = tick.model_version;
  redacted.method = tick.method;
  redacted.switches = tick.switches;
  redacted.rotation_applied_wxyz = tick.rotation_applied_wxyz;
  redacted.devices = tick.devices;
  const auto devices = static_cast<std::size_t>(std::clamp(tick.devices, 1, kMaxDevices));
  for (std::size_t d = 0; d < devices; ++d) {
    const DeviceTick& device = tick.device[d];
    DeviceTick& shown = redacted.device[d];
    // pose and total force, as the hand has them
    shown.tip_patient_mm = shown.proxy_patient_mm = device.tip_patient_mm;
    shown.orientation_wxyz = device.orientation_wxyz;
    shown.velocity_patient_mm_s = device.velocity_patient_mm_s;
    shown.buttons = device.buttons;
    shown.force_N = device.force_N;
    shown.unclamped_force_N = norm(device.force_N);
    shown.limit_N = device.limit_N;
    shown.heat = device.heat;
    shown.flags = device.flags & kVisibleFlags;
    if (shown.unclamped_force_N > 0 && shown.unclamped_force_N >= kAtLimit * shown.limit_N)
      shown.flags |= kFlagClamped;
    if (reports_no_go_) {
      shown.no_go = device.no_go;
      shown.no_go_depth_mm = device.no_go_depth_mm;
      shown.no_go_N = device.no_go_N;
      shown.flags |= device.flags & kFlagNoGo;
    }
    // contact with the redacted labels, which do not include later cuts
    shown.depth_mm = kNoValue;
    if (is_cut_) continue;
    const RedactedContact::Touch touch = contact_->of(redacted, d);
    shown.proxy_patient_mm = array_of(touch.proxy_mm);
    shown.normal_patient = array_of(touch.normal);
    shown.depth_mm = touch.depth_mm;
    shown.label = touch.label;
    if (touch.label != 0) shown.flags |= kFlagContact;
  }
  return redacted;
}

ViewedState Redaction::of(const ViewedState& state) const {
  ViewedState redacted;
  static_cast<Settings&>(redacted) = state;
  redacted.method_awaited = state.method_awaited;
  redacted.method_failure = without_reason(state.method_failure);
  redacted.law = state.law;
  redacted.law_awaited = state.law_awaited;
  redacted.law_failure = without_reason(state.law_failure);
  redacted.law_cell_mm = state.law_cell_mm;
  redacted.requested_cell_mm = state.requested_cell_mm;
  redacted.motor_is_on = state.motor_is_on;
  redacted.sweeps = state.sweeps;
  redacted.undone_to = state.undone_to;
  redacted.strokes_to_undo = state.strokes_to_undo;
  redacted.strokes_to_redo = state.strokes_to_redo;
  redacted.model_version = state.model_version;
  for (std::size_t t = 0; t < std::min(state.tissues.size(), tissue_index_.size()); ++t)
    if (tissue_index_[t] >= 0) redacted.tissues.push_back(state.tissues[t]);
  redacted.stop = state.stop;
  redacted.stopped_by = state.stopped_by;
  redacted.stopped_by_viewer = state.stopped_by_viewer;
  redacted.armed = state.armed;
  redacted.recording = state.recording;
  if (state.playback)
    redacted.playback = {state.playback->playing, state.playback->speed,
                         without_reason(state.playback->failure)};
  redacted.lesson = state.lesson;
  return redacted;
}

const ViewedTask* Redaction::task_of(const std::string& name) const {
  const auto found = std::ranges::find(scene_.tasks, name, &ViewedTask::name);
  return found == scene_.tasks.end() ? nullptr : &*found;
}

// which step is done, and to what degree, reveals the structure in contact: progress is recomputed from the
// redacted data
ViewedTraining Redaction::of(const ViewedTraining& training, const RedactedSteps& steps,
                             const TickRecord& tick) const {
  ViewedTraining redacted;
  redacted.phase = training.phase;
  redacted.run = training.run;
  redacted.task = training.task;
  redacted.time_s = training.time_s;
  redacted.missing_s = training.missing_s;
  redacted.is_stored = training.is_stored;
  redacted.done = steps.done();
  redacted.fraction = steps.fraction();
  for (const ViewedTaskEvent& event : training.events)
    if (std::string_view(event.kind) == "ended") redacted.events.push_back({event.kind, 0, event.time_s, 0});
  const ViewedTask* task = task_of(training.task);
  if (task == nullptr) return redacted;
  const auto devices = static_cast<std::size_t>(std::clamp(tick.devices, 1, kMaxDevices));
  const auto force_on = [&](const std::vector<LabelId>& labels) {
    double force_N = 0;
    for (std::size_t d = 0; d < devices; ++d)
      if (std::ranges::find(labels, tick.device[d].label) != labels.end())
        force_N += norm(tick.device[d].force_N);
    return force_N;
  };
  for (const ViewedTask::Force& force : task->forces) redacted.forces_N.push_back(force_on(force.labels));
  for (const ViewedTask::Protected& part : task->protections)
    redacted.protected_N.push_back(force_on(part.labels));
  for (std::size_t d = 0; d < devices; ++d)
    if (tick.device[d].label != 0) redacted.touch_N += norm(tick.device[d].force_N);
  return redacted;
}

// compute time depends on the contacts of the tool, and the lateness of the next tick depends on it
ViewedHealth Redaction::of(const ViewedHealth& health) const {
  ViewedHealth redacted;
  redacted.rate_hz = health.rate_hz;
  redacted.skipped = health.skipped;
  redacted.dropped = health.dropped;
  redacted.stalls = health.stalls;
  return redacted;
}

RedactedCuts::RedactedCuts(std::shared_ptr<const Bricks<LabelId>> whole,
                           std::shared_ptr<const Bricks<LabelId>> redacted)
    : whole_(std::move(whole)), redacted_(std::move(redacted)), cut_(whole_), redacted_cut_(redacted_) {}

std::shared_ptr<const Bricks<LabelId>> RedactedCuts::of(const std::shared_ptr<const Bricks<LabelId>>& cut) {
  if (cut == cut_) return redacted_cut_;
  const VoxelBox box = box_of_changes(*cut_, *cut);
  if (box.voxel_count() > 0) {
    PatchOf<LabelId> patch{box, {}};
    patch.values.reserve(box.voxel_count());
    for (int k = box.first[2]; k < box.first[2] + box.size[2]; ++k)
      for (int j = box.first[1]; j < box.first[1] + box.size[1]; ++j)
        for (int i = box.first[0]; i < box.first[0] + box.size[0]; ++i) {
          const bool is_gone = cut->at(i, j, k) == 0 && whole_->at(i, j, k) != 0;
          patch.values.push_back(is_gone ? LabelId{0} : redacted_->at(i, j, k));
        }
    redacted_cut_ = std::make_shared<const Bricks<LabelId>>(redacted_cut_->with(patch));
  }
  cut_ = cut;
  return redacted_cut_;
}

}  // namespace palpate::server
