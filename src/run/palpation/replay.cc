#include <algorithm>
#include <bit>
#include <cstdio>
#include <deque>
#include <utility>
#include <vector>

#include "palpate/base/printable.h"
#include "palpate/loading/loading.h"
#include "palpate/model/changed_model.h"
#include "palpate/palpation/logged_loop.h"
#include "palpate/palpation/palpation.h"
#include "palpate/palpation/plain_vectors.h"
#include "palpate/palpation/recorded_model.h"
#include "palpate/servo/haptic_settings.h"
#include "palpate/tissue/soft_tissue_solver.h"

namespace palpate {
namespace {

bool same_bits(double a, double b) {
  return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b);
}
template <std::size_t n>
bool same_bits(const std::array<double, n>& a, const std::array<double, n>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), [](double x, double y) { return same_bits(x, y); });
}

std::string text_of(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.17g", value);
  return text;
}
template <std::size_t n>
std::string text_of(const std::array<double, n>& values) {
  std::string text;
  for (const double value : values) text += (text.empty() ? "" : " ") + text_of(value);
  return text;
}

// difference between a recorded tick and its replay; outputs first, because they are more informative than a
// hash; empty if they are equal
std::string first_difference(const TickRecord& recorded, const TickRecord& again) {
  for (int d = 0; d < recorded.devices; ++d) {
    const std::string difference = first_different_output(recorded.device[d], again.device[d]);
    if (!difference.empty()) return "device " + std::to_string(d) + " " + difference;
  }
  if (!same_bits(recorded.rotation_applied_wxyz, again.rotation_applied_wxyz))
    return "rotation_applied_wxyz: recorded " + text_of(recorded.rotation_applied_wxyz) + ", now " +
           text_of(again.rotation_applied_wxyz);
  if (recorded.state_hash == again.state_hash) return "";
  char text[80];
  std::snprintf(text, sizeof text, "state hash: recorded %016llx, now %016llx",
                static_cast<unsigned long long>(recorded.state_hash),
                static_cast<unsigned long long>(again.state_hash));
  return text;
}

template <class Frame>
Vector<Frame> vector(const std::array<double, 3>& v) {
  return {v[0], v[1], v[2]};
}

DeviceState state_of(const DeviceTick& in) {
  DeviceState state;
  state.tip = Point<World>(in.tip_world_mm[0], in.tip_world_mm[1], in.tip_world_mm[2]);
  state.R_WorldTool = quaternion(in.orientation_wxyz);
  state.velocity_mm_s = vector<World>(in.velocity_world_mm_s);
  state.angular_velocity_rad_s = vector<World>(in.angular_velocity_world_rad_s);
  state.gripper_rad = in.gripper_rad;
  state.buttons = in.buttons;
  state.status = in.status;
  state.age_s = in.age_s;
  return state;
}

Parameters parameters_of(const TickRecord& recorded) {
  Parameters parameters;
  static_cast<Settings&>(parameters) = recorded_settings(recorded);
  parameters.emergency_stop = (recorded.switches & kSwitchEmergencyStop) != 0;
  for (int d = 0; d < recorded.devices; ++d) {
    const DeviceTick& in = recorded.device[d];
    parameters.device[d] = {
        in.force_gain,
        in.scale,
        {in.peak_force_N, in.continuous_force_N, in.peak_torque_Nmm, in.peak_gripper_N, in.slew_N_per_s},
        in.max_stiffness_N_per_mm,
        in.position_step_mm,
        in.max_damping_N_s_per_mm,
        in.delay_s};
  }
  return parameters;
}

// methods used in the recording
Result<std::vector<ForceMethod>> methods_of(const RecordingHead& head) {
  std::vector<ForceMethod> methods;
  for (const RecordingHead::AppliedMethod& used : head.methods) {
    if (used.method >= kForceMethods.size())
      return Error{
          ErrorKind::kBadInput,
          "tick " + std::to_string(used.tick) + " used a force method that this version does not have", "",
          "replay it with the version that made it"};
    methods.push_back(static_cast<ForceMethod>(used.method));
  }
  return methods;
}

/// Replays tick after tick and stops at the first difference.
class Replayer {
 public:
  Replayer(std::shared_ptr<const Model> model, const Progress& progress)
      : model_{model, model}, progress_(progress) {}

