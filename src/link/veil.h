#pragma once

#include <vector>

#include "palpate/device/telemetry.h"
#include "palpate/link/viewer_server.h"

namespace palpate::link {

/// A scene with quizzes as learners see it while one is at hand: what is to be found is voxels of the
/// structure around it, everywhere, and nothing has its name. What is sent to a learner goes through it, so
/// that there is nothing to be read in messages that the page does not show.
class Veil {
 public:
  /// @param scene  outlives the veil; what its quizzes have to find is hidden, of all of them together
  explicit Veil(const ViewedScene& scene);

  /// As learners see it, of another hash.
  const ViewedScene& scene() const { return scene_; }
  /// As what a label is shown: another one of what is hidden.
  LabelId shown(LabelId label) const { return label < shown_.size() ? shown_[label] : label; }

  TickRecord of(TickRecord tick) const;
  ViewedState of(ViewedState state) const;

 private:
  bool is_hidden(LabelId label) const { return shown(label) != label; }
  void hide_in_tasks();
  void take_names();

  std::vector<LabelId> shown_;  ///< by label
  std::vector<int> tissue_as_;  ///< by tissue: as which its figures are told
  ViewedScene scene_;
};

/// Whether a scene has a quiz, of which learners are not to see everything.
bool has_quiz(const ViewedScene& scene);

}  // namespace palpate::link
