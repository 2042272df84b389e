#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/palpation/run_setup.h"
#include "palpate/palpation/scope_hand.h"
#include "palpate/palpation/scripted_hand.h"
#include "palpate/tissue/yield_solver.h"

namespace palpate {

/// A scripted hand with a simulated device, and a scope in another hand where the script has one, on the
/// virtual clock: sense, tick, feel, act.
class VirtualRun {
 public:
  /// @param progress  of what takes seconds between two ticks; without it that is not interrupted
  VirtualRun(std::shared_ptr<const Model> model, const RunSetup& setup, ScriptedHand hand,
             Progress progress = {});

  /// Senses where the device is and ticks.
  const TickRecord& tick();
  /// The hand feels the last tick and acts; false: its script is done and nothing moved.
  bool act();

  // ---- of the last tick
  const DeviceState& sensed() const { return sensed_[0]; }
  const Wrench& sent() const { return sent_[0]; }
  /// Where the hand wanted to be after it.
  const Point<World>& intended() const { return intended_; }
  double time_s() const { return state_.time_s; }
  /// As it is felt now.
  const Model& model() const { return *model_; }
  const ScriptedHand& hand() const { return hand_; }
  /// What the script asked for since it was asked last, with the tick that feels it first.
  std::vector<RecordingEvent> take_told() { return std::exchange(told_, {}); }

 private:
  void cut();
  void cut_what_was_swept();
  void change_stroke(StrokeAction action);
  void change_law(TissueLaw law);

  std::shared_ptr<const Model> model_, felt_;  // that the next tick feels; that the last one felt
  const double dt_s_;
  ScriptedHand hand_;
  SimulatedDevice device_;
  WorkspaceMapping mapping_;
  Parameters parameters_;
  SessionState state_;
  std::optional<ScopeHand> scope_;
  std::array<DeviceState, 2> sensed_;  // the scope's last
  std::array<Wrench, 2> sent_;
  Point<World> intended_;
  TickRecord record_;
  double cut_s_ = 0;                                         // when the model was cut last
  std::optional<StrokeAction> stroke_;                       // that the script wants
  std::optional<std::uint32_t> stroke_led_to_, law_led_to_;  // HandCommands
  std::vector<RecordingEvent> told_;
  std::uint32_t told_number_ = 0;
  YieldsOnVirtualClock yields_;
  const Progress progress_;
};

}  // namespace palpate
