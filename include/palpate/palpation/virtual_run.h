#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/device/model_change.h"
#include "palpate/palpation/run_setup.h"
#include "palpate/palpation/scope_hand.h"
#include "palpate/palpation/scripted_hand.h"
#include "palpate/tissue/soft_tissue_solver.h"

namespace palpate {

/// Scripted hand with a simulated device, and a second hand with a scope if the script uses one, on the
/// virtual clock: sense, tick, perceive, act.
class VirtualRun {
 public:
  /// @param progress  allows interruption of operations that take seconds between two ticks; optional
  VirtualRun(std::shared_ptr<const Model> model, const RunSetup& setup, ScriptedHand hand,
             Progress progress = {});

  /// Reads the devices and ticks.
  const TickRecord& tick();
  /// Passes the last tick to the hand, which acts; false: the script is done and nothing moved.
  bool act();

  // ---- state of the last tick
  const DeviceState& sensed() const { return sensed_[0]; }
  const Wrench& sent() const { return sent_[0]; }
  /// Intended position of the hand after the tick.
  const Point<World>& intended() const { return intended_; }
  double time_s() const { return state_.time_s; }
  /// Current model version.
  const Model& model() const { return *model_; }
  const ScriptedHand& hand() const { return hand_; }
  /// Commands of the script since the last call, each with the first tick to which it applies.
  std::vector<RecordingEvent> receive_events() { return std::exchange(events_, {}); }

 private:
  void cut();
  void remove_swept_volume();
  void change_stroke(StrokeAction action);
  void change_law(TissueLaw law);

  std::shared_ptr<const Model> model_, last_model_;  // model of the next tick; model of the last tick
  const double dt_s_;
  ScriptedHand hand_;
  SimulatedDevice device_;
  WorkspaceMapping mapping_;
  Parameters parameters_;
  SessionState state_;
  std::optional<ScopeHand> scope_;
  std::array<DeviceState, 2> sensed_;  // the scope's is the last
  std::array<Wrench, 2> sent_;
  Point<World> intended_;
  TickRecord record_;
  double cut_s_ = 0;                                           // time of the last cut
  std::optional<StrokeAction> stroke_;                         // pending stroke request of the script
  std::optional<std::uint32_t> stroke_version_, law_version_;  // as in HandCommands
  std::vector<RecordingEvent> events_;
  std::uint32_t reported_number_ = 0;
  VirtualClockSoftTissueSolver solver_;
  const Progress progress_;
};

}  // namespace palpate
