#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/base/result.h"

/// Who may what: one table, by which the server grants and refuses, and which
/// docs/reference/viewer-protocol.md shows.
namespace palpate::link {

enum class Role : std::uint8_t { kView, kControl, kLearner, kTeacher };
inline constexpr std::array kRoles{Role::kView, Role::kControl, Role::kLearner, Role::kTeacher};
std::string_view name_of(Role role);

/// Who has come.
struct Who {
  Role role = Role::kView;
  std::string learner;  ///< of a learner: the pseudonym that the token says
};

enum class Right : std::uint8_t {
  kLook,
  kStop,
  kUnseen,
  kHand,
  kFeel,
  kPlan,
  kPlay,
  kLesson,
  kOwnRuns,
  kAllRuns,
};
/// What a role may of it.
enum class May : std::uint8_t {
  kNo,
  kYes,
  kWithoutTasks,  ///< where the session has no tasks, which would lay it down
};
struct RightInfo {
  Right right;
  std::string_view name;  ///< in messages
  std::string_view deed;  ///< "take the hand", after "may"
  std::string_view about;
  std::array<May, kRoles.size()> may;  ///< in the order of Role
};
std::span<const RightInfo> right_infos();

/// @param has_tasks  the session or recording has some
bool may(Role role, Right right, bool has_tasks);
/// The names of what a role may, for messages. @param keeps_runs  there are records of which curves are made
std::vector<std::string_view> rights_of(Role role, bool has_tasks, bool keeps_runs);
/// The refusal of whoever may not, with the roles that may.
Error lacks_right(Role role, Right right);

/// The table as Markdown.
std::string rights_table();

}  // namespace palpate::link
