#pragma once

#include <optional>

#include "palpate/device/device.h"
#include "palpate/device/telemetry.h"
#include "palpate/haptics/haptics.h"
#include "palpate/scene/scene.h"

namespace palpate {

/// The hand that holds the scope of a scripted run, in the second device: its camera goes and turns evenly to
/// where a script's step wants it, straight through whatever is there, and goes on with what it looks at. It
/// feels nothing and does not tremble.
class ScopeHand {
 public:
  /// It rests before the patient, above where the first hand begins. @param model  outlives it
  ScopeHand(const Model& model, const Point<World>& start);

  void look(const ScopeStep& step) { step_ = step; }
  /// The camera is within half a millimetre of where the step wants it, and within two degrees.
  bool is_there() const { return is_there_; }
  /// @param felt  the last tick, in which the patient and the first device are
  void advance(const TickRecord& felt, double dt_s);
  const DeviceState& state() const { return state_; }

 private:
  const Model* model_;
  std::optional<ScopeStep> step_;
  Point<World> eye_;
  DeviceState state_;
  bool is_there_ = false;
};

}  // namespace palpate
