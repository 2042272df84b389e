#include "palpate/session/playback.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <mutex>
#include <system_error>
#include <utility>

#include "palpate/base/force_method.h"
#include "palpate/contact/model.h"
#include "palpate/device/rendered_stiffness.h"
#include "palpate/loading/loading.h"
#include "palpate/model/changed_model.h"
#include "palpate/palpation/recorded_model.h"
#include "palpate/scene/named_values.h"
#include "session/clearance_history.h"
#include "session/cut_labels.h"
#include "session/cut_list.h"
#include "session/deformed_labels.h"
#include "session/playback_position.h"
#include "session/played_solutions.h"
#include "session/played_task.h"
#include "session/recorded_edits.h"
#include "session/recording_timeline.h"
#include "session/solution_index.h"
#include "session/tick_blocks.h"
#include "session/viewed_scene.h"

namespace palpate {
namespace {

class Playback final : public PlaybackHost {
 public:
  Playback(RecordingSource recording, std::shared_ptr<const Model> model, ViewedScene scene,
           const TickRecord& first, std::vector<double> begins_s, RecordedEdits edits,
           ClearanceHistory nearest, SolutionIndex solutions, std::unique_ptr<const PlayedTask> task,
           std::shared_ptr<SharedPlan> plan)
      : header_(recording.head().header),
        model_(std::move(model)),
        scene_(std::move(scene)),
        edits_(std::move(edits)),
        nearest_(std::move(nearest)),
        task_(std::move(task)),
        plan_(std::move(plan)),
        position_(scene_.recording->begin_s, scene_.recording->end_s),
        shown_(first),
        blocks_(
            [recording](std::size_t block, const Progress& progress) {
              return recording.read_at(block * TickBlocks::kTicks, TickBlocks::kTicks, progress);
            },
            std::move(begins_s)) {
    if (solutions.empty()) return;
    // A solution whose input ticks are in an earlier block is rare enough to be read separately.
    const auto tick_at = [this, source = std::move(recording)](
                             std::uint64_t row, const Progress& progress) -> std::optional<TickRecord> {
      if (auto stored = blocks_.stored_at(row)) return stored;
      auto read = source.read_at(row, 1, progress);
      return read && !read->empty() ? std::optional(read->front()) : std::nullopt;
    };
    solutions_ =
        std::make_unique<PlayedSolutions>(model_, std::move(solutions), edits_.cuts, edits_.laws, tick_at);
  }

  const ViewedScene& scene() const override { return scene_; }

  TickRecord snapshot(std::array<double, kMaxDevices>& stiffness_N_per_mm) const override {
    const std::lock_guard lock(mutex_);
    const double at_s = position_.now_s();
    const int direction = !position_.playing() ? 0 : position_.speed() > 0 ? 1 : -1;
    if (auto tick = blocks_.tick_at(at_s, direction, position_.from_s())) shown_ = *tick;
    const bool is_deformable = is_elastic(edits_.laws.at(shown_.model_version));
    if (solutions_ != nullptr) {
      constexpr double kNear_s = 0.25;
      const double speed = position_.playing() ? std::max(1.0, std::abs(position_.speed())) : 1.0;
      const auto near = static_cast<std::uint32_t>(kNear_s * speed / kSolverFrame_s);
      is_deformable ? solutions_->request(shown_.solver_frame, near) : solutions_->request(0, 0);
    }
    stiffness_N_per_mm = {};
    // a direct method's stiffness depends on the stiffest tissue of the model, so none is reported
    if (shown_.method != static_cast<std::uint8_t>(ForceMethod::kProxy)) return shown_;
    const auto tissues = tissues_at(shown_.model_version);
    for (std::size_t d = 0; d < static_cast<std::size_t>(shown_.devices); ++d) {
      const DeviceTick& device = shown_.device[d];
      const int tissue =
          device.label < model_->tissue_of_label.size() ? model_->tissue_of_label[device.label] : -1;
      if (device.label != 0 && tissue >= 0)
        stiffness_N_per_mm[d] = is_deformable && model_->tissues[static_cast<std::size_t>(tissue)].elastic
                                    ? deformable_stiffness_N_per_mm(device)
                                    : RenderedStiffness(device).by_proxy(
                                          tissues[static_cast<std::size_t>(tissue)].stiffness_N_per_mm);
    }
    return shown_;
  }
  std::shared_ptr<const ViewedDeformation> deformation(std::size_t device) const override {
    return solutions_ != nullptr ? solutions_->deformation(device) : nullptr;
  }
  std::shared_ptr<const Bricks<LabelId>> visible_labels() const override { return visible_labels_.of(*this); }
  ViewedHealth health() const override {
    ViewedHealth health;
    health.rate_hz = header_.rate_hz;
    return health;
  }
  ViewedState state() const override {
    const std::lock_guard lock(mutex_);
    ViewedState state;
    static_cast<Settings&>(state) = recorded_settings(shown_);
    state.method = kForceMethods[std::min<std::size_t>(shown_.method, kForceMethods.size() - 1)].method;
    state.motor_is_on = motor_was_on(*model_, shown_);
    state.model_version = shown_.model_version;
    state.law = name_of(edits_.laws.at(shown_.model_version), kTissueLaws);
    state.tissues = tissues_at(shown_.model_version);
    state.sweeps = edits_.cuts.count_at(shown_.model_version);
    state.undone_to = edits_.cuts.undone_to(shown_.model_version);
    // last version that removed material, up to the one shown
    const auto later = std::ranges::upper_bound(edits_.removed, shown_.model_version, {},
                                                &RecordedEdits::RemovedAtVersion::version);
    if (later != edits_.removed.begin()) {
      state.removed_mm3 = std::prev(later)->removed_mm3;
      state.broken_off_mm3 = std::prev(later)->broken_off_mm3;
    }
    state.nearest_mm = nearest_.at(shown_.time_s);
    state.playback = {position_.playing(), position_.speed(), blocks_.failure()};
    return state;
  }

