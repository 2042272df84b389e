#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "palpate/volume/volume.h"

/// What viewers see of a plan that is rehearsed, and how they change it. Its title, which may name a patient,
/// is told to nobody.
namespace palpate {

struct ViewedPlan {
  struct Trajectory {
    std::string name;
    std::array<double, 3> entry_mm{}, target_mm{};  ///< patient
    std::optional<double> entry_within_mm, target_within_mm, angle_within_deg, depth_within_mm;
  };
  /// The tool is to keep away from a structure so far.
  struct KeepAway {
    LabelId label = 0;
    double mm = 0;
  };
  std::vector<Trajectory> trajectories;
  std::vector<KeepAway> keep_away;
  std::uint32_t version = 1;  ///< one more with each change
  bool saved = true;          ///< the plan's file says the same
  bool can_change = false;    ///< viewers with control may
};

/// A trajectory is to be added, to be another one or to go; or all of the plan is to be as it was, or saved.
struct PlanRequest {
  std::uint32_t version = 0;              ///< of the plan that is changed: as whoever asks has seen it
  std::optional<std::size_t> trajectory;  ///< its place; one beyond the last: a new one
  std::optional<std::string> name;
  std::optional<std::array<double, 3>> entry_mm, target_mm;
  bool remove = false;
  // without a trajectory
  std::optional<std::uint32_t> back_to;  ///< all of it as it was in that version: what was done is undone
  bool save = false;
};

}  // namespace palpate
