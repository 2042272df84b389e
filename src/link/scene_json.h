#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "link/rights.h"
#include "palpate/base/result.h"
#include "palpate/link/viewer_server.h"

/// The texts that the server sends (docs/reference/viewer-http.md, docs/reference/viewer-messages.md).
namespace palpate::link {

/// How the voxels of the scene are sent, found once.
struct VolumeFacts {
  std::string hash;  ///< in the volumes' addresses
  double scale = 1, offset = 0;
  std::array<double, 2> range{0, 0};  ///< of the scan's finite voxels
  bool wide_labels = false;           ///< uint16
};

/// 16 lower-case hexadecimal digits.
std::string hash_text(std::uint64_t hash);

/// @param keeps_runs  ViewerHost::keeps_runs
std::string scene_json(const ViewedScene& scene, const ViewedState& state, const VolumeFacts& facts,
                       const Who& who, bool keeps_runs);

/// Whom a state is for, and what of it concerns nobody else.
struct StateReader {
  std::uint32_t number = 0;  ///< ViewerIdentity::number; 0: none of them
  Who who{Role::kTeacher, {}};
  std::uint32_t holder = 0;  ///< the number of the viewer that moves the tip, 0 where none does
  int viewers = 0;           ///< that have said hello
  bool names = false;        ///< learners are shown what a quiz hides
  bool veiled = false;       ///< this one is not
};
std::string state_json(const ViewedState& state, const StateReader& reader);

/// To 0.01 mm.
std::string navigation_json(const ViewedNavigation& navigation);
/// @param has_tasks  of the scene; @param keeps_runs  ViewerHost::keeps_runs
std::string welcome_json(const Who& who, bool has_tasks, bool keeps_runs);
/// @param first  number of the first of them, from 0
std::string sweeps_json(std::uint64_t first, std::span<const SweepRecord> sweeps);
std::string done_json(std::int64_t id);
std::string asked_json(std::int64_t id);
std::string refused_json(std::int64_t id, const Error& error);

}  // namespace palpate::link
