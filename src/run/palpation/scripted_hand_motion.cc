#include <algorithm>
#include <cmath>

#include "palpate/device/rendered_stiffness.h"
#include "palpate/palpation/plain_vectors.h"
#include "palpation/scripted_hand_parts.h"

namespace palpate {
using namespace scripted_hand;

namespace {

// voluntary force control is slow: hand speed per newton of error; soft tissue is pressed
// faster, so that the error decays at kForceRate
constexpr double kForceGain_mm_per_s_per_N = 15, kForceRate_per_s = 5;
// tolerated lag of the tip behind the commanded position in free motion, beyond the lag by friction
constexpr double kTrackingTolerance_mm = 2.5;
// an unexpected surface is penetrated at most this far at the careful speed; higher speeds need room
constexpr double kCarefulDip_mm = 0.3, kMinCareful_mm_s = 3, kRoom_mm = 2.4;
// retreat: distance beyond the ramp, and maximum wait at the end of the path
constexpr double kExitPathInSigmas = 4, kExitPath_mm = 1, kFollow_s = 1;
// release of a contact: maximum duration, and depth below which the tip moves back along its path
constexpr double kRelease_s = 5, kRelease_mm = 0.3;
// spacing of the corners recorded during a slide
constexpr double kTrail_mm = 1;

}  // namespace

// lag of the tip behind a hand in free motion
double ScriptedHand::tracking_tolerance_mm(const TickRecord& tick) const {
  return 1e3 * device_.coulomb_N / hand_.stiffness_N_per_m * tick.device[0].scale + kTrackingTolerance_mm;
}

// speed at which an unexpected surface is penetrated by at most kCarefulDip before the hand stops
double ScriptedHand::careful_speed_mm_s(LabelId structure, const TickRecord& tick) const {
  const DeviceTick& device = tick.device[0];
  const double wall_N_per_m = 1e3 * RenderedStiffness(device).at_device(stiffness_N_per_mm(structure, tick));
  const double mass_kg = device_.mass_kg + hand_.mass_kg;
  return std::max(kMinCareful_mm_s,
                  kCarefulDip_mm * std::sqrt((hand_.stiffness_N_per_m + wall_N_per_m) / mass_kg));
}

// moves along the remaining path, not ahead of the tip; true at its end
bool ScriptedHand::follow_path(double speed_mm_s, const TickRecord& tick, double dt_s) {
  if ((tip_of(tick) - commanded_).norm() > tracking_tolerance_mm(tick)) {
    stuck_s_ += dt_s;
    return false;
  }
  stuck_s_ = 0;
  const Transform<World, Patient> X = X_WorldPatient(tick);
  const LabelId structure = steps_[step_].structure;
  if (structure != 0) {
    const double clearance_factor =
        std::max(1.0, free_space_.clearance_mm(X.inverse() * commanded_) / kRoom_mm);
    speed_mm_s = std::min(speed_mm_s, careful_speed_mm_s(structure, tick) * clearance_factor);
  }
  double left_mm = speed_mm_s * dt_s;
  while (!path_.empty()) {
    const Point<World> corner = X * path_.back();
    const Vector<World> to_corner = corner - commanded_;
    const double distance_mm = to_corner.norm();
    if (distance_mm > left_mm) {
      commanded_ += to_corner * (left_mm / distance_mm);
      return false;
    }
    commanded_ = corner;
    left_mm -= distance_mm;
    path_.pop_back();
  }
  return true;
}

// moves the intended position along the pressing direction until the target force is perceived
void ScriptedHand::regulate_force(const TickRecord& tick, double dt_s) {
  const DeviceTick& device = tick.device[0];
  const double hand = 1e-3 * hand_.stiffness_N_per_m;
  const double wall = RenderedStiffness(device).at_device(stiffness_N_per_mm(steps_[step_].structure, tick));
  const double rendered_N_per_mm = hand * wall / (hand + wall) / device.scale;
  const double gain = std::max(kForceGain_mm_per_s_per_N, kForceRate_per_s / rendered_N_per_mm);
  const double error_N = limited(std::max(target_N_, touch_N_), tick) - filtered_N_;
  commanded_ += inward_ * (std::clamp(gain * error_N, -kMaxPressing_mm_s, kMaxPressing_mm_s) * dt_s);
}

// presses along the perceived normal, and follows the surface if the object rotates
void ScriptedHand::regulate_contact(const TickRecord& tick, double dt_s) {
  if (filtered_normal_.norm() > 0.5) inward_ = -filtered_normal_.normalized();
  const Point<Patient> at = point<Patient>(tick.device[0].proxy_patient_mm);
  if (last_X_WorldPatient_)
    commanded_ += inward_ * inward_.dot(X_WorldPatient(tick) * at - *last_X_WorldPatient_ * at);
  regulate_force(tick, dt_s);

  // extend the return path by the current position
  const auto& n = tick.device[0].normal_patient;
  const Point<Patient> corner = at + Vector<Patient>(n[0], n[1], n[2]) * (model_->sigma_mm + tool_reach_mm_);
  if (tick.device[0].label == steps_[step_].structure && (corner - approach_path_.back()).norm() > kTrail_mm)
    approach_path_.push_back(corner);
}

void ScriptedHand::begin_withdrawal(const TickRecord& tick) {
  retreat_start_ = tip_of(tick);
  // drop corners that the intended position reached but the tip, held back by contact, did not
  const Point<Patient> tip = X_WorldPatient(tick).inverse() * retreat_start_;
  while (approach_path_.size() > 1) {
    const Vector<Patient> last = approach_path_.back() - approach_path_[approach_path_.size() - 2];
    if ((tip - approach_path_.back()).dot(last) >= 0 || (tip - approach_path_.back()).norm() > kPushedAway_mm)
      break;
    approach_path_.pop_back();
  }
  path_ = approach_path_;
  target_N_ = at_path_end_s_ = stuck_s_ = in_contact_s_ = 0;
}

// Releases the contact first, then retreats along the path at the patient's current pose. True when there is
// no more force, or if that does not happen in time.
bool ScriptedHand::withdraw(double speed_mm_s, const TickRecord& tick, double dt_s) {
  const DeviceTick& device = tick.device[0];
  const Point<World> here = tip_of(tick);
  const double lag_mm = (here - commanded_).norm();
  const bool pressed =
      device.label != 0 && (device.depth_mm > kRelease_mm || lag_mm > tracking_tolerance_mm(tick));
  bool at_its_end = false;
  if (pressed) {
    in_contact_s_ += dt_s;
    const auto& n = device.normal_patient;
    const Vector<World> out = X_WorldPatient(tick) * Vector<Patient>(n[0], n[1], n[2]);
    commanded_ += (out != Vector<World>() ? out : -inward_) * (speed_mm_s * dt_s);
  } else {
    at_its_end = follow_path(speed_mm_s, tick, dt_s);
  }

  // done outside the ramp's range and without force
  const bool ramp_ended =
      (here - retreat_start_).norm() > kExitPathInSigmas * model_->sigma_mm + kExitPath_mm;
  const bool free = free_space_.reachable(X_WorldPatient(tick).inverse() * here);
  if (ramp_ended && free && filtered_N_ < kFree_N) return true;
  at_path_end_s_ += at_its_end ? dt_s : 0;
  return at_path_end_s_ > kFollow_s || stuck_s_ > kStuck_s || in_contact_s_ > kRelease_s;
}

// plans a path to a distance at which the object cannot reach the hand in any rotation; false if there is
// none
bool ScriptedHand::begin_step_back(const TickRecord& tick) {
  path_.clear();
  const Vector<World> from_middle = tip_of(tick) - Point<World>();
  if (from_middle.norm() >= clear_of_object_mm_) return true;
  const Vector<World> out = (from_middle.norm() > 1 ? from_middle : start_ - Point<World>()).normalized();
  const Transform<Patient, World> X = X_WorldPatient(tick).inverse();
  path_ = free_space_.path(X * commanded_, X * (Point<World>() + out * clear_of_object_mm_));
  std::reverse(path_.begin(), path_.end());
  return !path_.empty();
}

}  // namespace palpate
