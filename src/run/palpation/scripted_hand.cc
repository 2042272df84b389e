#include "palpate/palpation/scripted_hand.h"

#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <map>
#include <numbers>
#include <random>
#include <utility>

#include "palpate/device/rendered_stiffness.h"
#include "palpate/model/changed_model.h"
#include "palpate/palpation/plain_vectors.h"
#include "palpation/surface_point.h"

namespace palpate {
namespace {

// voluntary force control is slow: hand speed per newton of error, and maximum speed; soft tissue is pressed
// faster, so that the error decays at kForceRate
constexpr double kForceGain_mm_per_s_per_N = 15, kForceRate_per_s = 5;
constexpr double kMaxPressing_mm_s = 12;
// time constant of the low-pass filter on the perceived force
constexpr double kForceFilter_s = 0.03;
constexpr double kNormalFilter_s = 0.15;
// a press fails if it has not settled kPatience_s after the time that its travel needs; a hold fails
// kHoldPatience_s after its requested duration
constexpr double kPatience_s = 6, kHoldPatience_s = 3;
constexpr double kSettledWithin = 0.1;
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
// tolerated lag of the tip behind the commanded position in free motion, beyond the lag by friction
constexpr double kTrackingTolerance_mm = 2.5;
// distance between tip and commanded position, beyond force and that tolerance, at which the hand gives up
constexpr double kPushedAway_mm = 4;
// time without progress after which the hand counts as stuck
constexpr double kStuck_s = 1;
// an unexpected surface is penetrated at most this far at the careful speed; higher speeds need room
constexpr double kCarefulDip_mm = 0.3, kMinCareful_mm_s = 3, kRoom_mm = 2.4;
// distance behind the expected surface after which the surface counts as missing
constexpr double kBehind_mm = 3;
constexpr std::size_t kMaxTries = 4;
// retreat: distance beyond the ramp, force that counts as free, and maximum wait at the end of the path
constexpr double kExitPathInSigmas = 4, kExitPath_mm = 1, kFree_N = 0.02, kFollow_s = 1;
constexpr double kRelease_s = 5;
constexpr double kWithdrawing_mm_s = 60, kRelease_mm = 0.3;
constexpr double kSteppingBack_mm_s = 100, kStepBack_mm = 5;
// distance from its end at which a milled line is complete
constexpr double kMilled_mm = 0.4;
// spacing of the corners recorded during a slide
constexpr double kTrail_mm = 1;
// threshold of a direction's tangential component below which sliding is impossible
constexpr double kMinAlong = 0.1;

std::string text_of(const char* format, ...) __attribute__((format(printf, 1, 2)));
std::string text_of(const char* format, ...) {
  char text[200];
  va_list values;
  va_start(values, format);
  std::vsnprintf(text, sizeof text, format, values);
  va_end(values);
  return text;
}

std::string position_text(const Point<Patient>& p) {
  return text_of("%.1f, %.1f, %.1f mm", p.x(), p.y(), p.z());
}

// structure by name, or by label as "#95"
Result<LabelId> find_structure(const Model& model, const std::string& name, const std::string& where) {
  const auto is_named = [&](const Segment& segment) {
    return segment.name == name && model.is_touchable(segment.id);
  };
  const auto count = std::count_if(model.segments.begin(), model.segments.end(), is_named);
  if (count > 1) {
    std::string ids;
    for (const Segment& segment : model.segments)
      if (is_named(segment)) ids += (ids.empty() ? "\"#" : ", \"#") + std::to_string(segment.id) + "\"";
    return Error{ErrorKind::kBadInput,
                 std::to_string(count) + " structures of this scene are named '" + name + "'", where,
                 "choose one by its number: " + ids};
  }
  const auto one = std::find_if(model.segments.begin(), model.segments.end(), is_named);
  const Segment* segment = one != model.segments.end() ? &*one : model.find(name);
  if (!segment && name.size() > 1 && name[0] == '#' &&
      name.find_first_not_of("0123456789", 1) == std::string::npos && name.size() < 7)
    segment = model.find(static_cast<LabelId>(std::stoi(name.substr(1))));
  if (segment) return segment->id;
  std::string known;
  for (const Segment& s : model.segments)
    if (model.is_touchable(s.id))
      known += (known.empty() ? "" : ", ") + (s.name.empty() ? "#" + std::to_string(s.id) : s.name);
  return Error{ErrorKind::kBadInput, "no structure '" + name + "' in this scene", where,
               "touchable structures are: " + known};
}

// a subsample of the voxel centres on a structure's border
std::vector<Point<Patient>> some_of_border(const Model& model, LabelId structure) {
  constexpr std::size_t kMaxPoints = 2000;
  const auto X_PatientVoxel = model.labels->geometry().X_PatientVoxel();
  std::vector<Point<Patient>> border;
  model.labels->for_each_piece([&](const RowPiece<LabelId>& piece) {
    if (piece.uniform) return;
    for (int n = 0; n < piece.count; ++n) {
      const LabelId* const voxel = piece.voxels + n;
      if (*voxel != structure) continue;
      const auto& faces = BrickLayout::kFaces;
      if (std::any_of(faces.begin(), faces.end(), [&](auto face) { return voxel[face] != structure; }))
        border.push_back(X_PatientVoxel * Point<Voxel>(piece.i + n, piece.j, piece.k));
    }
  });
  const std::size_t stride = border.size() / kMaxPoints + 1;
  std::vector<Point<Patient>> some;
  for (std::size_t b = 0; b < border.size(); b += stride) some.push_back(border[b]);
  return some;
}

template <class Frame>
Point<Frame> point(const std::array<double, 3>& p) {
  return {p[0], p[1], p[2]};
}

Point<World> tip_of(const TickRecord& tick) {
  return point<World>(tick.device[0].tip_world_mm);
}

// After a cut the surfaces of tissue can no longer be changed, and a script cannot know when the first cut
// happens.
Result<void> check_law(const Model& model, TissueLaw law, const std::string& where) {
  if (model.has_burr() && has_other_surfaces(model, law))
    return Error{ErrorKind::kBadInput,
                 "soft tissue cannot change between yielding and not yielding in a scene with a cutting tool",
                 where, "set the law in the scene's [yielding], so that it applies from the start"};
  if (model.has_burr() && is_moving(law) && !is_moving(model.tissue_law))
    return Error{ErrorKind::kBadInput, "soft tissue cannot start to move in a scene with a cutting tool",
                 where, "set the law in the scene's [yielding], so that it moves from the start"};
  const auto fine = palpate::check_law(model, law);
  if (fine) return {};
  Error error = fine.error();
  error.where = where;
  return error;
}

double low_pass(double old, double now, double dt_s, double time_s) {
  return old + (now - old) * std::min(1.0, dt_s / time_s);
}

// clamped to the force limit of that tick; a tick with a fault has none
double limited(double force_N, const TickRecord& tick) {
  const double limit_N = tick.device[0].limit_N;
  return limit_N > 0 ? std::min(force_N, limit_N) : force_N;
}

bool is_rendered_by_proxy(const TickRecord& tick) {
  return tick.method == static_cast<std::uint8_t>(ForceMethod::kProxy) &&
         (tick.device[0].flags & kFlagMethodMissing) == 0;
}

bool is_within(double force_N, double requested_N, double part) {
  return std::abs(force_N - requested_N) <= part * requested_N;
}

}  // namespace

// ---- planning

Result<ScriptedHand> ScriptedHand::create(const Model& model, const Script& script) {
  if (model.field == nullptr)
    return Error{ErrorKind::kBadInput, "the model has no field for a simulated hand to plan its places in",
                 "model", "prepare it for a direct method as well"};
  const auto device = find_plant_device(script.device);
  if (!device) return device.error();
  const auto grip = find_plant_hand(script.hand);
  if (!grip) return grip.error();
  ScriptedHand hand(model, script, *device, *grip);
  LabelId structure = 0;
  for (std::size_t s = 0; s < script.steps.size(); ++s) {
    auto step = hand.planned(script.steps[s], script.lines[s], structure,
                             script.source + ":" + std::to_string(script.lines[s]));
    if (!step) return step.error();
    structure = step->structure;
    hand.steps_.push_back(*std::move(step));
  }
  return hand;
}

/// @param before  structure of the preceding approach
Result<ScriptedHand::PlannedStep> ScriptedHand::planned(const ScriptStep& action, int line, LabelId before,
                                                        const std::string& where) {
  PlannedStep step{action, line, before, {}};
  if (const auto* change = std::get_if<LawStep>(&action))
    if (auto fine = check_law(*model_, change->law, where); !fine) return fine.error();
  const auto* approach = std::get_if<ApproachStep>(&action);
  if (!approach) return step;

  TouchRequest request;
  request.clearance_mm = approach->clearance_mm;
  request.landmark = approach->landmark;
  request.from = approach->from;
  if (approach->point) {
    step.structure = contact_structure_near(*model_, *approach->point);
    if (step.structure == 0)
      return Error{ErrorKind::kBadInput,
                   "no touchable structure within 5 mm of the point " + position_text(*approach->point),
                   where, "give a point on a surface, in patient coordinates (mm, LPS), or name a structure"};
    request.near = {*approach->point};
  } else {
    const auto label = find_structure(*model_, approach->structure, where);
    if (!label) return label.error();
    step.structure = *label;
  }
  if (!model_->is_touchable(step.structure))
    return Error{ErrorKind::kBadInput,
                 "'" + model_->name_of(step.structure) + "' is not touchable in this scene", where,
                 "set touchable = true on its [[tissue]], or choose another structure"};
  if (const auto* other = std::get_if<std::string>(&approach->nearest)) {
    const auto label = find_structure(*model_, *other, where);
    if (!label) return label.error();
    request.near = some_of_border(*model_, *label);
  }
  if (const auto* site = std::get_if<Point<Patient>>(&approach->nearest)) request.near = {*site};
  step.sites = find_touch_sites(*model_, free_space_, step.structure, request);
  if (step.sites.sites.size() > kMaxTries) step.sites.sites.resize(kMaxTries);
  return step;
}

ScriptedHand::ScriptedHand(const Model& model, const Script& script, const PlantDevice& device,
                           const PlantHand& hand)
    : model_(&model),
      device_(device),
      hand_(hand),
      law_(model.tissue_law),
      free_space_(model, tool_reach_mm(model.tool_of(0))),
      tool_reach_mm_(tool_reach_mm(model.tool_of(0))) {
  // in the air, a hand's breadth in front of the patient
  const GridGeometry& grid = model.labels->geometry();
  double max_anterior_mm = grid.centre().y();
  for (int corner = 0; corner < 8; ++corner) {
    Point<Voxel> p;
    for (int axis = 0; axis < 3; ++axis) p[axis] = corner >> axis & 1 ? grid.dims[axis] - 0.5 : -0.5;
    const Point<Patient> at = grid.X_PatientVoxel() * p;
    max_anterior_mm = std::min(max_anterior_mm, at.y());
    clear_of_object_mm_ = std::max(clear_of_object_mm_, (model.X_WorldPatient * at - Point<World>()).norm());
  }
  clear_of_object_mm_ += tool_reach_mm_ + kStepBack_mm;
  constexpr double kBefore_mm = 3;
  start_ =
      model.X_WorldPatient *
      Point<Patient>(grid.centre().x(), max_anterior_mm - kBefore_mm - tool_reach_mm_, grid.centre().z());
  commanded_ = start_;

  std::mt19937_64 random(script.seed);
  const auto uniform = [&] { return static_cast<double>(random() >> 11) * 0x1p-53; };
  for (auto& axis : tremor_)
    for (Wave& wave : axis)
      wave = {script.tremor_mm / 3, 2 * std::numbers::pi * (8 + 4 * uniform()),
              2 * std::numbers::pi * uniform()};
}

std::vector<HoldRequest> ScriptedHand::requested() const {
  std::vector<HoldRequest> holds;
  const auto of = [&](LabelId structure) -> HoldRequest& {
    const auto found = std::find_if(holds.begin(), holds.end(),
                                    [&](const HoldRequest& a) { return a.structure == structure; });
    return found != holds.end() ? *found : holds.emplace_back(HoldRequest{structure, {}});
  };
  for (const PlannedStep& step : steps_) {
    if (std::holds_alternative<ApproachStep>(step.action)) of(step.structure);
    if (const auto* press = std::get_if<PressStep>(&step.action))
      of(step.structure).forces_N.push_back(press->force_N);
  }
  return holds;
}

Vector<World> ScriptedHand::tremor() const {
  Vector<World> sum;
  for (int axis = 0; axis < 3; ++axis)
    for (const Wave& wave : tremor_[axis])
      sum[axis] += wave.amplitude_mm * std::sin(wave.omega * time_s_ + wave.phase);
  return sum;
}

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
    step_time_s_ = settled_s_ = longest_s_ = slid_mm_ = left_s_ = sum_Ns_ = turned_s_ = 0;
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
  const LabelId encountered = tick.device[0].label;
  // the surface may protrude beyond the expected place
  if (encountered == step.structure && path_.size() == 1) {
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
  contact_s_ = encountered != 0 || inside ? contact_s_ + dt_s : 0;
  if (const auto over = update_excess_depth(tick, dt_s); over || contact_s_ > kObstacleAfter_s)
    return try_next_site(tick, "on the path the hand touched " +
                                   (encountered != 0 ? model_->name_of(encountered) : "something") + " at " +
                                   position_text(point<Patient>(tick.device[0].proxy_patient_mm)));
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

// ---- contact

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
  const Vector<World> way = end - commanded_;
  const double length_mm = way.norm(), step_mm = action.speed_mm_s * dt_s;
  commanded_ = length_mm > step_mm ? commanded_ + way * (step_mm / length_mm) : end;
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
  const LabelId encountered = device.label != 0 ? device.label : steps_[step_].structure;
  // the proxy reports its spring directly, whatever has been edited since; not valid during a blend
  const bool reported = is_rendered_by_proxy(tick) && (device.flags & kFlagBlend) == 0 &&
                        device.depth_mm > 0 && device.unclamped_force_N > 0;
  const double stiffness = reported ? device.unclamped_force_N / device.depth_mm
                                    : stiffness_N_per_mm(encountered, tick) * device.force_gain;
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

// ---- motion

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
    const double room = std::max(1.0, free_space_.clearance_mm(X.inverse() * commanded_) / kRoom_mm);
    speed_mm_s = std::min(speed_mm_s, careful_speed_mm_s(structure, tick) * room);
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
  target_N_ = left_s_ = stuck_s_ = pressed_s_ = 0;
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
    pressed_s_ += dt_s;
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
  left_s_ += at_its_end ? dt_s : 0;
  return left_s_ > kFollow_s || stuck_s_ > kStuck_s || pressed_s_ > kRelease_s;
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
