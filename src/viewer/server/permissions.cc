#include "server/permissions.h"

#include "palpate/base/check.h"

namespace palpate::server {
namespace {

constexpr Grant kNo = Grant::kNo, kYes = Grant::kYes, kFree = Grant::kWithoutTasks;

// columns in the order of Role: view, control, learner, teacher
constexpr std::array kPermissions{
    PermissionInfo{Permission::kObserve,
                   "look",
                   "observe the session",
                   "sees scan, structures, poses, the state of the session, the plan and runs in progress",
                   {kYes, kYes, kYes, kYes}},
    PermissionInfo{Permission::kStop, "stop", "stop the force", "stops the force", {kYes, kYes, kYes, kYes}},
    PermissionInfo{Permission::kSeeHidden,
                   "unseen",
                   "see what a quiz hides",
                   "sees names and the structures to find during a quiz",
                   {kYes, kYes, kNo, kYes}},
    PermissionInfo{Permission::kOperateTool,
                   "hand",
                   "operate the tool",
                   "operates the tool: takes the tip, starts and ends runs of tasks, rearms, pauses, runs a "
                   "burr's motor, undoes and redoes its strokes, turns the object",
                   {kNo, kYes, kYes, kYes}},
    PermissionInfo{
        Permission::kChangeContact,
        "feel",
        "change contact settings",
        "changes contact settings: method, law, force limit, tissues, [switches](flags.md#switches) of this "
        "permission",
        {kNo, kYes, kFree, kYes}},
    PermissionInfo{
        Permission::kPlan, "plan", "change the plan", "changes and saves the plan", {kNo, kYes, kFree, kYes}},
    PermissionInfo{Permission::kPlay,
                   "play",
                   "control the playback",
                   "controls the playback of a recording",
                   {kNo, kYes, kNo, kYes}},
    PermissionInfo{
        Permission::kLesson,
        "lesson",
        "lead the lesson",
        "leads the lesson: chooses the learner and the task of the next runs, starts and ends them "
        "without operating the tool, shows names to learners, ends the session",
        {kNo, kNo, kNo, kYes}},
    PermissionInfo{Permission::kOwnRuns,
                   "own_runs",
                   "see their own learning curves",
                   "sees the learning curves of the learner's own runs",
                   {kNo, kNo, kYes, kNo}},
    PermissionInfo{Permission::kAllRuns,
                   "all_runs",
                   "see all learning curves",
                   "sees the learning curves of all learners",
                   {kNo, kNo, kNo, kYes}},
};

const PermissionInfo& permission_info(Permission permission) {
  const PermissionInfo& info = kPermissions[static_cast<std::size_t>(permission)];
  PALPATE_CHECK(info.permission == permission);
  return info;
}

std::string joined(const std::vector<std::string>& parts) {
  std::string text;
  for (std::size_t n = 0; n < parts.size(); ++n)
    text += (n == 0 ? "" : n + 1 == parts.size() ? " or " : ", ") + parts[n];
  return text;
}

const char* person(Role role) {
  switch (role) {
    case Role::kView:
      return "a viewer";
    case Role::kControl:
      return "a viewer with control";
    case Role::kLearner:
      return "a learner";
    case Role::kTeacher:
      return "a teacher";
  }
  return "";
}

std::string cell_of(Grant of) {
  return of == Grant::kNo ? "no" : of == Grant::kYes ? "yes" : "where there are no tasks";
}

}  // namespace

std::string_view name_of(Role role) {
  constexpr std::array<std::string_view, kRoles.size()> kNames{"view", "control", "learner", "teacher"};
  return kNames[static_cast<std::size_t>(role)];
}

std::span<const PermissionInfo> permission_infos() {
  return kPermissions;
}

bool is_permitted(Role role, Permission permission, bool has_tasks) {
  const Grant grant = permission_info(permission).grants[static_cast<std::size_t>(role)];
  return grant == Grant::kYes || (grant == Grant::kWithoutTasks && !has_tasks);
}

std::vector<std::string_view> permissions_of(Role role, bool has_tasks, bool stores_runs) {
  std::vector<std::string_view> names;
  for (const PermissionInfo& info : kPermissions) {
    const bool is_of_runs =
        info.permission == Permission::kOwnRuns || info.permission == Permission::kAllRuns;
    if (is_permitted(role, info.permission, has_tasks) && (stores_runs || !is_of_runs))
      names.push_back(info.name);
  }
  return names;
}

Error missing_permission(Role role, Permission permission) {
  const PermissionInfo& info = permission_info(permission);
  std::vector<std::string> people, tokens;
  for (const Role other : kRoles) {
    if (info.grants[static_cast<std::size_t>(other)] != Grant::kYes) continue;
    people.emplace_back(person(other));
    tokens.emplace_back(name_of(other));
  }
  const bool is_for_now = info.grants[static_cast<std::size_t>(role)] == Grant::kWithoutTasks;
  return {ErrorKind::kUsage,
          std::string(is_for_now ? "in a session with tasks " : "") + "only " + joined(people) + " may " +
              std::string(info.action_phrase),
          "role", "connect with a token for " + joined(tokens)};
}

std::string permissions_table() {
  std::string text = "| may |";
  for (const Role role : kRoles) text += " " + std::string(name_of(role)) + " |";
  text += " in `may` |\n|---|" + std::string("---|---|---|---|---|\n");
  for (const PermissionInfo& info : kPermissions) {
    text += "| " + std::string(info.about) + " |";
    for (const Grant of : info.grants) text += " " + cell_of(of) + " |";
    text += " `" + std::string(info.name) + "` |\n";
  }
  return text;
}

}  // namespace palpate::server
