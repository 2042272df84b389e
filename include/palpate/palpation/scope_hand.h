#pragma once

#include <optional>

#include "palpate/contact/model.h"
#include "palpate/device/device.h"
#include "palpate/device/telemetry.h"
#include "palpate/scene/script.h"

namespace palpate {

/// Hand that holds the scope of a scripted run, in the second device: the camera translates and rotates at
/// constant speed to the pose that a script's step requests, without collision avoidance, and follows its
/// target. It has no force feedback and no tremor.
class ScopeHand {
 public:
  /// Initially rests in front of the patient, above the start of the first hand.
  /// @param model  outlives the hand
  ScopeHand(const Model& model, const Point<World>& start);

  void aim(const ScopeStep& step) { step_ = step; }
  /// Whether the camera is within half a millimetre and two degrees of the requested pose.
  bool is_there() const { return is_there_; }
  /// @param tick  last tick, with the pose of the patient and of the first device
  void advance(const TickRecord& tick, double dt_s);
  const DeviceState& state() const { return state_; }

 private:
  const Model* model_;
  std::optional<ScopeStep> step_;
  Point<World> eye_;
  DeviceState state_;
  bool is_there_ = false;
};

}  // namespace palpate
