#include "palpate/rehearsal/comparison.h"

#include <algorithm>

#include "palpate/rehearsal/removal_follower.h"
#include "rehearsal/clearance_meter.h"
#include "rehearsal/trajectory_meter.h"

namespace palpate {
namespace {

/// Decimated path of the tip: keeps every tick, then every second, fourth, eighth ... as it grows.
class DecimatedPath {
 public:
  void observe(const Point<Patient>& at) {
    last_ = at;
    if (tick_count_++ % step_ != 0) return;
    points_.push_back(at);
    if (points_.size() < kMaxPathPoints) return;
    step_ *= 2;
    std::size_t retained = 0;
    for (std::size_t n = 0; n < points_.size(); n += 2) points_[retained++] = points_[n];
    points_.resize(retained);
  }
  std::vector<Point<Patient>> finish() {
    if (last_ && points_.back() != *last_) points_.push_back(*last_);
    return std::move(points_);
  }

 private:
  std::vector<Point<Patient>> points_;
  std::optional<Point<Patient>> last_;
  std::uint64_t tick_count_ = 0, step_ = 1;
};

/// Measures everything but the volumes in one pass.
class RunMeter {
 public:
  RunMeter(const PlanInScene& plan, const Model& model, const std::vector<StructureDistance>& distances,
           std::size_t device, std::uint64_t ticks)
      : model_(model),
        tool_(model.tool_of(device)),
        shaft_(shaft_of(tool_)),
        device_(device),
        all_ticks_(std::max<std::uint64_t>(ticks, 1)),
        clearance_(distances, plan.distances_mm, intervals_of(all_ticks_)) {
    for (std::size_t n = 0; n < plan.file.trajectories.size(); ++n)
      trajectories_.emplace_back(plan.file.trajectories[n], plan.enters[n], distances);
  }

  Result<void> observe(const TickRecord& tick) {
    if (!std::isfinite(tick.time_s) || (comparison_.ticks > 0 && tick.time_s < time_s_))
      return Error{ErrorKind::kBadInput, "the clock does not advance at tick " + std::to_string(tick.tick),
                   "", "record the run again"};
    if (comparison_.ticks == 0) started_s_ = tick.time_s;
    const double dt_s = comparison_.ticks > 0 ? tick.time_s - time_s_ : 0;
    if (comparison_.ticks > 0 && tick.tick > last_tick_ + 1) comparison_.missing_s += dt_s;
    last_tick_ = tick.tick;
    time_s_ = tick.time_s;
    const std::size_t interval = static_cast<std::size_t>(std::min(comparison_.ticks++, all_ticks_ - 1) *
                                                          intervals_of(all_ticks_) / all_ticks_);
    if (interval == comparison_.times_s.size()) comparison_.times_s.push_back(time_s_ - started_s_);

    const DeviceTick& device = tick.device[device_];
    observe_orientation(device);
    const MeterInput now{
        {tick.tick, time_s_ - started_s_, tip_of(tool_, device)},
        head_of(model_.X_WorldPatient, tool_, tick, device),
        dt_s,
        interval,
        &device,
        shaft_ ? std::optional(tool_in_patient(model_.X_WorldPatient, tick, device, *shaft_)) : std::nullopt};
    if (!now.point.at.all_finite() || (device.flags & kFlagNotFinite) != 0) {
      ++comparison_.invalid_ticks;
      return {};
    }
    clearance_.observe(now);
    for (TrajectoryMeter& trajectory : trajectories_) trajectory.observe(now);
    path_.observe(now.point.at);
    return {};
  }

  PlanComparison finish() {
    comparison_.time_s = comparison_.ticks > 0 ? time_s_ - started_s_ : 0;
    for (TrajectoryMeter& trajectory : trajectories_)
      comparison_.trajectories.push_back(trajectory.finish(reports_orientation_));
    clearance_.finish(comparison_);
    comparison_.path = path_.finish();
    return std::move(comparison_);
  }

