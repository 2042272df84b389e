#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/base/result.h"

/// Permissions: one table, by which the server grants and refuses requests, and which
/// docs/reference/viewer-protocol.md shows.
namespace palpate::server {

enum class Role : std::uint8_t { kView, kControl, kLearner, kTeacher };
inline constexpr std::array kRoles{Role::kView, Role::kControl, Role::kLearner, Role::kTeacher};
std::string_view name_of(Role role);

/// Authenticated viewer.
struct AuthenticatedViewer {
  Role role = Role::kView;
  std::string learner;  ///< Pseudonym of the token, for a learner
};

/// Permission; permission_infos() describes the requests that it covers.
enum class Permission : std::uint8_t {
  kObserve,        ///< See the scan, structures, poses, state, plan and runs in progress
  kStop,           ///< Stop the force
  kSeeHidden,      ///< See names and the structures to find during a quiz
  kOperateTool,    ///< Move the tip, begin and end runs, rearm, pause, turn the object, cut
  kChangeContact,  ///< Change contact settings: method, law, force limit, tissues
  kPlan,           ///< Change and save the plan
  kPlay,           ///< Control the playback of a recording
  kLesson,         ///< Choose the learner and the task of the next runs, show names, end the session
  kOwnRuns,        ///< See the learning curves of the learner's own runs
  kAllRuns,        ///< See the learning curves of all learners
};
/// Permission of a role.
enum class Grant : std::uint8_t {
  kNo,
  kYes,
  kWithoutTasks,  ///< Granted only in sessions without tasks
};
struct PermissionInfo {
  Permission permission;
  std::string_view name;           ///< Name in messages
  std::string_view action_phrase;  ///< Verb phrase after "may": "operate the tool"
  std::string_view about;
  std::array<Grant, kRoles.size()> grants;  ///< In the order of Role
};
std::span<const PermissionInfo> permission_infos();

/// @param has_tasks  whether the session or recording has tasks
bool is_permitted(Role role, Permission permission, bool has_tasks);
/// Names of a role's permissions, for messages.
/// @param stores_runs  whether records exist from which curves are computed
std::vector<std::string_view> permissions_of(Role role, bool has_tasks, bool stores_runs);
/// Refusal for a missing permission; names the roles that have it.
Error missing_permission(Role role, Permission permission);

/// The table in Markdown.
std::string permissions_table();

}  // namespace palpate::server
