#include "palpate/tasks/evaluator.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "palpate/base/hash.h"

namespace palpate {
namespace {

constexpr std::size_t kMaxEvents = 10000;
// kMinTouch_N, kRestRadius_mm and kMinStroke_mm are palpate's own definitions, not taken from a study
// (docs/reference/metrics.md, "What was covered, and touched")
constexpr double kMinTouch_N = 0.2;     // minimum force for coverage and answers
constexpr double kRestRadius_mm = 1.5;  // radius within which a contact point counts as at rest
constexpr double kMinStroke_mm = 2;  // distance over which a contact has to move before it covers a surface
constexpr double kMaxForce_N = 1e6;  // larger values are invalid
constexpr double kCheckInterval_s = 0.1;  // minimum interval between evaluations of the removed volume

/// Fraction of an interval, interpolated linearly from a to b, that is above a threshold.
double fraction_above(double a, double b, double threshold) {
  const bool first = a > threshold, last = b > threshold;
  if (first && last) return 1;
  if (!first && !last) return 0;
  const double crossing = (threshold - a) / (b - a);
  return first ? crossing : 1 - crossing;
}

/// Mean excess over a threshold in an interval that is interpolated linearly.
double mean_excess(double a, double b, double threshold) {
  const double over_a = std::max(0.0, a - threshold), over_b = std::max(0.0, b - threshold);
  return 0.5 * (over_a + over_b) * fraction_above(a, b, threshold);
}

double sum_of(const VolumesByLabel& volumes) {
  double sum_mm3 = 0;
  for (const auto& [label, mm3] : volumes) sum_mm3 += mm3;
  return sum_mm3;
}

Eigen::Vector3d vector_of(const std::array<double, 3>& v) {
  return {v[0], v[1], v[2]};
}

}  // namespace

TaskEvaluator::TaskEvaluator(TaskInScene task)
    : task_(std::move(task)),
      force_meters_(task_.forces.size()),
      protection_meters_(task_.protections.size()),
      metric_meters_(task_.metrics.size()),
      step_s_(task_.file.steps.size()),
      coverage_touches_(task_.file.steps.size()),
      step_condition_held_(task_.file.steps.size()),
      done_(task_.file.steps.size()),
      hash_(kHashSeed) {
  hash_word(hash_, task_.file.text_hash);
  if (!task_.plan) return;
  removed_ = task_.plan->untouched;
  removed_mm3_.resize(task_.plan->planned_mm3.size());
  for (std::size_t n = 0; n < task_.metrics.size(); ++n) {
    burr_meters_.emplace_back();
    const TaskMetric& metric = task_.file.metrics[n];
    if (metric.metric == Metric::kBurrDistance || metric.metric == Metric::kForceNear)
      burr_meters_[n].emplace(task_.distances[n], metric.within_mm);
  }
}

void TaskEvaluator::on_event(const RecordingEvent& event) {
  if (removed_ && !ended_ && removed_->on_event(event)) removal_changed_ = true;
}

void TaskEvaluator::ForceMeter::observe(double force_N, double dt_s,
                                        const std::optional<std::array<double, 2>>& band_N,
                                        std::optional<double> limit_N) {
  if (dt_s > 0) {
    if (force_N > 0 || last_N > 0) contact_s += dt_s;
    impulse_Ns += 0.5 * (force_N + last_N) * dt_s;
    if (band_N) {
      const double in_s = dt_s * (fraction_above(last_N, force_N, (*band_N)[0]) -
                                  fraction_above(last_N, force_N, (*band_N)[1]));
      in_band_s += in_s;
      const bool inside = force_N >= (*band_N)[0] && force_N <= (*band_N)[1];
      unbroken_s = inside ? unbroken_s + in_s : 0;
      longest_s = std::max(longest_s, unbroken_s);
    }
    if (limit_N) {
      excess_Ns += mean_excess(last_N, force_N, *limit_N) * dt_s;
      above_s += fraction_above(last_N, force_N, *limit_N) * dt_s;
    }
  }
  peak_N = std::max(peak_N, force_N);
  last_N = force_N;
}

// contacts with invalid numbers are ignored
void TaskEvaluator::read_contacts(const TickRecord& tick) {
  const DeviceTick& device = tick.device[0];
  contact_count_ = 0;
  for (std::size_t n = 0; n < device.contact_label.size() && device.contact_label[n] != 0; ++n) {
    Contact contact{device.contact_label[n],
                    {device.contact_patient_mm[3 * n], device.contact_patient_mm[3 * n + 1],
                     device.contact_patient_mm[3 * n + 2]},
                    device.contact_N[n]};
    if (!contact.position_mm.allFinite() || !(contact.force_N > 0) || contact.force_N > kMaxForce_N) continue;
    // within 45 degrees of the inward normal at the outermost contact
    if (contact_count_ > 0 && device.contact_part[n] == device.contact_part[0]) {
      const Eigen::Vector3d displacement = contact.position_mm - contacts_[0].position_mm;
      const double below_mm = -displacement.dot(vector_of(device.normal_patient));
      constexpr double kMin_mm = 0.1;
      contact.is_beneath = below_mm > kMin_mm && below_mm > std::numbers::sqrt2 / 2 * displacement.norm();
    }
    contact.is_visible = task_.sight && task_.sight->is_visible(tick, contact.position_mm);
    contacts_[contact_count_++] = contact;
  }
  // scales the forces to those sent
  double requested_N = 0;
  for (std::size_t n = 0; n < contact_count_; ++n) requested_N += contacts_[n].force_N;
  requested_N *= device.force_gain;
  // Relative margin above rounding errors: a force clamped to the device's limit must not exceed an equal
  // limit of a task.
  const double sent_N = (1 - 1e-12) * vector_of(device.force_N).norm();
  const double fraction = requested_N <= sent_N ? 1 : sent_N / requested_N;
  const double gain = device.force_gain * fraction;
  if (!(gain > 0) || !std::isfinite(gain)) contact_count_ = 0;
  for (std::size_t n = 0; n < contact_count_; ++n) contacts_[n].force_N *= gain;
}

const TaskEvaluator::Contact* TaskEvaluator::strongest_contact() const {
  const auto end = contacts_.begin() + static_cast<std::ptrdiff_t>(contact_count_);
  const auto strongest = std::max_element(
      contacts_.begin(), end, [](const Contact& a, const Contact& b) { return a.force_N < b.force_N; });
  return strongest == end ? nullptr : &*strongest;
}

double TaskEvaluator::force_on(const std::vector<bool>& labels) const {
  const auto is_one = [&](const Contact& contact) {
    return labels.empty() || (contact.label < labels.size() && labels[contact.label]);
  };
  double force_N = 0;
  for (std::size_t n = 0; n < contact_count_; ++n)
    if (is_one(contacts_[n]) || (contacts_[n].is_beneath && is_one(contacts_[0])))
      force_N += contacts_[n].force_N;
  return force_N;
}

void TaskEvaluator::add_event(TaskEvent::Kind kind, std::size_t part, const TickRecord& tick,
                              double force_N) {
  if (events_.size() == kMaxEvents) {
    ++more_events_;
    return;
  }
  events_.push_back({kind, part, tick.tick, tick.time_s - started_s_, force_N});
}

Result<void> TaskEvaluator::observe(const TickRecord& tick) {
  if (ended_) return {};
  if (!std::isfinite(tick.time_s) || (begun_ && tick.time_s <= time_s_))
    return Error{ErrorKind::kBadInput, "the clock does not advance at tick " + std::to_string(tick.tick), "",
                 "a run can be scored only up to this tick; record it again"};
  if (task_.sight && tick.devices < 2)
    return Error{ErrorKind::kBadInput, "the task needs two devices, of which the second holds a scope", "",
                 "record it with --device twice, or with a script that has a scope step"};
  const double dt_s = begun_ ? tick.time_s - time_s_ : 0;
  if (!begun_) started_s_ = tick.time_s;
  const DeviceTick& device = tick.device[0];
  if (begun_ && tick.tick != last_tick_ + 1) missing_s_ += dt_s;

  read_contacts(tick);
  // without a valid position the tip stays at the last one
  const Eigen::Vector3d tip_mm = vector_of(device.tip_patient_mm);
  constexpr double kFar_mm = 1e6;
  if (tip_mm.allFinite() && tip_mm.cwiseAbs().maxCoeff() < kFar_mm) {
    if (!tip_known_) waypoints_mm_.push_back(tip_mm);
    tip_known_ = true;
    tip_mm_ = tip_mm;
  }
  if (tip_known_) motion_.observe(tick.time_s, tip_mm_, contact_count_ > 0);
  if (task_.sight) update_visibility(tick, dt_s);
  if (removed_ && removal_changed_ && tick.time_s - started_s_ >= next_check_s_) update_removal(tick);
  if (task_.plan) update_burr(tick, dt_s);
  update_forces(tick, dt_s);
  update_steps(tick, dt_s);
  if (task_.answer_mm) update_answer(device, dt_s);
  hash_word(hash_, tick.state_hash);

  begun_ = true;
  time_s_ = tick.time_s;
  last_tick_ = tick.tick;
  ++ticks_;
  const bool all_done =
      !done_.empty() && std::all_of(done_.begin(), done_.end(), [](bool done) { return done; });
  const bool over = (task_.file.end == TaskEnd::kSteps && all_done) ||
                    (task_.file.time_limit_s && time_s_ - started_s_ >= *task_.file.time_limit_s);
  if (over) {
    ended_ = true;
    add_event(TaskEvent::Kind::kEnded, 0, tick, 0);
  }
  return {};
}

void TaskEvaluator::update_visibility(const TickRecord& tick, double dt_s) {
  const bool unseen = contact_count_ > 0 && !contacts_[0].is_visible;
  // trapezoidal rule: a change counts for half the interval
  unseen_s_ += 0.5 * (static_cast<double>(unseen_) + static_cast<double>(unseen)) * dt_s;
  if (unseen && !unseen_) add_event(TaskEvent::Kind::kUnseen, 0, tick, touch_N());
  unseen_ = unseen;
}

void TaskEvaluator::update_removal(const TickRecord& tick) {
  const RemovedVolumes removed = removed_volumes(task_.plan->plan, removed_->removed());
  for (std::size_t n = 0; n < removed_mm3_.size(); ++n)
    removed_mm3_[n] = sum_of(removed.in_plan.of_regions[n]);
  removal_changed_ = false;
  next_check_s_ = tick.time_s - started_s_ + kCheckInterval_s;
}

void TaskEvaluator::update_burr(const TickRecord& tick, double dt_s) {
  const DeviceTick& device = tick.device[0];
  const Tool& tool = task_.plan->tool;
  const bool runs = tool.motor_is_on((tick.switches & kSwitchMotor) != 0, device.buttons);
  const ToolHead head = head_of(task_.plan->X_WorldPatient, tool, tick, device);
  const bool is_valid =
      head.from.all_finite() && head.to.all_finite() && (device.flags & kFlagNotFinite) == 0;
  if (runs && is_valid)
    for (std::optional<BurrNearStructures>& meter : burr_meters_)
      if (meter) meter->observe(head, touch_N());
  if (!task_.microscope) return;
  // a line of sight hardly changes within this time
  constexpr double kLookInterval_s = 0.01;
  const bool cuts = runs && is_valid && (device.flags & kFlagContact) != 0;
  const bool was_hidden = hidden_;
  if (!cuts) {
    hidden_ = false;
  } else if (tick.time_s >= next_look_s_) {
    hidden_ = !task_.microscope->is_visible(head, removed_->removed());
    next_look_s_ = tick.time_s + kLookInterval_s;
  }
  hidden_s_ += 0.5 * (static_cast<double>(was_hidden) + static_cast<double>(hidden_)) * dt_s;
}

TaskEvaluator::Removal TaskEvaluator::removal() const {
  if (!removed_) return {};
  const RemovedVolumes removed = removed_volumes(task_.plan->plan, removed_->removed());
  Removal removal{sum_of(removed.in_plan.of_plan), sum_of(removed.outside), 0,
                  depth_past_plan_mm(task_.plan->plan, removed_->removed())};
  for (const auto& [label, mm3] : removed_->removed().by_label_mm3())
    if (std::any_of(
            task_.protections.begin(), task_.protections.end(),
            [label = label](const std::vector<bool>& has) { return label < has.size() && has[label]; }))
      removal.protected_mm3 += mm3;
  return removal;
}

void TaskEvaluator::update_forces(const TickRecord& tick, double dt_s) {
  for (std::size_t n = 0; n < force_meters_.size(); ++n) {
    const TaskForce& force = task_.file.forces[n];
    const double now_N = force_on(task_.forces[n]);
    if (force.limit_N && now_N > *force.limit_N && !(force_meters_[n].last_N > *force.limit_N))
      add_event(TaskEvent::Kind::kOverLimit, n, tick, now_N);
    force_meters_[n].observe(now_N, dt_s, force.band_N, force.limit_N);
  }
  for (std::size_t n = 0; n < protection_meters_.size(); ++n) {
    const double limit_N = task_.file.protections[n].limit_N;
    const double now_N = force_on(task_.protections[n]);
    if (now_N > limit_N && !(protection_meters_[n].last_N > limit_N))
      add_event(TaskEvent::Kind::kProtected, n, tick, now_N);
    protection_meters_[n].observe(now_N, dt_s, {}, limit_N);
  }
  for (std::size_t n = 0; n < metric_meters_.size(); ++n)
    if (info_of(task_.file.metrics[n].metric).of_structures)
      metric_meters_[n].observe(force_on(task_.metrics[n]), dt_s, {}, {});
}

bool TaskEvaluator::is_on_step(const Contact& contact, const TaskStep& step) const {
  const RegionInScene& region = task_.regions[step.region];
  return region.has(contact.label) && region.contains_point(contact.position_mm) &&
         (contact.is_visible || !step.seen);
}

// force on the step's region, including contacts beneath it
double TaskEvaluator::force_on_step(const TaskStep& step) const {
  double force_N = 0;
  for (std::size_t c = 0; c < contact_count_; ++c)
    if (is_on_step(contacts_[c], step) || (contacts_[c].is_beneath && is_on_step(contacts_[0], step)))
      force_N += contacts_[c].force_N;
  return force_N;
}

// Covers the patches along the path of a touch. Coverage begins retroactively at the first contact point,
// once the strongest contact has moved by kMinStroke_mm; a stationary press covers nothing.
void TaskEvaluator::cover_patches(std::size_t step) {
  const TaskStep& definition = task_.file.steps[step];
  const auto counts = [&](const Contact& contact) {
    return contact.force_N >= kMinTouch_N && is_on_step(contact, definition);
  };
  const Contact* strongest = nullptr;
  for (std::size_t c = 0; c < contact_count_; ++c)
    if (counts(contacts_[c]) && (strongest == nullptr || contacts_[c].force_N > strongest->force_N))
      strongest = &contacts_[c];
  CoverageTouch& touch = coverage_touches_[step];
  if (strongest == nullptr) {
    touch = {};
    return;
  }
  if (!touch.touching) touch = {true, false, strongest->position_mm};
  SurfacePatches& patches = task_.regions[definition.region].patches;
  if (!touch.moving) {
    const Eigen::Vector3d displacement = strongest->position_mm - touch.started_mm;
    if (displacement.norm() < kMinStroke_mm) return;
    touch.moving = true;
    constexpr int kSamples = 4;  // no farther apart than SurfacePatches::kWithin_mm
    for (int part = 0; part < kSamples; ++part)
      patches.cover(touch.started_mm + displacement * part / kSamples);
  }
  for (std::size_t c = 0; c < contact_count_; ++c)
    if (counts(contacts_[c])) patches.cover(contacts_[c].position_mm);
}

bool TaskEvaluator::belongs_to_completed_touch(const TaskStep& step) const {
  return step.kind == StepKind::kTouch && last_completed_touch_ &&
         last_completed_touch_->region != step.region;
}

// progress of a kCover or kRemove step; empty for other kinds
std::optional<TaskEvaluator::StepProgress> TaskEvaluator::progress_of(const TaskStep& step) const {
  if (step.kind == StepKind::kRemove)
    return StepProgress{removed_mm3_[step.region], step.coverage * task_.plan->planned_mm3[step.region]};
  if (step.kind != StepKind::kCover) return std::nullopt;
  const SurfacePatches& patches = task_.regions[step.region].patches;
  return StepProgress{static_cast<double>(patches.covered()),
                      step.coverage * static_cast<double>(patches.count())};
}

void TaskEvaluator::update_steps(const TickRecord& tick, double dt_s) {
  const Contact* const strongest = strongest_contact();
  if (last_completed_touch_ &&
      (strongest == nullptr ||
       (strongest->position_mm - last_completed_touch_->position_mm).norm() > kRestRadius_mm))
    last_completed_touch_.reset();
  for (std::size_t n = 0; n < done_.size(); ++n) {
    const TaskStep& step = task_.file.steps[n];
    const double force_N = step.kind == StepKind::kRemove ? 0 : force_on_step(step);
    // coverage accumulates regardless of the current step
    if (step.kind == StepKind::kCover) cover_patches(n);
    if (done_[n] || (task_.file.ordered && n > 0 && !done_[n - 1])) continue;
    bool done = false;
    if (const auto progress = progress_of(step)) {
      done = progress->achieved >= progress->required;
    } else {
      const bool condition_holds =
          step.kind == StepKind::kVisit
              ? tip_known_ && task_.regions[step.region].contains_point(tip_mm_)
              : !belongs_to_completed_touch(step) && force_N >= step.force_N[0] && force_N <= step.force_N[1];
      step_s_[n] = condition_holds ? step_s_[n] + (step_condition_held_[n] ? dt_s : 0) : 0;
      step_condition_held_[n] = condition_holds;
      // tolerance for rounding of the accumulated time
      constexpr double kRounding_s = 1e-9;
      done = condition_holds && step_s_[n] >= step.seconds - kRounding_s;
    }
    if (!done) continue;
    done_[n] = true;
    if (step.kind == StepKind::kTouch && strongest != nullptr)
      last_completed_touch_ = CompletedTouch{strongest->position_mm, step.region};
    waypoints_mm_.push_back(tip_mm_);
    add_event(TaskEvent::Kind::kStepDone, n, tick, force_N);
  }
}

void TaskEvaluator::update_answer(const DeviceTick& device, double dt_s) {
  const Contact* const strongest = strongest_contact();
  const bool touching = strongest != nullptr && strongest->force_N >= kMinTouch_N;
  if (!touching) {
    resting_ = false;
    return;
  }
  if (!resting_ || (strongest->position_mm - anchor_mm_).norm() > kRestRadius_mm) {
    resting_ = true;
    anchor_mm_ = strongest->position_mm;
    rest_s_ = 0;
    return;
  }
  rest_s_ += dt_s;
  const Eigen::Vector3d normal = vector_of(device.normal_patient);
  if (rest_s_ < task_.file.answer->seconds || !normal.allFinite() || !(normal.norm() > 0.5)) return;
  answered_ = true;
  answer_mm_ = strongest->position_mm;
  answer_normal_ = normal.normalized();
}

double TaskEvaluator::shortest_path_mm() const {
  double straight = 0;
  for (std::size_t n = 1; n < waypoints_mm_.size(); ++n)
    straight += (waypoints_mm_[n] - waypoints_mm_[n - 1]).norm();
  return waypoints_mm_.empty() ? 0 : straight + (tip_mm_ - waypoints_mm_.back()).norm();
}

double TaskEvaluator::value_of(std::size_t n, const Removal& removal) const {
  const auto sum = [](const std::vector<ForceMeter>& meters, double ForceMeter::*figure) {
    double total = 0;
    for (const ForceMeter& meter : meters) total += meter.*figure;
    return total;
  };
  switch (task_.file.metrics[n].metric) {
    case Metric::kTime:
      return begun_ ? time_s_ - started_s_ : kNoValue;
    case Metric::kIdleTime:
      return motion_.idle_s();
    case Metric::kPathLength:
      return motion_.path_mm();
    case Metric::kEconomy:
      return motion_.path_mm() > 0 ? shortest_path_mm() / motion_.path_mm() : kNoValue;
    case Metric::kSmoothness:
      return motion_.smoothness();
    case Metric::kMeanForce:
      return metric_meters_[n].contact_s > 0 ? metric_meters_[n].impulse_Ns / metric_meters_[n].contact_s
                                             : kNoValue;
    case Metric::kPeakForce:
      return metric_meters_[n].peak_N > 0 ? metric_meters_[n].peak_N : kNoValue;
    case Metric::kForceInBand: {
      double in_s = 0, contact_s = 0;
      for (std::size_t f = 0; f < force_meters_.size(); ++f) {
        if (!task_.file.forces[f].band_N) continue;
        in_s += force_meters_[f].in_band_s;
        contact_s += force_meters_[f].contact_s;
      }
      return contact_s > 0 ? in_s / contact_s : kNoValue;
    }
    case Metric::kLongestInBand: {
      double longest = 0;
      for (const ForceMeter& force : force_meters_) longest = std::max(longest, force.longest_s);
      return longest;
    }
    case Metric::kExcessImpulse:
      return sum(force_meters_, &ForceMeter::excess_Ns);
    case Metric::kCoverage: {
      std::size_t covered = 0, count = 0;
      std::vector<bool> counted(task_.regions.size());
      for (const TaskStep& step : task_.file.steps) {
        if (step.kind != StepKind::kCover || counted[step.region]) continue;
        counted[step.region] = true;
        covered += task_.regions[step.region].patches.covered();
        count += task_.regions[step.region].patches.count();
      }
      return count ? static_cast<double>(covered) / static_cast<double>(count) : kNoValue;
    }
    case Metric::kProtectedTime:
      return sum(protection_meters_, &ForceMeter::above_s);
    case Metric::kStepsDone:
      return static_cast<double>(std::count(done_.begin(), done_.end(), true)) /
             static_cast<double>(done_.size());
    case Metric::kAnswerError: {
      if (!answered_) return kNoValue;
      const Eigen::Vector3d off = *task_.answer_mm - answer_mm_;
      return (off - off.dot(answer_normal_) * answer_normal_).norm();
    }
    case Metric::kUnseenTime:
      return unseen_s_;
    case Metric::kRemovedInPlan:
      return removal.in_plan_mm3;
    case Metric::kRemovedOutside:
      return removal.outside_mm3;
    case Metric::kProtectedRemoved:
      return removal.protected_mm3;
    case Metric::kDepthPastPlan:
      return removal.past_plan_mm;
    case Metric::kBoneLeft:
      return removed_ ? bone_left_mm(*task_.distances[n], removed_->removed()) : kNoValue;
    case Metric::kBurrDistance:
      return burr_meters_[n]->nearest_mm();
    case Metric::kForceNear:
      return burr_meters_[n]->peak_N();
    case Metric::kHiddenTime:
      return hidden_s_;
  }
  return kNoValue;
}

TaskScore TaskEvaluator::score(bool cut_short) const {
  TaskScore score;
  score.done = done_;
  score.events = events_;
  score.more_events = more_events_;
  score.ticks = ticks_;
  score.started_s = started_s_;
  score.time_s = time_s_ - started_s_;
  score.ended = ended_;
  // truncation after the end of the run is irrelevant
  score.cut_short = cut_short && !ended_;
  score.missing_s = missing_s_;
  score.hash = hash_;
  // a limit may have been exceeded in a missing tick
  score.in_band = ticks_ > 0 && !score.cut_short && missing_s_ == 0;
  const Removal removal = this->removal();
  for (std::size_t n = 0; n < task_.file.metrics.size(); ++n) {
    const TaskMetric& metric = task_.file.metrics[n];
    MetricValue value{metric.metric, n, value_of(n, removal), metric.counts(), false};
    // comparisons with NaN are false
    value.in_band = (!metric.at_least || value.value >= *metric.at_least) &&
                    (!metric.at_most || value.value <= *metric.at_most);
    if (value.counts && !value.in_band) score.in_band = false;
    hash_double(score.hash, std::isnan(value.value) ? kNoValue : value.value);
    score.metrics.push_back(value);
  }
  score.hash = hash_finish(score.hash);
  return score;
}

double TaskEvaluator::fraction_of_step(std::size_t n) const {
  if (done_[n]) return 1;
  const TaskStep& step = task_.file.steps[n];
  const auto [achieved, required] = progress_of(step).value_or(StepProgress{step_s_[n], step.seconds});
  return required > 0 ? std::clamp(achieved / required, 0.0, 1.0) : 0;
}

}  // namespace palpate