 private:
  static std::size_t intervals_of(std::uint64_t ticks) {
    return static_cast<std::size_t>(std::min<std::uint64_t>(ticks, kMaxPlanTimes));
  }
  // a device without orientation reports a constant one
  void observe_orientation(const DeviceTick& device) {
    if (!first_orientation_wxyz_) first_orientation_wxyz_ = device.orientation_wxyz;
    reports_orientation_ = reports_orientation_ || *first_orientation_wxyz_ != device.orientation_wxyz;
  }

  const Model& model_;
  const Tool& tool_;
  std::optional<Eigen::Vector3d> shaft_;
  std::size_t device_;
  std::uint64_t all_ticks_, last_tick_ = 0;
  double started_s_ = 0, time_s_ = 0;
  std::optional<std::array<double, 4>> first_orientation_wxyz_;
  bool reports_orientation_ = false;
  ClearanceMeter clearance_;
  std::vector<TrajectoryMeter> trajectories_;
  DecimatedPath path_;
  PlanComparison comparison_;
};

double sum_of(const VolumesByLabel& volumes) {
  double sum_mm3 = 0;
  for (const auto& [label, mm3] : volumes) sum_mm3 += mm3;
  return sum_mm3;
}

double of_label(const VolumesByLabel& volumes, LabelId label) {
  const auto found = volumes.find(label);
  return found != volumes.end() ? found->second : 0;
}

void report_volumes(const PlannedVolumes& planned, const RemovedVolumes& removed, PlanComparison& to) {
  for (std::size_t n = 0; n < planned.of_regions.size(); ++n)
    to.regions.push_back({sum_of(planned.of_regions[n]), sum_of(removed.in_plan.of_regions[n])});
  std::map<LabelId, StructureVolume> by_label;
  for (const VolumesByLabel* volumes : {&planned.of_plan, &removed.outside})
    for (const auto& [label, mm3] : *volumes) by_label[label].label = label;
  for (auto& [label, volume] : by_label) {
    volume.in_plan = {of_label(planned.of_plan, label), of_label(removed.in_plan.of_plan, label)};
    volume.outside_mm3 = of_label(removed.outside, label);
    to.volumes.push_back(volume);
  }
}

}  // namespace

const char* word_of(EntryKind kind) {
  switch (kind) {
    case EntryKind::kPassed:
      return "passed";
    case EntryKind::kTouched:
      return "touched";
    case EntryKind::kNearest:
      return "nearest";
    case EntryKind::kNone:
      break;
  }
  return "none";
}

bool PlanComparison::is_within_limit() const {
  return ticks > 0 && !cut_short && missing_s == 0 &&
         std::ranges::all_of(trajectories,
                             [](const TrajectoryResult& done) { return done.is_within_limit(); }) &&
         std::ranges::all_of(approaches,
                             [](const StructureClearance& approach) { return approach.is_within_limit(); });
}

Result<PlanComparison> compare_recording(const PlanInScene& plan, const Model& model,
                                         const std::vector<StructureDistance>& distances,
                                         const RecordingSource& recording, std::size_t device,
                                         const Progress& progress) {
  const RecordingHead& head = recording.head();
  if (device >= static_cast<std::size_t>(std::max(head.header.devices, 1)))
    return Error{ErrorKind::kBadInput, "it has no device " + std::to_string(device + 1), "",
                 "its devices are 1 to " + std::to_string(head.header.devices)};
  if (head.ticks == 0) return Error{ErrorKind::kBadInput, "it has no tick", "", "record a run first"};
  RunMeter run(plan, model, distances, device, head.ticks);
  RemovalFollower removal(model);
  double ticks_done = 0;
  const auto read = recording.read(
      [&](const RecordingPart& part) -> Result<void> {
        for (const RecordingEvent& event : part.events) removal.on_event(event);
        for (const TickRecord& tick : part.ticks)
          if (auto valid = run.observe(tick); !valid) return valid;
        ticks_done += static_cast<double>(part.ticks.size());
        progress.report("comparing", ticks_done / static_cast<double>(head.ticks));
        return {};
      },
      progress);
  if (!read) return read.error();
  PlanComparison comparison = run.finish();
  comparison.cut_short = !head.summary.has_value();
  const auto planned = planned_volumes(plan, model, progress);
  if (!planned) return planned.error();
  report_volumes(*planned, removed_volumes(plan, removal.removed()), comparison);
  return comparison;
}

}  // namespace palpate