  Result<void> play(const PlayRequest& request) override {
    const std::lock_guard lock(mutex_);
    position_.follow(request);
    blocks_.try_again();
    return {};
  }
  void emergency_stop(const ViewerIdentity& /*by*/) override {
    const std::lock_guard lock(mutex_);
    position_.stop();
  }

  std::vector<SweepRecord> sweeps(std::uint32_t version, std::uint64_t first,
                                  std::size_t max_count) const override {
    const std::lock_guard lock(mutex_);
    return edits_.cuts.sweeps_at(version, static_cast<std::size_t>(first), max_count);
  }
  std::shared_ptr<const Bricks<LabelId>> labels() const override {
    std::vector<SweepRecord> sweeps;
    {
      const std::lock_guard lock(mutex_);
      const std::uint32_t version = shown_.model_version;
      sweeps = edits_.cuts.sweeps_at(version, 0, edits_.cuts.count_at(version));
    }
    if (sweeps.empty()) return model_->labels;
    const std::lock_guard lock(cut_mutex_);
    return cut_.by(*model_, std::move(sweeps));
  }
  std::shared_ptr<const ViewedPlan> plan() const override {
    return plan_ != nullptr ? plan_->viewed() : nullptr;
  }
  Result<void> change(const PlanRequest& request) override {
    return plan_ != nullptr ? plan_->change(request) : PlaybackHost::change(request);
  }
  ViewedTraining training() const override {
    if (task_ == nullptr) return {};
    const std::lock_guard lock(mutex_);
    return task_->at(shown_.time_s);
  }
  std::shared_ptr<const ViewedDebriefing> debriefing() const override {
    if (task_ == nullptr) return nullptr;
    const std::lock_guard lock(mutex_);
    return task_->debriefing_at(shown_.time_s);
  }

 private:
  // tissue settings of that version
  std::vector<ContactProperties> tissues_at(std::uint32_t version) const {
    auto tissues = viewed_tissues(*model_);
    for (const ModelChange& change : edits_.tissues)
      if (change.version <= version && change.tissue < tissues.size())
        tissues[change.tissue] = change.contact;
    return tissues;
  }

  const RecordingHeader header_;
  const std::shared_ptr<const Model> model_;
  const ViewedScene scene_;
  const RecordedEdits edits_;
  mutable DeformedLabels visible_labels_;
  mutable std::mutex cut_mutex_;
  mutable CutLabels cut_;
  const ClearanceHistory nearest_;
  const std::unique_ptr<const PlayedTask> task_;  // null: the recording is not shown as a run of a task
  const std::shared_ptr<SharedPlan> plan_;        ///< Plan shown along with the recording; may be null

  mutable std::mutex mutex_;  // guards the members below
  mutable PlaybackPosition position_;
  mutable TickRecord shown_;
  mutable TickBlocks blocks_;
  std::unique_ptr<PlayedSolutions> solutions_;  // null: no tissue deforms
};

/// Contents of a recording that its playback looks up, collected in one pass.
struct PlaybackIndex {
  PlaybackIndex(const RecordingHead& head, const Model& model) : line(head), nearest(model), edits(model) {}

