#include "session/scripted_hand.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <random>

namespace palpate {
namespace {

// voluntary control of force is slow: speed of the hand per newton of error, and its most
constexpr double kForceGain_mm_s_N = 15;
constexpr double kMostPressing_mm_s = 12;
// what a person feels is low-passed
constexpr double kFeeling_s = 0.03;
constexpr double kNormalFeeling_s = 0.15;
// a press that has not settled by then is given up
constexpr double kPatience_s = 6;
constexpr double kSettledWithin = 0.1;
// how deep below the surface a press is given up
constexpr double kMostDepthInSigmas = 2, kMostDepth_mm = 2;
// leaving: so far that the ramp has ended, what counts as free, and how long the tip may lag behind
constexpr double kWayOutInSigmas = 4, kWayOut_mm = 1, kFree_N = 0.02, kFollow_s = 1;

// a name, or "#95"
Result<LabelId> find_structure(const Model& model, const std::string& name, const std::string& where) {
  if (const Segment* segment = model.find(name)) return segment->id;
  if (name.size() > 1 && name[0] == '#' && name.find_first_not_of("0123456789", 1) == std::string::npos &&
      name.size() < 7)
    if (const Segment* segment = model.find(static_cast<LabelId>(std::stoi(name.substr(1)))))
      return segment->id;
  std::string known;
  for (const Segment& segment : model.segments)
    if (model.is_felt(segment.id))
      known += (known.empty() ? "" : ", ") +
               (segment.name.empty() ? "#" + std::to_string(segment.id) : segment.name);
  return Error{ErrorKind::kBadInput, "no structure '" + name + "' in this scene", where,
               "felt structures are: " + known};
}

// the force a device displays, in its last report
double sent_N(const TickRecord& felt) {
  const auto& f = felt.device[0].force_N;
  return std::sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]);
}

double low_pass(double old, double now, double dt_s, double time_s) {
  return old + (now - old) * std::min(1.0, dt_s / time_s);
}

}  // namespace

Result<ScriptedHand> ScriptedHand::create(const Model& model, const Script& script) {
  ScriptedHand hand(model, script);
  std::map<LabelId, SurfacePoint> found;
  LabelId structure = 0;
  for (std::size_t s = 0; s < script.steps.size(); ++s) {
    PlannedStep step{script.steps[s], script.lines[s], structure, {}};
    const std::string where = script.source + ":" + std::to_string(step.line);
    if (const auto* approach = std::get_if<ApproachStep>(&step.action)) {
      const auto label = find_structure(model, approach->structure, where);
      if (!label) return label.error();
      structure = step.structure = *label;
      if (!found.contains(structure)) {
        auto surface = find_surface_point(model, structure, approach->clearance_mm);
        if (!surface) {
          Error error = surface.error();
          error.where = where;
          return error;
        }
        found[structure] = *surface;
        hand.structures_.push_back(structure);
      }
    }
    if (structure != 0) step.surface = found[structure];
    hand.steps_.push_back(std::move(step));
  }
  return hand;
}

ScriptedHand::ScriptedHand(const Model& model, const Script& script) : model_(&model), free_space_(model) {
  // in the air, a hand's breadth in front of the patient
  const GridGeometry& grid = model.labels->geometry();
  double most_anterior_mm = grid.centre().y();
  for (int corner = 0; corner < 8; ++corner) {
    Point<Voxel> p;
    for (int axis = 0; axis < 3; ++axis) p[axis] = corner >> axis & 1 ? grid.dims[axis] - 1 : 0;
    most_anterior_mm = std::min(most_anterior_mm, (grid.X_PatientVoxel() * p).y());
  }
  start_ = model.X_WorldPatient * Point<Patient>(grid.centre().x(), most_anterior_mm - 3, grid.centre().z());
  intention_ = start_;

  std::mt19937_64 random(script.seed);
  const auto uniform = [&] { return static_cast<double>(random() >> 11) * 0x1p-53; };
  for (auto& axis : tremor_)
    for (Wave& wave : axis)
      wave = {script.tremor_mm / 3, 2 * std::numbers::pi * (8 + 4 * uniform()),
              2 * std::numbers::pi * uniform()};
}

Vector<World> ScriptedHand::tremor() const {
  Vector<World> sum;
  for (int axis = 0; axis < 3; ++axis)
    for (const Wave& wave : tremor_[axis])
      sum[axis] += wave.amplitude_mm * std::sin(wave.omega * time_s_ + wave.phase);
  return sum;
}

