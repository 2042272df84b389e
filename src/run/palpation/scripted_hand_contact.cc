#include <algorithm>
#include <cmath>
#include <numbers>

#include "palpate/palpation/plain_vectors.h"
#include "palpation/scripted_hand_parts.h"

namespace palpate {
using namespace scripted_hand;

namespace {

// a press fails if it has not settled kPatience_s after the time that its travel needs; a hold fails
// kHoldPatience_s after its requested duration
constexpr double kPatience_s = 6, kHoldPatience_s = 3;
constexpr double kSettledWithin = 0.1;
// distance from its end at which a milled line is complete
constexpr double kMilled_mm = 0.4;
// threshold of a direction's tangential component below which sliding is impossible
constexpr double kMinAlong = 0.1;
constexpr double kSteppingBack_mm_s = 100;

}  // namespace

bool ScriptedHand::press(const PlannedStep& step, const TickRecord& tick, double dt_s) {
  const auto& action = std::get<PressStep>(step.action);
  target_N_ = requested_N_ = action.force_N;
  if (const auto over = update_excess_depth(tick, dt_s)) return fail(step, tick, *over);
  if (const auto why = update_contact_loss(step, tick, dt_s)) return fail(step, tick, *why);
  regulate_contact(tick, dt_s);
  const bool at_force = tick.device[0].label == step.structure &&
                        (cutting_ || is_within(filtered_N_, requested_N_, kSettledWithin));
  settled_s_ = at_force ? settled_s_ + dt_s : 0;
  if (at_force && settled_s_ >= action.settle_s) return true;

  const double soft_N_per_mm = stiffness_N_per_mm(step.structure, tick) * tick.device[0].force_gain;
  const double travel_s =
      requested_N_ * (1e3 / hand_.stiffness_N_per_m + 1 / soft_N_per_mm) / kMaxPressing_mm_s;
  if (step_time_s_ < kPatience_s + action.settle_s + travel_s) return false;
  return fail(step, tick, text_of("the force did not settle: %.2f N measured", filtered_N_));
}

bool ScriptedHand::hold(const PlannedStep& step, const TickRecord& tick, double dt_s) {
  const auto& action = std::get<HoldStep>(step.action);
  if (const auto over = update_excess_depth(tick, dt_s)) return fail(step, tick, *over);
  if (const auto why = update_contact_loss(step, tick, dt_s)) return fail(step, tick, *why);
  regulate_contact(tick, dt_s);
  const double force_N = norm(tick.device[0].force_N);
  const bool is_settled = tick.device[0].label == step.structure &&
                          (requested_N_ == 0 || cutting_ || is_within(force_N, requested_N_, kHoldTolerance));
  settled_s_ = is_settled ? settled_s_ + dt_s : 0;
  longest_s_ = std::max(longest_s_, settled_s_);
  if (settled_s_ >= action.seconds - 0.5 * dt_s) return true;
  if (step_time_s_ < action.seconds + kHoldPatience_s) return false;
  return fail(step, tick,
              text_of("held for %.2f s without interruption, requested %.2f N, measured %.2f N", longest_s_,
                      requested_N_, filtered_N_));
}

bool ScriptedHand::slide(const PlannedStep& step, const TickRecord& tick, double dt_s) {
  const auto& action = std::get<SlideStep>(step.action);
  if (const auto over = update_excess_depth(tick, dt_s))
    return fail(step, tick, "unexpected obstacle: " + *over);
  if (const auto why = update_contact_loss(step, tick, dt_s)) return fail(step, tick, *why);
  const Transform<World, Patient> X = X_WorldPatient(tick);
  const Vector<World> direction = (X * action.direction).normalized();
  const Vector<World> along = direction - inward_ * inward_.dot(direction);
  if (along.norm() < kMinAlong) return fail(step, tick, "its direction points out of the surface");

  // measured by the contact point, not by the hand
  const Point<Patient> here = point<Patient>(tick.device[0].proxy_patient_mm);
  if (step_time_s_ > 0) slid_mm_ += (X * (here - contact_)).dot(along.normalized());
  contact_ = here;
  sum_Ns_ += norm(tick.device[0].force_N) * dt_s;
  regulate_contact(tick, dt_s);
  if (slid_mm_ >= action.distance_mm) {
    const auto deviation = force_deviation(step_time_s_ + dt_s);
    return deviation ? fail(step, tick, *deviation) : true;
  }
  const double speed_mm_s = std::min(action.speed_mm_s, careful_speed_mm_s(step.structure, tick));
  commanded_ += along.normalized() * (speed_mm_s * dt_s);
  if (step_time_s_ < action.distance_mm / speed_mm_s + kPatience_s) return false;
  return fail(step, tick, text_of("it advanced %.1f mm", slid_mm_));
}

// The intended position advances along the line, not farther ahead of the tip than the force allows. The step
// is done when the head has arrived.
bool ScriptedHand::mill(const PlannedStep& step, const TickRecord& tick, double dt_s) {
  const auto& action = std::get<MillStep>(step.action);
  if (!cutting_) return fail(step, tick, "the motor is not running");
  const Transform<World, Patient> X = X_WorldPatient(tick);
  const Point<World> end = X * action.to;
  const double left_mm = (point<Patient>(tick.device[0].proxy_patient_mm) - action.to).norm();
  if (left_mm < kMilled_mm) {
    // in free space the milled path is not needed for the withdrawal
    if (free_space_.reachable(action.to)) approach_path_.clear();
    approach_path_.push_back(action.to);
    return true;
  }
  const Vector<World> displacement = end - commanded_;
  const double length_mm = displacement.norm(), step_mm = action.speed_mm_s * dt_s;
  commanded_ = length_mm > step_mm ? commanded_ + displacement * (step_mm / length_mm) : end;
  const double lead_mm =
      (1e3 * (limited(action.force_N, tick) + device_.coulomb_N) / hand_.stiffness_N_per_m) *
      tick.device[0].scale;
  const Vector<World> ahead = commanded_ - tip_of(tick);
  if (ahead.norm() > lead_mm) commanded_ = tip_of(tick) + ahead * (lead_mm / ahead.norm());
  slid_mm_ = step_time_s_ > 0 ? slid_mm_ : left_mm;
  if (step_time_s_ < slid_mm_ / action.speed_mm_s + kPatience_s) return false;
  return fail(step, tick, text_of("it is still %.1f mm away", left_mm));
}

bool ScriptedHand::rotate(const PlannedStep& step, const TickRecord& tick, double dt_s,
                          Eigen::Quaterniond& target) {
  const auto& action = std::get<RotateStep>(step.action);
  if (touching_) {
    if (const auto over = update_excess_depth(tick, dt_s)) return fail(step, tick, *over);
    if (const auto why = update_contact_loss(step, tick, dt_s)) return fail(step, tick, *why);
    sum_Ns_ += norm(tick.device[0].force_N) * dt_s;
    regulate_contact(tick, dt_s);
  } else if (!turning_) {
    // step back, so that the rotating object does not hit the hand
    if (step_time_s_ == 0 && !begin_step_back(tick))
      return fail(step, tick, "there is no free path to move back");
    if (!follow_path(kSteppingBack_mm_s, tick, dt_s))
      return stuck_s_ > kStuck_s && fail(step, tick, "the hand got stuck");
  }
  if (!turning_) rotation_start_ = target;
  turning_ = true;

  // a command every tenth of a second, as a second person at a viewer would send
  const double commanded_s =
      std::floor(turned_s_ / kRotationSettings.interval_s + 1e-9) * kRotationSettings.interval_s;
  const double part = std::min(1.0, commanded_s / action.seconds);
  const double radians = action.degrees * std::numbers::pi / 180 * part;
  target = Eigen::Quaterniond(Eigen::AngleAxisd(radians, action.axis_world.normalized())) * rotation_start_;
  turned_s_ += dt_s;
  if (turned_s_ < action.seconds + kRotationSettings.interval_s) return false;
  const auto deviation = touching_ ? force_deviation(turned_s_) : std::nullopt;
  return deviation ? fail(step, tick, *deviation) : true;
}

bool ScriptedHand::change_method(const MethodStep& change, const TickRecord& tick, double dt_s,
                                 HandCommands& commands) {
  if (touching_) regulate_contact(tick, dt_s);
  commands.method = change.method;
  return true;
}

// Waits until the law takes effect, which may require new surfaces, then until the force of the new law is
// fully blended in and the stiffer tissue has pushed the hand out to the depth of its pressing force.
bool ScriptedHand::change_law(const PlannedStep& step, const TickRecord& tick, double dt_s,
                              HandCommands& commands) {
  constexpr double kMaxWait_s = 300, kBriefly_s = 0.05, kMaxPush_s = 3;
  if (touching_) regulate_contact(tick, dt_s);
  const TissueLaw law = std::get<LawStep>(step.action).law;
  if (step_time_s_ == 0) {
    commands.law = law;
    return false;
  }
  if (commands.law_version == 0u) return fail(step, tick, "its surfaces could not be prepared");
  if (commands.law_version && tick.model_version >= *commands.law_version) {
    law_ = law;
    settled_s_ += dt_s;
    if (!touching_ || settled_s_ >= kMaxPush_s) return true;
    (void)update_excess_depth(tick, dt_s);  // for over_s_ below
    const bool is_blending = (tick.device[0].flags & kFlagBlend) != 0;
    return settled_s_ >= kBriefly_s && !is_blending && over_s_ == 0;
  }
  return step_time_s_ + dt_s >= kMaxWait_s && fail(step, tick, "its surfaces were not prepared in time");
}

// the second hand moves while this one rests
bool ScriptedHand::lead_scope(const PlannedStep& step, const TickRecord& tick, double dt_s,
                              HandCommands& commands) {
  constexpr double kMaxWait_s = 20;
  if (touching_) regulate_contact(tick, dt_s);
  if (step_time_s_ == 0) {
    commands.scope = std::get<ScopeStep>(step.action);
    return false;
  }
  if (commands.scope_is_there) return true;
  return step_time_s_ + dt_s >= kMaxWait_s && fail(step, tick, "it did not arrive in time");
}

bool ScriptedHand::switch_motor(const MotorStep& motor, const TickRecord& tick, double dt_s,
                                HandCommands& commands) {
  if (touching_) regulate_contact(tick, dt_s);
  cutting_ = motor.on;
  commands.motor = motor.on;
  return true;
}

// Waits for the last cuts of the stroke before the request.
bool ScriptedHand::change_stroke(const PlannedStep& step, const TickRecord& tick, double dt_s,
                                 HandCommands& commands) {
  constexpr double kCarved_s = 0.2, kMaxWait_s = 2;
  if (touching_) regulate_contact(tick, dt_s);
  if (cutting_) return fail(step, tick, "the motor is running");
  const double now_s = step_time_s_ + dt_s;
  if (step_time_s_ < kCarved_s) {
    if (now_s >= kCarved_s) commands.stroke = std::get<StrokeStep>(step.action).action;
    return false;
  }
  if (commands.stroke_version == 0u) return fail(step, tick, "there is no stroke");
  if (commands.stroke_version && tick.model_version >= *commands.stroke_version) return true;
  return now_s >= kMaxWait_s && fail(step, tick, "it was not done in time");
}

bool ScriptedHand::withdraw_from_contact(const PlannedStep& step, const TickRecord& tick, double dt_s) {
  if (step_time_s_ == 0) begin_withdrawal(tick);
  if (!withdraw(std::get<LeaveStep>(step.action).speed_mm_s, tick, dt_s)) return false;
  touching_ = false;
  if (filtered_N_ >= kFree_N)
    problems_.push_back(named(step) + text_of(" failed: still %.2f N", filtered_N_));
  return true;
}

}  // namespace palpate