  Result<void> take(const RecordingPart& part) {
    for (const RecordingEvent& event : part.events) {
      if (event.kind == RecordingEvent::Kind::kSweep) cuts_.push_back(cut_of(event.sweep));
      if (event.kind == RecordingEvent::Kind::kTissueSolution)
        solutions_.push_back({event.number, event.input_tick, event.frame_hash});
      if (event.kind != RecordingEvent::Kind::kModel) continue;
      changes_.push_back({event.change, {}});
      if (event.change.tissue == ModelChange::kCut) changes_.back().cuts = std::exchange(cuts_, {});
    }
    if (changes_.size() > kMaxPendingChanges || cuts_.size() > kMaxPendingChanges ||
        solutions_.size() > kMaxPendingChanges)
      return Error{ErrorKind::kBadInput, "the recording has more changes of the model than a run can have",
                   "", ""};
    for (const TickRecord& recorded : part.ticks) {
      if (!result_.difference.empty()) return {};
      if (auto there = advance_to(recorded); !there) return there;
      if (auto solved = solve_until(recorded); !solved) return solved;
      run_again(recorded);
    }
    return {};
  }
  bool differs() const { return !result_.difference.empty(); }
  ReplayResult& result() { return result_; }

 private:
  // normally a few between two ticks; bounds the memory that a hostile file takes
  static constexpr std::size_t kMaxPendingChanges = 100'000;
  // a solution takes a few frames on a busy machine, at up to 10 kHz
  static constexpr std::size_t kMaxInputs = 20'000;
  Result<void> advance_to(const TickRecord& recorded);
  Result<void> solve_until(const TickRecord& recorded);
  void run_again(const TickRecord& recorded);

  ModelVersions model_;
  const Progress& progress_;
  struct Change {
    ModelChange change;
    std::vector<Cut> cuts;
  };
  std::deque<Change> changes_;  // not applied to a tick yet
  std::vector<Cut> cuts_;       // cuts whose version is still to come
  struct Solution {
    std::uint32_t number;
    std::uint64_t input_tick, hash;
  };
  std::deque<Solution> solutions_;  // not applied to a tick yet
  // ticks from which a solution may still be computed, each with its model
  struct Input {
    TickRecord tick;
    std::shared_ptr<const Model> model;
  };
  std::deque<Input> inputs_;
  SoftTissueSolver solver_;
  SessionState state_;
  ReplayResult result_;
};

// advances the model to the version of a tick, by the recorded changes
Result<void> Replayer::advance_to(const TickRecord& recorded) {
  while (model_.current->version < recorded.model_version && !changes_.empty()) {
    const ModelChange& change = changes_.front().change;
    // a session has surfaces from its start, whether the proxy is used or not
    if (change.is_of_law() && has_other_surfaces(*model_.current, law_of(change)) &&
        !model_.current->has(ForceMethod::kProxy)) {
      constexpr ForceMethod kProxyAlone[] = {ForceMethod::kProxy};
      auto ready = prepared_with_cache(model_.current, kProxyAlone, progress_);
      if (!ready) return ready.error();
      model_.current = *std::move(ready);
    }
    auto changed = next_version(model_, change, changes_.front().cuts, progress_, *cached_preparation());
    if (!changed) return changed.error();
    model_ = *std::move(changed);
    changes_.pop_front();
  }
  if (recorded.model_version == model_.current->version) return {};
  return Error{ErrorKind::kBadInput,
               "tick " + std::to_string(recorded.tick) + " used version " +
                   std::to_string(recorded.model_version) + " of the model, which is missing from the file",
               "", "only runs whose changes of the model were recorded can be replayed"};
}

// Solves the tissue's deformation of a tick again, from the ticks that it was originally solved from.
Result<void> Replayer::solve_until(const TickRecord& recorded) {
  const auto missing = [&](const std::string& how) {
    return Error{ErrorKind::kBadInput,
                 "tick " + std::to_string(recorded.tick) + " used solution " +
                     std::to_string(recorded.solver_frame) + " of the tissue, " + how,
                 "", "only runs whose solutions were recorded can be replayed"};
  };
  while (solver_.frame().number < recorded.solver_frame) {
    if (solutions_.empty()) return missing("which is missing from the file");
    const Solution solution = solutions_.front();
    solutions_.pop_front();
    if (solution.hash == RecordingEvent::kUnsolved && solution.number == solver_.frame().number + 1) {
      solver_.restart(solution.number);
      continue;
    }
    while (!inputs_.empty() && inputs_.front().tick.tick < solution.input_tick) inputs_.pop_front();
    if (inputs_.empty() || inputs_.front().tick.tick != solution.input_tick ||
        solution.number != solver_.frame().number + 1)
      return missing("which was solved for a tick that is missing");
    const Input& input = inputs_.front();
    if (solver_.solve(*input.model, input.tick).hash() == solution.hash) continue;
    result_.first_difference = recorded.tick;
    result_.difference = "the tissue's solution " + std::to_string(solution.number) + " of tick " +
                         std::to_string(solution.input_tick) + " differs";
    return {};
  }
  if (recorded.solver_frame != solver_.frame().number) return missing("which is not the newest");
  return {};
}