std::optional<Point<World>> ScriptedHand::next(const TickRecord& felt, double dt_s, HandCommands& commands) {
  if (step_ == steps_.size()) return std::nullopt;
  feel(felt, dt_s);
  time_s_ += dt_s;
  // one step a tick: the next one begins in the next tick
  const bool done = run_step(steps_[step_], felt, dt_s, commands);
  step_time_s_ += dt_s;
  if (done) {
    ++step_;
    step_time_s_ = settled_s_ = slid_mm_ = left_s_ = 0;
  }
  return intention_ + tremor();
}

// where the patient lies now, as it was felt in the last tick
Transform<World, Patient> ScriptedHand::X_WorldPatient(const TickRecord& felt) const {
  const auto& q = felt.rotation_felt_wxyz;
  const Rotation<World, World> turn(Eigen::Quaterniond(q[0], q[1], q[2], q[3]));
  return Transform<World, World>(turn, Vector<World>()) * model_->X_WorldPatient;
}

void ScriptedHand::feel(const TickRecord& felt, double dt_s) {
  felt_N_ = low_pass(felt_N_, sent_N(felt), dt_s, kFeeling_s);
  const auto& n = felt.device[0].normal_patient;
  const Vector<World> now = X_WorldPatient(felt) * Vector<Patient>(n[0], n[1], n[2]);
  felt_normal_ = felt_normal_ + (now - felt_normal_) * std::min(1.0, dt_s / kNormalFeeling_s);
}

// one tick of a step; true when the step is done
bool ScriptedHand::run_step(const PlannedStep& step, const TickRecord& felt, double dt_s,
                            HandCommands& commands) {
  struct Visitor {
    ScriptedHand& hand;
    const PlannedStep& step;
    const TickRecord& felt;
    double dt_s;
    HandCommands& commands;
    bool operator()(const ApproachStep&) { return hand.approach(step, felt, dt_s); }
    bool operator()(const PressStep&) { return hand.press(step, felt, dt_s); }
    bool operator()(const HoldStep& hold) {
      hand.keep_force(dt_s);
      return hand.step_time_s_ >= hold.seconds;
    }
    bool operator()(const SlideStep& slide) { return hand.slide(slide, felt, dt_s); }
    bool operator()(const RotateStep& rotate) { return hand.rotate(rotate, dt_s, commands.rotation_target); }
    bool operator()(const MethodStep& change) {
      hand.keep_force(dt_s);
      commands.method = change.method;
      return true;
    }
    bool operator()(const LeaveStep&) { return hand.leave(step, felt, dt_s); }
  };
  return std::visit(Visitor{*this, step, felt, dt_s, commands}, step.action);
}

// along the corners of the way; true when its end is reached
bool ScriptedHand::walk(double speed_mm_s, double dt_s) {
  double left_mm = speed_mm_s * dt_s;
  while (!way_.empty()) {
    const Vector<World> to_corner = way_.back() - intention_;
    const double distance_mm = to_corner.norm();
    if (distance_mm > left_mm) {
      intention_ += to_corner * (left_mm / distance_mm);
      return false;
    }
    intention_ = way_.back();
    left_mm -= distance_mm;
    way_.pop_back();
  }
  return true;
}

bool ScriptedHand::approach(const PlannedStep& step, const TickRecord& felt, double dt_s) {
  const auto& action = std::get<ApproachStep>(step.action);
  if (step_time_s_ == 0) {
    // planned in the patient as it lies now, walked in the workspace
    const Transform<World, Patient> X = X_WorldPatient(felt);
    const SurfacePoint& surface = step.surface;
    const Point<Patient> before =
        surface.point + surface.normal * std::min(surface.clearance_mm, action.clearance_mm);
    std::vector<Point<Patient>> way = free_space_.path(X.inverse() * intention_, before);
    if (way.empty()) {
      trouble_.push_back("script line " + std::to_string(step.line) + ": no free way to " +
                         model_->name_of(step.structure) + "; the straight one was taken");
      way = {before};
    }
    way.push_back(surface.point + surface.normal * model_->sigma_mm);
    way_in_ = way;
    way_.clear();
    for (auto corner = way.rbegin(); corner != way.rend(); ++corner) way_.push_back(X * *corner);
    inward_ = X * -surface.normal;
    wanted_N_ = 0;
  }
  return walk(action.speed_mm_s, dt_s);
}

// moves the intention along the pressing direction until the wanted force is felt
void ScriptedHand::keep_force(double dt_s) {
  const double speed =
      std::clamp(kForceGain_mm_s_N * (wanted_N_ - felt_N_), -kMostPressing_mm_s, kMostPressing_mm_s);
  intention_ += inward_ * (speed * dt_s);
}

