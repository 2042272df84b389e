#pragma once

#include <memory>
#include <string>
#include <vector>

#include "palpate/device/telemetry.h"
#include "palpate/server/viewer_host.h"
#include "server/redacted_contact.h"
#include "server/redacted_steps.h"

namespace palpate::server {

/// Redacted scene that learners receive during a quiz. It is computed once, before anything is sent: the
/// voxels of the structures to be found are replaced by their surroundings (redacted_labels), names are
/// removed, and the hidden structures are dropped. Everything sent to a learner is computed from this scene,
/// from poses and from the total force on each device. Ticks, states and runs are built from an allow-list: a
/// new member stays hidden until it is added here.
class Redaction {
 public:
  /// @param scene  the structures to be found in any of its quizzes are hidden
  explicit Redaction(const ViewedScene& scene);
  Redaction(const Redaction&) = delete;
  Redaction& operator=(const Redaction&) = delete;

  /// Scene as learners receive it. Its hash does not depend on anything hidden.
  const ViewedScene& scene() const { return scene_; }
  bool is_hidden(LabelId label) const { return hidden_[label]; }
  bool has_wide_labels() const { return has_wide_labels_; }  ///< needs_wide_labels() of scene()

  TickRecord of(const TickRecord& tick) const;
  ViewedState of(const ViewedState& state) const;
  /// @param steps  progress in the redacted scene
  /// @param tick   a redacted tick: the total force is attributed to the structure in contact in it
  ViewedTraining of(const ViewedTraining& training, const RedactedSteps& steps, const TickRecord& tick) const;
  ViewedHealth of(const ViewedHealth& health) const;

 private:
  void hide_structures(const ViewedScene& whole);
  void hide_tissues(const ViewedScene& whole);
  void hide_in_tasks();
  void hide_no_go();
  void hide_recording();
  std::uint64_t content_hash() const;
  const ViewedTask* task_of(const std::string& name) const;

  std::vector<bool> hidden_;       ///< Indexed by label
  std::vector<int> tissue_index_;  ///< Index here of each tissue of the whole scene; -1: dropped
  ViewedScene scene_;
  bool has_wide_labels_ = false;
  /// Whether all no-go regions are planes and balls, which do not depend on voxels
  bool reports_no_go_ = false;
  bool is_cut_ = false;  ///< Whether a tool removes voxels
  std::unique_ptr<const RedactedContact> contact_;
};

/// Redacted labels of a session in which burrs remove voxels. Not thread-safe.
class RedactedCuts {
 public:
  /// @param whole, redacted  the scene's labels, original and redacted
  RedactedCuts(std::shared_ptr<const Bricks<LabelId>> whole, std::shared_ptr<const Bricks<LabelId>> redacted);

  /// The redacted labels minus the voxels missing from `cut`, a later version of the original labels.
  std::shared_ptr<const Bricks<LabelId>> of(const std::shared_ptr<const Bricks<LabelId>>& cut);

 private:
  const std::shared_ptr<const Bricks<LabelId>> whole_, redacted_;
  std::shared_ptr<const Bricks<LabelId>> cut_, redacted_cut_;  ///< Last version, original and redacted
};

/// Whether a scene has a quiz, so that learners need a redaction.
bool has_quiz(const ViewedScene& scene);

}  // namespace palpate::server