void Replayer::run_again(const TickRecord& recorded) {
  if (differs()) return;
  // every input of the tick as recorded
  Parameters parameters = parameters_of(recorded);
  parameters.compliance = solver_.frame();
  std::array<DeviceState, kMaxDevices> devices;
  for (int d = 0; d < recorded.devices; ++d) devices[d] = state_of(recorded.device[d]);

  // ticks that the recorder lost cannot be replayed
  if (recorded.tick != state_.tick) {
    result_.first_difference = state_.tick;
    result_.difference = recorded.tick < state_.tick
                             ? "the recorded ticks are out of order"
                             : "the recorder lost ticks " + std::to_string(state_.tick) + " to " +
                                   std::to_string(recorded.tick - 1);
    return;
  }

  std::array<Wrench, kMaxDevices> wrenches;
  TickRecord again;
  const std::size_t count = static_cast<std::size_t>(recorded.devices);
  tick(*model_.current, parameters, {devices.data(), count}, recorded.dt_s, state_, {wrenches.data(), count},
       again);
  result_.ticks += 1;
  result_.run_hash = mix_run_hash(result_.run_hash, again.state_hash);
  result_.difference = first_difference(recorded, again);
  if (is_elastic(model_.current->tissue_law)) {
    inputs_.push_back({again, model_.current});
    if (inputs_.size() > kMaxInputs) inputs_.pop_front();
  }
  if (!result_.difference.empty()) result_.first_difference = recorded.tick;
}

}  // namespace

Result<void> check_recorded_model(const RecordingHeader& recording, const Model& model) {
  if (recording.model_hash == model.content_hash) return {};
  return Error{ErrorKind::kBadInput, "the recording was made with a different scene or different volumes", "",
               "give the scene file or data set that it was made with, unchanged; the same scene may also "
               "give a different model with another version: this one was recorded by palpate " +
                   recording.palpate_version + ", commit " + recording.commit};
}

std::shared_ptr<const Model> with_recorded_cell_size(std::shared_ptr<const Model> model,
                                                     const RecordingHeader& recording) {
  if (model->tissue_cell_factor == recording.tissue_cell_factor) return model;
  auto coarser = std::make_shared<Model>(*model);
  coarser->tissue_cell_factor = recording.tissue_cell_factor;
  return coarser;
}

Result<ReplayResult> replay(const RecordingSource& recording, std::shared_ptr<const Model> prepared,
                            const Progress& progress) {
  const RecordingHead& head = recording.head();
  if (auto same = check_recorded_model(head.header, *prepared); !same) return same.error();

  const auto methods = methods_of(head);
  if (!methods) return methods.error();
  // a session that does not use the proxy has surfaces nevertheless, and solves tissue between them
  if (is_elastic(prepared->tissue_law)) {
    constexpr ForceMethod kProxyAlone[] = {ForceMethod::kProxy};
    auto with_surfaces = prepared_with_cache(prepared, kProxyAlone, progress);
    if (!with_surfaces && with_surfaces.error().kind == ErrorKind::kInterrupted) return with_surfaces.error();
    if (with_surfaces) prepared = *std::move(with_surfaces);
    prepared = with_recorded_cell_size(std::move(prepared), head.header);
  }
  const auto ready = prepared_with_cache(std::move(prepared), *methods, progress);
  if (!ready) return ready.error();

  Replayer replayer(*ready, progress);
  ReplayResult& result = replayer.result();
  // reading stops at the first difference
  const Error enough{ErrorKind::kInterrupted, "", "", ""};
  const auto read = recording.read(
      [&](const RecordingPart& part) -> Result<void> {
        progress.report("replaying", static_cast<double>(result.ticks) / static_cast<double>(head.ticks));
        if (auto used = replayer.take(part); !used) return used;
        return replayer.differs() ? Result<void>(enough) : Result<void>();
      },
      progress);
  if (replayer.differs()) {
    const std::string other =
        head.header.haptic_settings.empty() ? "" : first_haptic_difference(head.header.haptic_settings);
    if (!other.empty())
      result.difference += "; it was recorded with different settings: " + printable_name(other);
    return result;
  }
  if (!read) return read.error();
  progress.report("replaying", 1);
  // a complete recording also contains the hash of the run
  result.identical =
      !head.summary || (head.summary->run_hash == result.run_hash && head.summary->dropped == 0);
  if (!result.identical) {
    result.first_difference = result.ticks;
    result.difference = "ticks of the recording are missing";
  }
  return result;
}

}  // namespace palpate