// says what was not reached, and stops pressing where the tip is
void ScriptedHand::give_up(const PlannedStep& step, const TickRecord& felt, const std::string& why) {
  char text[80];
  std::snprintf(text, sizeof text, ": asked for %.2f N, felt %.2f N on ", wanted_N_, felt_N_);
  trouble_.push_back("script line " + std::to_string(step.line) + text + model_->name_of(step.structure) +
                     "; " + why);
  const auto& tip = felt.device[0].tip_world_mm;
  intention_ = Point<World>(tip[0], tip[1], tip[2]);
  wanted_N_ = 0;
}

bool ScriptedHand::press(const PlannedStep& step, const TickRecord& felt, double dt_s) {
  const auto& action = std::get<PressStep>(step.action);
  wanted_N_ = action.force_N;
  keep_force(dt_s);
  const bool at_force = std::abs(felt_N_ - wanted_N_) <= kSettledWithin * wanted_N_;
  settled_s_ = at_force ? settled_s_ + dt_s : 0;
  if (settled_s_ >= action.settle_s) return true;

  // a tip that has gone through the ramp will not find more force farther in; a proxy's does
  const auto& tip = felt.device[0].tip_patient_mm;
  const double depth_mm =
      (step.surface.point - Point<Patient>(tip[0], tip[1], tip[2])).dot(step.surface.normal);
  const bool by_proxy = felt.method == static_cast<std::uint8_t>(ForceMethod::kProxy);
  if (!by_proxy && depth_mm > kMostDepthInSigmas * model_->sigma_mm + kMostDepth_mm) {
    give_up(step, felt, "it gave way");
    return true;
  }
  if (step_time_s_ < kPatience_s) return false;
  give_up(step, felt, "it did not settle");
  return true;
}

// the hand presses against the surface that it feels
void ScriptedHand::follow_surface() {
  if (felt_normal_.norm() > 0.5) inward_ = -felt_normal_.normalized();
}

bool ScriptedHand::slide(const SlideStep& action, const TickRecord& felt, double dt_s) {
  follow_surface();
  const Vector<World> direction = X_WorldPatient(felt) * action.direction;
  const Vector<World> along = (direction - inward_ * inward_.dot(direction)).normalized();
  const double way_mm = std::min(action.speed_mm_s * dt_s, action.distance_mm - slid_mm_);
  intention_ += along * way_mm;
  slid_mm_ += way_mm;
  keep_force(dt_s);
  return along == Vector<World>() || slid_mm_ >= action.distance_mm;
}

bool ScriptedHand::rotate(const RotateStep& action, double dt_s, Eigen::Quaterniond& rotation_target) {
  if (step_time_s_ == 0) rotation_start_ = rotation_target;
  // a command every tenth of a second, as a second person at a viewer would send
  const double commanded_s = std::floor(step_time_s_ / kRotationInterval_s + 1e-9) * kRotationInterval_s;
  const double part = std::min(1.0, commanded_s / action.seconds);
  const double radians = action.degrees * std::numbers::pi / 180 * part;
  rotation_target =
      Eigen::Quaterniond(Eigen::AngleAxisd(radians, action.axis_world.normalized())) * rotation_start_;
  follow_surface();
  keep_force(dt_s);
  return step_time_s_ >= action.seconds + kRotationInterval_s;
}

bool ScriptedHand::leave(const PlannedStep& step, const TickRecord& felt, double dt_s) {
  const auto& tip = felt.device[0].tip_world_mm;
  const Point<World> here(tip[0], tip[1], tip[2]);
  if (step_time_s_ == 0) {
    // back the way it came, as the patient lies now
    const Transform<World, Patient> X = X_WorldPatient(felt);
    way_.clear();
    for (const Point<Patient>& corner : way_in_) way_.push_back(X * corner);
    leaving_from_ = here;
    wanted_N_ = 0;
  }
  const bool at_its_end = walk(std::get<LeaveStep>(step.action).speed_mm_s, dt_s);

  // it is left when the ramp has ended and nothing is felt
  const bool ramp_ended = (here - leaving_from_).norm() > kWayOutInSigmas * model_->sigma_mm + kWayOut_mm;
  if (ramp_ended && felt_N_ < kFree_N) return true;
  left_s_ += at_its_end ? dt_s : 0;
  if (left_s_ < kFollow_s) return false;
  char text[80];
  std::snprintf(text, sizeof text, ": still %.2f N on leaving ", felt_N_);
  trouble_.push_back("script line " + std::to_string(step.line) + text + model_->name_of(step.structure));
  return true;
}

}  // namespace palpate
