#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "palpate/volume/volume.h"

/// Plan data published to viewers during a rehearsal, and edits of it. The plan's title is never published,
/// because it may contain a patient's name.
namespace palpate {

struct ViewedPlan {
  struct Trajectory {
    std::string name;
    std::array<double, 3> entry_mm{}, target_mm{};  ///< Patient frame
    std::optional<double> entry_within_mm, target_within_mm, angle_within_deg, depth_within_mm;
  };
  /// Required clearance between the tool and a structure.
  struct KeepAway {
    LabelId label = 0;
    double mm = 0;
  };
  std::vector<Trajectory> trajectories;
  std::vector<KeepAway> keep_away;
  std::uint32_t version = 1;  ///< Incremented with each change
  bool saved = true;          ///< Whether the plan equals the plan's file
  bool can_change = false;    ///< Whether viewers with control may edit it
};

/// Edit of a plan: adds, changes or removes a trajectory, restores an earlier version of the whole plan, or
/// saves it.
struct PlanRequest {
  std::uint32_t version = 0;  ///< Version that the edit refers to: the one that the viewer has seen
  std::optional<std::size_t> trajectory;  ///< Index of the trajectory; one beyond the last: a new one
  std::optional<std::string> name;
  std::optional<std::array<double, 3>> entry_mm, target_mm;
  bool remove = false;
  // requests without a trajectory
  std::optional<std::uint32_t> restore_version;  ///< Undo: version of the plan to be restored
  bool save = false;
};

}  // namespace palpate
