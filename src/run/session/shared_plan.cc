#include "palpate/session/shared_plan.h"

#include <algorithm>
#include <system_error>
#include <utility>

#include "palpate/base/file.h"
#include "palpate/rehearsal/plan_in_scene.h"

namespace palpate {
namespace {

Error cannot_change(std::string what, std::string where, std::string remedy) {
  return {ErrorKind::kUsage, std::move(what), std::move(where), std::move(remedy)};
}

bool is_empty_plan(const PlanFile& plan) {
  return plan.trajectories.empty() && plan.regions.empty() && plan.distances.empty();
}

std::array<double, 3> position_of(const Point<Patient>& point) {
  return {point.x(), point.y(), point.z()};
}
Point<Patient> point_of(const std::array<double, 3>& point) {
  return {point[0], point[1], point[2]};
}

// regions refer to trajectories by index
Result<void> remove_trajectory(PlanFile& plan, std::size_t index) {
  for (PlanRegion& region : plan.regions) {
    if (region.shape == PlanShape::kStructures) continue;
    if (region.trajectory == index)
      return cannot_change("the region \"" + region.name + "\" lies on this trajectory", "trajectory",
                           "remove the region from the plan's file first");
    if (region.trajectory > index) --region.trajectory;
  }
  plan.trajectories.erase(plan.trajectories.begin() + static_cast<std::ptrdiff_t>(index));
  return {};
}

Result<PlanFile> changed_plan(PlanFile plan, const PlanRequest& request) {
  const std::size_t index = *request.trajectory;
  const std::size_t count = plan.trajectories.size();
  if (index > count || (request.remove && index == count))
    return cannot_change("the plan has no such trajectory", "trajectory", "reload the plan");
  if (request.remove) {
    if (auto removed = remove_trajectory(plan, index); !removed) return removed.error();
  } else {
    if (index == count) {
      if (!request.name || !request.entry_mm || !request.target_mm)
        return cannot_change("a new trajectory needs a name, an entry and a target", "trajectory",
                             "give all three");
      plan.trajectories.emplace_back();
    }
    PlanTrajectory& trajectory = plan.trajectories[index];
    if (request.name) trajectory.name = *request.name;
    if (request.entry_mm) trajectory.entry = point_of(*request.entry_mm);
    if (request.target_mm) trajectory.target = point_of(*request.target_mm);
  }
  if (is_empty_plan(plan)) return plan;
  // round trip through the text, so that the values are bit-identical to what the command line would read
  auto read = parse_plan(plan_text(plan), plan.source);
  if (read) return read;
  Error error = read.error();
  error.where = "trajectory";
  return error;
}

}  // namespace

Result<std::shared_ptr<SharedPlan>> SharedPlan::open(const std::filesystem::path& file, const Model& model,
                                                     bool may_change) {
  std::error_code ignored;
  if (may_change && !std::filesystem::exists(file, ignored)) {
    if (auto claimed = claim_output(file); !claimed) return claimed.error();
    PlanFile none;
    none.title = file.stem().string();
    none.source = file.string();
    return std::shared_ptr<SharedPlan>(new SharedPlan(file, {}, std::move(none), {}, true));
  }
  auto text = read_file(file, kMaxSceneBytes);
  if (!text) return text.error();
  auto plan = parse_plan(*text, file.string());
  if (!plan) return plan.error();
  const auto found = resolve_plan(*plan, model);
  if (!found) return found.error();
  std::vector<ViewedPlan::KeepAway> keep_away;
  for (const auto& [label, mm] : found->distances_mm) keep_away.push_back({label, mm});
  return std::shared_ptr<SharedPlan>(
      new SharedPlan(file, *std::move(text), *std::move(plan), std::move(keep_away), may_change));
}

SharedPlan::SharedPlan(std::filesystem::path file, std::optional<std::string> in_file, PlanFile plan,
                       std::vector<ViewedPlan::KeepAway> keep_away, bool may_change)
    : file_(std::move(file)),
      keep_away_(std::move(keep_away)),
      may_change_(may_change),
      in_file_(std::move(in_file)),
      saved_(in_file_ ? plan_text(plan) : ""),
      plan_(std::move(plan)) {
  publish();
}

std::shared_ptr<const ViewedPlan> SharedPlan::viewed() const {
  const std::lock_guard lock(mutex_);
  return viewed_;
}

void SharedPlan::publish() {
  auto next = std::make_shared<ViewedPlan>();
  for (const PlanTrajectory& trajectory : plan_.trajectories)
    next->trajectories.push_back({trajectory.name, position_of(trajectory.entry),
                                  position_of(trajectory.target), trajectory.entry_within_mm,
                                  trajectory.target_within_mm, trajectory.angle_within_deg,
                                  trajectory.depth_within_mm});
  next->keep_away = keep_away_;
  next->version = viewed_ ? viewed_->version + 1 : 1;
  next->saved = is_empty_plan(plan_) ? !in_file_ : plan_text(plan_) == saved_;
  next->can_change = may_change_;
  viewed_ = std::move(next);
}

Result<void> SharedPlan::change(const PlanRequest& request) {
  const std::lock_guard lock(mutex_);
  if (!may_change_)
    return cannot_change("the plan of a recording cannot be changed", "",
                         "to change a plan, run palpate explore --plan");
  if (request.version != viewed_->version)
    return cannot_change("the plan has been changed by another viewer since", "version",
                         "reload it, and change the new version");
  if (request.save) {
    if (auto saved = save(); !saved) return saved;
  } else {
    auto next = request.restore_version ? plan_at(*request.restore_version) : changed_plan(plan_, request);
    if (!next) return next.error();
    earlier_plans_.emplace_back(viewed_->version, std::exchange(plan_, *std::move(next)));
    if (earlier_plans_.size() > kMaxUndoVersions) earlier_plans_.pop_front();
  }
  publish();
  return {};
}

Result<PlanFile> SharedPlan::plan_at(std::uint32_t version) const {
  const auto stored = std::ranges::find(earlier_plans_, version, &std::pair<std::uint32_t, PlanFile>::first);
  if (stored != earlier_plans_.end()) return stored->second;
  return cannot_change("that version of the plan is not stored", "back_to", "change it by hand");
}

Result<void> SharedPlan::save() {
  if (is_empty_plan(plan_))
    return cannot_change("the plan is empty", "", "add a trajectory, or do not save it");
  std::error_code ignored;
  std::optional<std::string> now;
  if (std::filesystem::exists(file_, ignored)) {
    auto text = read_file(file_, kMaxSceneBytes);
    if (!text) return text.error();
    now = *std::move(text);
  }
  if (now != in_file_)
    return cannot_change("the plan's file has been changed since it was read", "",
                         "download this plan, and merge the two by hand");
  const std::string text = plan_text(plan_);
  if (auto written = write_file(file_, text); !written) return written;
  in_file_ = saved_ = text;
  return {};
}

}  // namespace palpate
