#include "palpate/rehearsal/plan_from_markups.h"

#include <algorithm>
#include <optional>

#include "palpate/base/printable.h"
#include "palpate/navigation/point_files.h"

namespace palpate {
namespace {

constexpr const char* kExitPoint =
    "a trajectory is a Line from entry to target, or two points called Entry and Target";

Error no_trajectory(std::string what, const std::string& where) {
  return {ErrorKind::kBadInput, std::move(what), where, kExitPoint};
}

std::string in_small_letters(std::string_view text) {
  std::string small(text);
  for (char& c : small)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  return small;
}

// name of a trajectory: the line's name, or a number if it has none
std::string name_of_line(const Markup& line, std::size_t number) {
  std::string name = printable_name(line.name);
  const std::string first = printable_name(line.points.front().name);
  if (name.empty() && first.size() > 2 && first.ends_with("-1")) name = first.substr(0, first.size() - 2);
  return name.empty() ? "trajectory " + std::to_string(number) : name;
}

Result<void> add_trajectory(PlanFile& plan, std::string name, const NamedPoint& entry,
                            const NamedPoint& target) {
  const auto is_taken = [&](const std::string& text) {
    return std::ranges::find(plan.trajectories, text, &PlanTrajectory::name) != plan.trajectories.end();
  };
  const std::string base_name = name;
  for (int n = 2; is_taken(name); ++n) name = base_name + " " + std::to_string(n);
  PlanTrajectory trajectory;
  trajectory.name = std::move(name);
  trajectory.entry = Point<Patient>(entry.at_mm);
  trajectory.target = Point<Patient>(target.at_mm);
  if (!(trajectory.length_mm() >= kMinTrajectory_mm))
    return Error{ErrorKind::kBadInput, "entry and target of \"" + trajectory.name + "\" are the same place",
                 plan.source, "they must be at least 0.1 mm apart"};
  if (plan.trajectories.size() == kMaxPlanParts)
    return Error{ErrorKind::kBadInput, "has more than " + std::to_string(kMaxPlanParts) + " trajectories",
                 plan.source, "leave out markups that are not needed"};
  plan.trajectories.push_back(std::move(trajectory));
  return {};
}

}  // namespace

Result<PlanOfMarkups> plan_from_markups(std::string_view text, const std::string& title,
                                        const std::string& where) {
  const auto markups = parse_markups(text, where);
  if (!markups) return markups.error();
  PlanOfMarkups made;
  made.plan.title = title;
  made.plan.source = where;
  std::vector<const NamedPoint*> entries, targets;
  for (const Markup& markup : *markups) {
    const std::string type = printable_name(markup.type);
    if (markup.type == "Fiducial") {
      for (const NamedPoint& point : markup.points) {
        const std::string name = in_small_letters(point.name);
        if (name == "entry")
          entries.push_back(&point);
        else if (name == "target")
          targets.push_back(&point);
        else
          made.left_out.push_back(point.name);
      }
    } else if (markup.type == "Line") {
      if (markup.points.size() != 2)
        return no_trajectory("a Line has " + std::to_string(markup.points.size()) + " points, not 2", where);
      auto added = add_trajectory(made.plan, name_of_line(markup, made.plan.trajectories.size() + 1),
                                  markup.points[0], markup.points[1]);
      if (!added) return added.error();
    } else {
      return no_trajectory(type.empty() ? "a markup does not state its type"
                                        : "a markup is a " + type + ", which is not a trajectory",
                           where);
    }
  }
  for (const auto& [points, name] : {std::pair(&entries, "Entry"), std::pair(&targets, "Target")})
    if (points->size() > 1)
      return no_trajectory(std::to_string(points->size()) + " points are called " + name, where);
  if (entries.size() != targets.size())
    return no_trajectory(std::string("no point is called ") + (entries.empty() ? "Entry" : "Target"), where);
  if (!entries.empty()) {
    auto added = add_trajectory(made.plan, "trajectory", *entries.front(), *targets.front());
    if (!added) return added.error();
  }
  if (made.plan.trajectories.empty()) return no_trajectory("no point is called Entry or Target", where);
  return made;
}

}  // namespace palpate
