#include "palpate/palpation/scripted_hand.h"

#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <utility>

#include "palpate/device/rendered_stiffness.h"
#include "palpate/model/changed_model.h"
#include "palpate/palpation/plain_vectors.h"
#include "palpation/scripted_hand_parts.h"
#include "palpation/surface_point.h"

namespace palpate {
using namespace scripted_hand;

namespace {

// time constant of the low-pass filter on the perceived force
constexpr double kForceFilter_s = 0.03;
constexpr double kNormalFilter_s = 0.15;
// Force of a contact without a press, and approach speed. Before a gentle press the contact force is at most
// this fraction of the press's force.
constexpr double kTouch_N = 0.1, kTouchForcePerPressForce = 0.5, kTouchSpeed_mm_s = 8;
// duration of contact with the requested structure that counts as a touch
constexpr double kTouchAfter_s = 0.01;
// duration of contact with another structure after which an approach tries the next site
constexpr double kWrongContactAfter_s = 0.03;
// duration of contact, or inside of a surface, on the path to a site that counts as an obstacle
constexpr double kObstacleAfter_s = 0.25;
// time without contact with the requested structure, or in contact with another one, after which the contact
// counts as lost
constexpr double kContactLostAfter_s = 0.1;
// The hand gives up if the depth exceeds force / stiffness by more than kMaxOver_mm, or kMaxOvershoot of that
// depth if this is more, for kOver_s. It then overshoots by at most 1 mm. In soft tissue the force lags
// behind the depth because of its low-pass filter, hence the relative limit.
constexpr double kMaxOver_mm = 0.7, kMaxOvershoot = 0.4, kOver_s = 0.004;
// distance behind the expected surface after which the surface counts as missing
constexpr double kBehind_mm = 3;

double low_pass(double old, double now, double dt_s, double time_s) {
  return old + (now - old) * std::min(1.0, dt_s / time_s);
}

}  // namespace

namespace scripted_hand {

std::string text_of(const char* format, ...) {
  char text[200];
  va_list values;
  va_start(values, format);
  std::vsnprintf(text, sizeof text, format, values);
  va_end(values);
  return text;
}

}  // namespace scripted_hand

// ---- tick by tick

std::optional<Point<World>> ScriptedHand::next(const TickRecord& tick, double dt_s, HandCommands& commands) {
  if (step_ == steps_.size()) return std::nullopt;
  update_perception(tick, dt_s);
  time_s_ += dt_s;
  // at most one step per tick: the next one begins in the next tick
  const PlannedStep& step = steps_[step_];
  bool done = false;
  if (withdrawing_) {
    // the motor is switched off after a failure
    if (!tries_next_site_ && std::exchange(cutting_, false)) commands.motor = false;
    withdrawing_ = !withdraw(kWithdrawing_mm_s, tick, dt_s);
    done = !withdrawing_ && !tries_next_site_;
  } else if (needs_contact(step.action) && !touching_) {
    done = true;  // the contact that it needs has failed, which was reported together with the skipped steps
  } else {
    done = run_step(step, tick, dt_s, commands);
  }
  step_time_s_ += dt_s;
  if (done) {
    ++step_;
    step_time_s_ = settled_s_ = longest_s_ = slid_mm_ = at_path_end_s_ = sum_Ns_ = turned_s_ = 0;
    deviation_s_ = over_s_ = stuck_s_ = contact_s_ = 0;
    turning_ = tries_next_site_ = false;
    phase_ = Approach::kPlan;
    site_index_ = 0;
    refusal_.clear();
  }
  last_X_WorldPatient_ = X_WorldPatient(tick);
  return commanded_ + tremor();
}

// pose of the patient in the last tick
Transform<World, Patient> ScriptedHand::X_WorldPatient(const TickRecord& tick) const {
  return rotated_object_pose(model_->X_WorldPatient, quaternion(tick.rotation_applied_wxyz));
}

void ScriptedHand::update_perception(const TickRecord& tick, double dt_s) {
  filtered_N_ = low_pass(filtered_N_, norm(tick.device[0].force_N), dt_s, kForceFilter_s);
  const auto& n = tick.device[0].normal_patient;
  const Vector<World> now = X_WorldPatient(tick) * Vector<Patient>(n[0], n[1], n[2]);
  filtered_normal_ = filtered_normal_ + (now - filtered_normal_) * std::min(1.0, dt_s / kNormalFilter_s);
}

// runs one tick of a step; true when the step is done
bool ScriptedHand::run_step(const PlannedStep& step, const TickRecord& tick, double dt_s,
                            HandCommands& commands) {
  struct Visitor {
    ScriptedHand& hand;
    const PlannedStep& step;
    const TickRecord& tick;
    double dt_s;
    HandCommands& commands;
    bool operator()(const ApproachStep&) { return hand.approach(step, tick, dt_s); }
    bool operator()(const PressStep&) { return hand.press(step, tick, dt_s); }
    bool operator()(const HoldStep&) { return hand.hold(step, tick, dt_s); }
    bool operator()(const SlideStep&) { return hand.slide(step, tick, dt_s); }
    bool operator()(const MillStep&) { return hand.mill(step, tick, dt_s); }
    bool operator()(const RotateStep&) { return hand.rotate(step, tick, dt_s, commands.rotation_target); }
    bool operator()(const MethodStep& change) { return hand.change_method(change, tick, dt_s, commands); }
    bool operator()(const MotorStep& motor) { return hand.switch_motor(motor, tick, dt_s, commands); }
    bool operator()(const LawStep&) { return hand.change_law(step, tick, dt_s, commands); }
    bool operator()(const StrokeStep&) { return hand.change_stroke(step, tick, dt_s, commands); }
    bool operator()(const ScopeStep&) { return hand.lead_scope(step, tick, dt_s, commands); }
    bool operator()(const LeaveStep&) { return hand.withdraw_from_contact(step, tick, dt_s); }
  };
  return std::visit(Visitor{*this, step, tick, dt_s, commands}, step.action);
}

// ---- approach

bool ScriptedHand::approach(const PlannedStep& step, const TickRecord& tick, double dt_s) {
  phase_time_s_ += dt_s;
  if (phase_ == Approach::kPlan) return plan(step, tick);
  if (phase_ == Approach::kTouch) return touch(step, tick, dt_s);
  follow_path_to_site(step, tick, dt_s);
  return false;
}

// force that ends this approach; lower if a gentle press follows
double ScriptedHand::touch_of_approach() const {
  for (std::size_t n = step_ + 1; n < steps_.size(); ++n) {
    if (std::holds_alternative<ApproachStep>(steps_[n].action)) break;
    if (const auto* press = std::get_if<PressStep>(&steps_[n].action))
      return std::min(kTouch_N, kTouchForcePerPressForce * press->force_N);
  }
  return kTouch_N;
}

// plans the path to the next place; true if there is none and the step has failed
bool ScriptedHand::plan(const PlannedStep& step, const TickRecord& tick) {
  touch_N_ = touch_of_approach();
  if (touching_) {
    // the script restarts without having left the contact
    touching_ = false;
    tries_next_site_ = withdrawing_ = true;
    begin_withdrawal(tick);
    return false;
  }
  // planned in the patient frame at its current pose, followed at its pose at that time
  const Transform<World, Patient> X = X_WorldPatient(tick);
  const auto& sites = step.sites.sites;
  if (sites.empty()) refusal_ = step.sites.why_none;
  for (; site_index_ < sites.size(); ++site_index_) {
    const TouchSite& site = sites[site_index_];
    approach_path_ = free_space_.path(X.inverse() * commanded_, site.before);
    if (approach_path_.empty()) {
      refusal_ = "there is no free path from the position of the hand";
      continue;
    }
    approach_path_.push_back(site.in_front);
    path_.assign(approach_path_.rbegin(), approach_path_.rend());
    inward_ = X * -site.from;
    target_N_ = contact_s_ = over_s_ = stuck_s_ = phase_time_s_ = 0;
    phase_ = Approach::kFollowPath;
    return false;
  }
  touching_ = false;
  problems_.push_back(named(step) + " failed: " + refusal_ + skipped());
  return true;
}

void ScriptedHand::follow_path_to_site(const PlannedStep& step, const TickRecord& tick, double dt_s) {
  const LabelId touched_label = tick.device[0].label;
  // the surface may protrude beyond the expected place
  if (touched_label == step.structure && path_.size() == 1) {
    approach_path_.resize(approach_path_.size() - path_.size());
    approach_path_.push_back(X_WorldPatient(tick).inverse() * commanded_);
    path_.clear();
  }
  if (path_.empty()) {
    phase_ = Approach::kTouch;
    contact_s_ = over_s_ = phase_time_s_ = 0;
    return;
  }
  const bool inside = (tick.device[0].flags & kFlagInside) != 0;
  contact_s_ = touched_label != 0 || inside ? contact_s_ + dt_s : 0;
  if (const auto over = update_excess_depth(tick, dt_s); over || contact_s_ > kObstacleAfter_s)
    return try_next_site(tick, "on the path the hand touched " +
                                   (touched_label != 0 ? model_->name_of(touched_label) : "something") +
                                   " at " + position_text(point<Patient>(tick.device[0].proxy_patient_mm)));
  if (stuck_s_ > kStuck_s) return try_next_site(tick, "the hand got stuck on the path");
  follow_path(std::get<ApproachStep>(step.action).speed_mm_s, tick, dt_s);
}

// advances slowly until contact
bool ScriptedHand::touch(const PlannedStep& step, const TickRecord& tick, double dt_s) {
  const DeviceTick& device = tick.device[0];
  const Transform<World, Patient> X = X_WorldPatient(tick);
  target_N_ = touch_N_;
  contact_s_ = device.label != 0 ? contact_s_ + dt_s : 0;
  const auto& n = device.normal_patient;
  const Vector<Patient> normal(n[0], n[1], n[2]);
  if (device.label == step.structure && contact_s_ >= kTouchAfter_s) {
    touching_ = true;
    requested_N_ = 0;
    if (normal != Vector<Patient>()) {
      inward_ = X * -normal;
      filtered_normal_ = X * normal;
    }
    const Point<Patient> at = point<Patient>(device.proxy_patient_mm);
    const double above_mm = is_rendered_by_proxy(tick)       ? -model_->tool_of(0).radius_mm
                            : std::isfinite(device.depth_mm) ? device.depth_mm
                                                             : 0;
    touches_.push_back({step.line, model_->name_of(device.label) + model_->enclosing_suffix(device.label),
                        device.label, at + normal * above_mm});
    return true;
  }
  if (device.label != 0 && contact_s_ >= kWrongContactAfter_s) {
    try_next_site(tick, wrong_contact(tick));
    return false;
  }
  if (update_excess_depth(tick, dt_s)) {
    try_next_site(
        tick, "the tip entered without contact at " + position_text(point<Patient>(device.tip_patient_mm)));
    return false;
  }
  const double max_mm = model_->sigma_mm + 2 * tool_reach_mm_ + kBehind_mm;
  const Point<World> front = X * approach_path_.back();
  const double behind_mm = (tip_of(tick) - front).dot(inward_), lead_mm = (commanded_ - front).dot(inward_);
  if (behind_mm > max_mm || lead_mm > max_mm + tracking_tolerance_mm(tick)) {
    try_next_site(tick, "no contact at the expected surface position, " +
                            position_text(step.sites.sites[site_index_].surface.point));
    return false;
  }
  commanded_ += inward_ * (std::min(kTouchSpeed_mm_s, careful_speed_mm_s(step.structure, tick)) * dt_s);
  return false;
}

// retreats, then tries the next place
void ScriptedHand::try_next_site(const TickRecord& tick, const std::string& why) {
  refusal_ = why;
  ++site_index_;
  approach_path_.resize(approach_path_.size() - path_.size());
  phase_ = Approach::kPlan;
  tries_next_site_ = withdrawing_ = true;
  begin_withdrawal(tick);
}

// ---- failures

// stiffness of a structure in the patient frame as rendered; N/mm
double ScriptedHand::stiffness_N_per_mm(LabelId structure, const TickRecord& tick) const {
  const DeviceTick& device = tick.device[0];
  const Tissue& tissue = *model_->tissue_of(structure);
  const double own = is_elastic(law_) && tissue.elastic ? deformable_stiffness_N_per_mm(*tissue.elastic)
                                                        : tissue.stiffness_N_per_mm;
  const RenderedStiffness gains(device);
  const double largest = gains.max_in_patient();
  if (!(largest > 0)) return own;
  if (is_rendered_by_proxy(tick)) return std::min(own, largest);
  const double all =
      model_->max_stiffness_N_per_mm() * static_cast<double>(model_->tool_of(0).points_mm.size());
  return own * gains.direct_method_factor(all);
}

// secant stiffness of an elastic half-space at the target force
double ScriptedHand::deformable_stiffness_N_per_mm(const ElasticConstants& constants) const {
  const ContactLaw half_space{0, {}, contact_modulus_N_per_mm2(constants)};
  const double force_N = std::max(target_N_, touch_N_);
  const SoftContactForce unit = soft_contact_force(half_space, 1, model_->tool_of(0).radius_mm);
  // Hertz contact: depth grows with force to the power 2/3
  return force_N / std::pow(force_N / unit.force_N, 2.0 / 3);
}

// Detects a tip that is deeper than the target force explains, or, during an approach, than the touch force
// does.
std::optional<std::string> ScriptedHand::update_excess_depth(const TickRecord& tick, double dt_s) {
  const DeviceTick& device = tick.device[0];
  const double force_N = limited(std::max(target_N_, touch_N_), tick);
  const LabelId label = device.label != 0 ? device.label : steps_[step_].structure;
  // the proxy reports its spring directly, whatever has been edited since; not valid during a blend
  const bool reported = is_rendered_by_proxy(tick) && (device.flags & kFlagBlend) == 0 &&
                        device.depth_mm > 0 && device.unclamped_force_N > 0;
  const double stiffness = reported ? device.unclamped_force_N / device.depth_mm
                                    : stiffness_N_per_mm(label, tick) * device.force_gain;
  const double explained_mm = force_N / stiffness;
  const double over_mm = std::max(kMaxOver_mm, kMaxOvershoot * explained_mm);
  // too deep for a surface to be found: counts as too deep if in contact
  const bool over =
      std::isnan(device.depth_mm) ? device.label != 0 : device.depth_mm > explained_mm + over_mm;
  over_s_ = over ? over_s_ + dt_s : 0;
  if (over_s_ < kOver_s) return std::nullopt;
  if (force_N < target_N_) return text_of("the limit is %.2f N", force_N);
  if (std::isnan(device.depth_mm)) return "the tip penetrated the surface";
  return text_of("the tip was %.1f mm deep, but %.2f N explain only %.1f mm", device.depth_mm, force_N,
                 explained_mm);
}

std::optional<std::string> ScriptedHand::update_contact_loss(const PlannedStep& step, const TickRecord& tick,
                                                             double dt_s) {
  const DeviceTick& device = tick.device[0];
  deviation_s_ = device.label == step.structure ? 0 : deviation_s_ + dt_s;
  if ((device.flags & kFlagRuptured) != 0) return "the tool punctured a surface";
  if (deviation_s_ > kContactLostAfter_s)
    return device.label == 0 ? "the contact was lost" : wrong_contact(tick);

  // the tip is farther from the intended position than force and friction explain
  const double lag_mm = (tip_of(tick) - commanded_).norm();
  const double force_mm = 1.5e3 * std::max(target_N_, touch_N_) / hand_.stiffness_N_per_m * device.scale;
  if (lag_mm > force_mm + tracking_tolerance_mm(tick) + kPushedAway_mm)
    return text_of("the tip was pushed %.0f mm away from the position of the hand", lag_mm);
  // a person who perceives the loss of contact stops pushing
  if (device.label == 0 && lag_mm > tracking_tolerance_mm(tick)) commanded_ = tip_of(tick);
  return std::nullopt;
}

// description if the mean force of a step deviates from the pressed force
std::optional<std::string> ScriptedHand::force_deviation(double time_s) const {
  const double mean_N = sum_Ns_ / time_s;
  if (requested_N_ == 0 || cutting_ || is_within(mean_N, requested_N_, kHoldTolerance)) return std::nullopt;
  return text_of("mean force %.2f N, asked for %.2f N", mean_N, requested_N_);
}

// reports the reason, and retreats along the path; the following steps are skipped
bool ScriptedHand::fail(const PlannedStep& step, const TickRecord& tick, const std::string& why) {
  const bool contact = touching_;
  problems_.push_back(named(step) + " failed: " + why + (contact ? skipped() : ""));
  touching_ = false;
  if (!contact) return true;
  withdrawing_ = true;
  begin_withdrawal(tick);
  return false;
}

// "script line 8: press of 1.00 N on femur"
std::string ScriptedHand::named(const PlannedStep& step) const {
  struct Visitor {
    std::string structure;
    std::string operator()(const ApproachStep&) const { return "approach to " + structure; }
    std::string operator()(const PressStep& s) const {
      return text_of("press of %.2f N on ", s.force_N) + structure;
    }
    std::string operator()(const HoldStep& s) const {
      return text_of("hold of %.2f s on ", s.seconds) + structure;
    }
    std::string operator()(const SlideStep& s) const {
      return text_of("slide of %.1f mm on ", s.distance_mm) + structure;
    }
    std::string operator()(const MillStep& s) const { return "milling to " + position_text(s.to); }
    std::string operator()(const RotateStep& s) const { return text_of("turn by %.0f degrees", s.degrees); }
    std::string operator()(const MethodStep&) const { return "change of the method"; }
    std::string operator()(const LawStep&) const { return "change of soft tissue's law"; }
    std::string operator()(const MotorStep& s) const { return s.on ? "motor on" : "motor off"; }
    std::string operator()(const StrokeStep& s) const {
      return s.action == StrokeAction::kUndo ? "undoing a stroke" : "redoing a stroke";
    }
    std::string operator()(const ScopeStep&) const { return "scope"; }
    std::string operator()(const LeaveStep&) const { return "leaving " + structure; }
  };
  const std::string structure = step.structure != 0 ? model_->name_of(step.structure) : "";
  return "script line " + std::to_string(step.line) + ": " + std::visit(Visitor{structure}, step.action);
}

// lines of the following steps that need the failed contact
std::string ScriptedHand::skipped() const {
  std::string lines;
  int count = 0;
  for (std::size_t s = step_ + 1; s < steps_.size(); ++s) {
    if (std::holds_alternative<ApproachStep>(steps_[s].action)) break;
    if (!needs_contact(steps_[s].action)) continue;
    lines += (count++ == 0 ? "" : ", ") + std::to_string(steps_[s].line);
  }
  if (count == 0) return "";
  return count == 1 ? "; line " + lines + " is skipped" : "; lines " + lines + " are skipped";
}

std::string ScriptedHand::wrong_contact(const TickRecord& tick) const {
  return "it touched " + model_->name_of(tick.device[0].label) + " instead, at " +
         position_text(point<Patient>(tick.device[0].proxy_patient_mm));
}

}  // namespace palpate
