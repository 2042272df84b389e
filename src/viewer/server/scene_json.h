#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "palpate/base/result.h"
#include "palpate/device/sweep_record.h"
#include "palpate/server/viewer_host.h"
#include "server/permissions.h"

/// JSON messages of the server (docs/reference/viewer-http.md, docs/reference/viewer-messages.md).
namespace palpate::server {

/// Encoding of the scene's voxels, determined once.
struct VolumeFacts {
  std::string hash;  ///< Hash in the volumes' URLs
  double scale = 1, offset = 0;
  std::array<double, 2> range{0, 0};  ///< Range of the scan's finite voxels
  bool wide_labels = false;           ///< Whether labels are uint16
};

/// Sixteen lower-case hexadecimal digits.
std::string hash_text(std::uint64_t hash);

/// @param stores_runs  Site::stores_runs
std::string scene_json(const ViewedScene& scene, const ViewedState& state, const VolumeFacts& facts,
                       const AuthenticatedViewer& who, bool stores_runs);

/// Learner with a token, as shown to a teacher.
struct ListedLearner {
  std::string learner;       ///< Pseudonym
  bool is_here = false;      ///< Whether a page of this learner is connected
  bool has_pointer = false;  ///< Whether that page moves the tip
};

/// Receiver of a state message, with the values that depend on it.
struct StateRecipient {
  std::uint32_t number = 0;  ///< ViewerIdentity::number; 0: none
  AuthenticatedViewer who{Role::kTeacher, {}};
  std::uint32_t pointer_owner = 0;           ///< Number of the viewer that moves the tip; 0: none
  int viewers = 0;                           ///< Number of viewers that have said hello
  bool shows_hidden_names = false;           ///< Whether learners get the names hidden by a quiz
  bool redacted = false;                     ///< Whether this recipient gets the redacted state
  std::vector<ListedLearner> learners = {};  ///< Sent to a teacher only
};
std::string state_json(const ViewedState& state, const StateRecipient& recipient);

/// Rounded to 0.01 mm.
std::string navigation_json(const ViewedNavigation& navigation);
/// @param has_tasks    whether the scene has tasks
/// @param stores_runs  Site::stores_runs
std::string welcome_json(const AuthenticatedViewer& who, bool has_tasks, bool stores_runs);
/// @param first  index of the first of them, from 0
std::string sweeps_json(std::uint64_t first, std::span<const SweepRecord> sweeps);
std::string done_json(std::int64_t id);
std::string consent_request_json(std::int64_t id);
std::string refused_json(std::int64_t id, const Error& error);

}  // namespace palpate::server
