#pragma once

#include <vector>

#include "palpate/model/changed_model.h"
#include "palpate/recording/recording.h"
#include "palpate/tissue/removed_volume.h"

namespace palpate {

/// What all burrs took up to a place of a recording, by what was told up to there.
class RemovalFollower {
 public:
  /// @param model  as the recording begins with it
  explicit RemovalFollower(const Model& model) : removed_(model) {}

  /// Rows in their order. @return whether something else is gone now
  bool hear(const RecordingEvent& event) {
    if (event.kind == RecordingEvent::Kind::kSweep) waiting_.push_back(cut_of(event.sweep));
    if (event.kind != RecordingEvent::Kind::kModel) return false;
    // of a version that no tick is known to have felt nothing is cut yet
    const bool cut = event.change.tissue == ModelChange::kCut;
    if (cut) {
      removed_.add(waiting_);
      waiting_.clear();
    }
    follow(event.change, removed_);
    return cut || event.change.is_of_stroke();
  }
  const RemovedVolume& removed() const { return removed_; }

 private:
  RemovedVolume removed_;
  std::vector<Cut> waiting_;
};

}  // namespace palpate
