#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"
#include "palpate/contact/model.h"
#include "palpate/device/model_change.h"
#include "palpate/recording/recording.h"
#include "palpate/tissue/tissue_laws.h"
#include "session/cut_list.h"

namespace palpate {

/// Changes of the model during the recording.
struct RecordedEdits {
  explicit RecordedEdits(const Model& model) : laws(model.tissue_law, model.tissue_cell_factor) {}

  std::vector<ModelChange> tissues;
  LawHistory laws;
  CutList cuts;
  // removed volume per structure in mm3, for each version that removed or restored something; ascending
  // versions
  struct RemovedAtVersion {
    std::uint32_t version = 0;
    std::map<LabelId, double> removed_mm3;
    double broken_off_mm3 = 0;
  };
  std::vector<RemovedAtVersion> removed;
  std::uint32_t last_version = 0;

  void on_event(const RecordingEvent& event);
};

/// Computes the removed volume of every version in one pass, so that any position can be looked up.
/// Errors: kInterrupted.
Result<void> compute_removed_volumes(const Model& model, const Progress& progress, RecordedEdits& edits);

}  // namespace palpate
