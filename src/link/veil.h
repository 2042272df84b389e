#pragma once

#include <memory>
#include <string>
#include <vector>

#include "link/veiled_contact.h"
#include "link/veiled_steps.h"
#include "palpate/device/telemetry.h"
#include "palpate/link/viewer_server.h"

namespace palpate::link {

/// The scene that learners are served while a quiz is at hand. It is made once, before anything is sent: the
/// voxels of what is to be found have become what surrounds them (veiled_labels), nothing has a name, and the
/// hidden structures are not in it. Everything that is sent to a learner is computed from this scene, from
/// poses and from the total force on each device. A record of a tick, a state and a run are built from a list
/// of what may pass: a new field of theirs is veiled until it is put on that list here.
class Veil {
 public:
  /// @param scene  what its quizzes have to find is hidden, of all of them together
  explicit Veil(const ViewedScene& scene);
  Veil(const Veil&) = delete;
  Veil& operator=(const Veil&) = delete;

  /// As learners see it. Its hash depends on nothing hidden.
  const ViewedScene& scene() const { return scene_; }
  bool is_hidden(LabelId label) const { return hidden_[label]; }
  bool has_wide_labels() const { return has_wide_labels_; }  ///< needs_wide_labels() of the scene's

  TickRecord of(const TickRecord& tick) const;
  ViewedState of(const ViewedState& state) const;
  /// @param steps  of the veiled scene
  /// @param tick   a veiled one: forces on structures are the total force on what it says is touched
  ViewedTraining of(const ViewedTraining& training, const VeiledSteps& steps, const TickRecord& tick) const;
  ViewedHealth of(const ViewedHealth& health) const;

 private:
  void hide_structures(const ViewedScene& whole);
  void hide_tissues(const ViewedScene& whole);
  void hide_in_tasks();
  void hide_no_go();
  void hide_recording();
  std::uint64_t content_hash() const;
  const ViewedTask* task_of(const std::string& name) const;

  std::vector<bool> hidden_;       ///< by label
  std::vector<int> tissue_place_;  ///< by tissue of the whole scene: its place here, -1: left out
  ViewedScene scene_;
  bool has_wide_labels_ = false;
  bool reports_no_go_ = false;  ///< no-go regions are planes and balls alone, independent of voxels
  bool is_cut_ = false;         ///< a tool takes voxels away
  std::unique_ptr<const VeiledContact> contact_;
};

/// The veiled labels of a session from which burrs take voxels. For one thread.
class VeiledCuts {
 public:
  /// @param whole, veiled  the scene's labels, as they are and veiled
  VeiledCuts(std::shared_ptr<const Bricks<LabelId>> whole, std::shared_ptr<const Bricks<LabelId>> veiled);

  /// The veiled labels without what is missing from `cut`, a later version of the whole labels.
  std::shared_ptr<const Bricks<LabelId>> of(const std::shared_ptr<const Bricks<LabelId>>& cut);

 private:
  const std::shared_ptr<const Bricks<LabelId>> whole_, veiled_;
  std::shared_ptr<const Bricks<LabelId>> cut_, veiled_cut_;  ///< the last version and what it was veiled as
};

/// Whether a scene has a quiz, of which learners are not to see everything.
bool has_quiz(const ViewedScene& scene);

}  // namespace palpate::link
