#pragma once

#include <vector>

#include "palpate/device/model_change.h"
#include "palpate/model/changed_model.h"
#include "palpate/recording/recording.h"
#include "palpate/tissue/removed_volume.h"

namespace palpate {

/// Reconstructs the tissue removed by all burrs up to a time of a recording from its events.
class RemovalFollower {
 public:
  /// @param model  model at the start of the recording
  explicit RemovalFollower(const Model& model) : removed_(model) {}

  /// Processes events in their order. Returns whether the removed tissue changed.
  bool on_event(const RecordingEvent& event) {
    if (event.kind == RecordingEvent::Kind::kSweep) waiting_.push_back(cut_of(event.sweep));
    if (event.kind != RecordingEvent::Kind::kModel) return false;
    // sweeps are applied with the model version that includes them; ticks before it used the uncut tissue
    const bool cut = event.change.tissue == ModelChange::kCut;
    if (cut) {
      removed_.add(waiting_);
      waiting_.clear();
    }
    apply_stroke_change(event.change, removed_);
    return cut || event.change.is_of_stroke();
  }
  const RemovedVolume& removed() const { return removed_; }

 private:
  RemovedVolume removed_;
  std::vector<Cut> waiting_;
};

}  // namespace palpate
