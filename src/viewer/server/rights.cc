#include "server/rights.h"

#include "palpate/base/check.h"

namespace palpate::server {
namespace {

constexpr May kNo = May::kNo, kYes = May::kYes, kFree = May::kWithoutTasks;

// columns in the order of Role: view, control, learner, teacher
constexpr std::array kRights{
    RightInfo{Right::kObserve,
              "look",
              "look on",
              "sees scan, structures, poses, the state of the session, the plan and runs in progress",
              {kYes, kYes, kYes, kYes}},
    RightInfo{Right::kStop, "stop", "stop the force", "stops the force", {kYes, kYes, kYes, kYes}},
    RightInfo{Right::kSeeHidden,
              "unseen",
              "see what a quiz hides",
              "sees names and the structures to find during a quiz",
              {kYes, kYes, kNo, kYes}},
    RightInfo{Right::kOperateTool,
              "hand",
              "operate the tool",
              "operates the tool: takes the tip, starts and ends runs of tasks, rearms, pauses, runs a "
              "burr's motor, undoes and redoes its strokes, turns the object",
              {kNo, kYes, kYes, kYes}},
    RightInfo{
        Right::kChangeContact,
        "feel",
        "change what is felt",
        "changes contact settings: method, law, force limit, tissues, [switches](flags.md#switches) of this "
        "permission",
        {kNo, kYes, kFree, kYes}},
    RightInfo{
        Right::kPlan, "plan", "change the plan", "changes and saves the plan", {kNo, kYes, kFree, kYes}},
    RightInfo{Right::kPlay,
              "play",
              "control the playback",
              "controls the playback of a recording",
              {kNo, kYes, kNo, kYes}},
    RightInfo{Right::kLesson,
              "lesson",
              "lead the lesson",
              "leads the lesson: chooses the learner and the task of the next runs, starts and ends them "
              "without operating the tool, shows names to learners, ends the session",
              {kNo, kNo, kNo, kYes}},
    RightInfo{Right::kOwnRuns,
              "own_runs",
              "see their own learning curves",
              "sees the learning curves of the learner's own runs",
              {kNo, kNo, kYes, kNo}},
    RightInfo{Right::kAllRuns,
              "all_runs",
              "see all learning curves",
              "sees the learning curves of all learners",
              {kNo, kNo, kNo, kYes}},
};

const RightInfo& right_info(Right right) {
  const RightInfo& info = kRights[static_cast<std::size_t>(right)];
  PALPATE_CHECK(info.right == right);
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

std::string cell_of(May of) {
  return of == May::kNo ? "no" : of == May::kYes ? "yes" : "where there are no tasks";
}

}  // namespace

std::string_view name_of(Role role) {
  constexpr std::array<std::string_view, kRoles.size()> kNames{"view", "control", "learner", "teacher"};
  return kNames[static_cast<std::size_t>(role)];
}

std::span<const RightInfo> right_infos() {
  return kRights;
}

bool may(Role role, Right right, bool has_tasks) {
  const May of = right_info(right).may[static_cast<std::size_t>(role)];
  return of == May::kYes || (of == May::kWithoutTasks && !has_tasks);
}

std::vector<std::string_view> rights_of(Role role, bool has_tasks, bool stores_runs) {
  std::vector<std::string_view> names;
  for (const RightInfo& info : kRights) {
    const bool is_of_runs = info.right == Right::kOwnRuns || info.right == Right::kAllRuns;
    if (may(role, info.right, has_tasks) && (stores_runs || !is_of_runs)) names.push_back(info.name);
  }
  return names;
}

Error lacks_right(Role role, Right right) {
  const RightInfo& info = right_info(right);
  std::vector<std::string> people, tokens;
  for (const Role other : kRoles) {
    if (info.may[static_cast<std::size_t>(other)] != May::kYes) continue;
    people.emplace_back(person(other));
    tokens.emplace_back(name_of(other));
  }
  const bool is_for_now = info.may[static_cast<std::size_t>(role)] == May::kWithoutTasks;
  return {ErrorKind::kUsage,
          std::string(is_for_now ? "where there are tasks " : "") + "only " + joined(people) + " may " +
              std::string(info.deed),
          "role", "connect with a token for " + joined(tokens)};
}

std::string rights_table() {
  std::string text = "| may |";
  for (const Role role : kRoles) text += " " + std::string(name_of(role)) + " |";
  text += " in `may` |\n|---|" + std::string("---|---|---|---|---|\n");
  for (const RightInfo& info : kRights) {
    text += "| " + std::string(info.about) + " |";
    for (const May of : info.may) text += " " + cell_of(of) + " |";
    text += " `" + std::string(info.name) + "` |\n";
  }
  return text;
}

}  // namespace palpate::server