  RecordingTimeline line;
  ClearanceHistory nearest;
  RecordedEdits edits;
  TickRecord first;
  std::vector<double> begins_s;  // time of the first tick of each block
};

/// @param solutions  null: no tissue deforms at the beginning
/// @param played     null: the recording is not shown as a run of a task
Result<void> scan_recording(const RecordingSource& recording, const Progress& progress,
                            SolutionIndex* solutions, PlayedTask* played, PlaybackIndex& index) {
  const std::uint64_t ticks = recording.head().ticks;
  std::uint64_t row = 0;
  return recording.read(
      [&](const RecordingPart& part) -> Result<void> {
        progress.report("scanning the recording", static_cast<double>(row) / static_cast<double>(ticks));
        index.line.observe(part);
        index.nearest.observe(part.ticks, part.events);
        for (const RecordingEvent& event : part.events) index.edits.on_event(event);
        if (solutions) solutions->observe(part, row);
        if (played)
          if (auto valid = played->observe(part); !valid) return valid;
        for (const TickRecord& tick : part.ticks) {
          if (row == 0) index.first = tick;
          if (row++ % TickBlocks::kTicks == 0) index.begins_s.push_back(tick.time_s);
        }
        return {};
      },
      progress);
}

/// Indexes only the solutions, for a recording that switches to an elastic law later.
Result<void> scan_solutions(const RecordingSource& recording, const Progress& progress,
                            SolutionIndex& solutions) {
  std::uint64_t row = 0;
  return recording.read(
      [&](const RecordingPart& part) -> Result<void> {
        solutions.observe(part, row);
        row += part.ticks.size();
        return {};
      },
      progress);
}

}  // namespace

Result<std::unique_ptr<PlaybackHost>> open_playback(RecordingSource recording,
                                                    std::shared_ptr<const Model> model, Modality modality,
                                                    const Progress& progress,
                                                    std::optional<PlayedTaskOptions> task,
                                                    std::shared_ptr<SharedPlan> plan) {
  const RecordingHead& head = recording.head();
  if (auto same = check_recorded_model(head.header, *model); !same) return same.error();
  if (head.ticks == 0)
    return Error{ErrorKind::kBadInput, "the recording has no ticks", "", "record a longer run"};
  if (!head.is_clock_monotonic)
    return Error{ErrorKind::kBadInput, "the clock of the recording does not advance", "",
                 "palpate replay without --view compares its ticks"};

  // the distances of a burr and the deformation of tissue are computed with the proxy's surfaces
  const auto with_surfaces = [&]() -> Result<void> {
    constexpr ForceMethod kProxyAlone[] = {ForceMethod::kProxy};
    auto ready = prepared_with_cache(std::move(model), kProxyAlone, progress);
    if (!ready) return ready.error();
    model = with_recorded_cell_size(*std::move(ready), head.header);
    return {};
  };
  // a task's patches lie on the rendered surfaces
  if (model->has_burr() || is_elastic(model->tissue_law) || task)
    if (auto ready = with_surfaces(); !ready) return ready.error();

  std::unique_ptr<PlayedTask> played;
  if (task) {
    auto in_scene = resolve_task(task->task.file, *model, progress);
    if (!in_scene) return in_scene.error();
    played = std::make_unique<PlayedTask>(*task, *std::move(in_scene), *model);
  }

  PlaybackIndex index(head, *model);
  const bool deforms_first = is_elastic(model->tissue_law);
  auto solutions = std::make_unique<SolutionIndex>(*model);
  if (auto scanned =
          scan_recording(recording, progress, deforms_first ? solutions.get() : nullptr, played.get(), index);
      !scanned)
    return scanned.error();
  // the recording switches to an elastic law later: scan it again, with the surfaces that this needs
  if (!deforms_first && index.edits.laws.any(is_elastic)) {
    if (auto ready = with_surfaces(); !ready) return ready.error();
    solutions = std::make_unique<SolutionIndex>(*model);
    if (auto found = scan_solutions(recording, progress, *solutions); !found) return found.error();
  }
  if (played)
    if (auto any = played->finish(head.summary.has_value()); !any) return any.error();
  progress.report("scanning the recording", 1);

  if (auto reckoned = compute_removed_volumes(*model, progress, index.edits); !reckoned)
    return reckoned.error();

  ViewedScene scene = viewed_scene(*model, static_cast<std::size_t>(head.header.devices), modality);
  scene.recording = index.line.take();
  scene.device_name = head.header.device.empty() ? "recorded" : head.header.device;
  scene.input = "recording";
  if (played) scene.tasks = {played->task()};
  scene.rate_hz = head.header.rate_hz;
  for (const RecordingHead::AppliedMethod& used : head.methods)
    if (used.method < kForceMethods.size()) scene.methods.emplace_back(kForceMethods[used.method].name);
  for (const auto& law : kTissueLaws)
    if (check_law(*model, law.value) || index.edits.laws.any([&](TissueLaw any) { return any == law.value; }))
      scene.laws.emplace_back(law.name);
  try {
    return std::unique_ptr<PlaybackHost>(std::make_unique<Playback>(
        std::move(recording), std::move(model), std::move(scene), index.first, std::move(index.begins_s),
        std::move(index.edits), std::move(index.nearest), std::move(*solutions), std::move(played),
        std::move(plan)));
  } catch (const std::system_error&) {
    return Error{ErrorKind::kUnavailable, "cannot start a thread to read the recording", "",
                 "close other programs"};
  }
}

}  // namespace palpate
