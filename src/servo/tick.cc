#include <algorithm>
#include <cmath>

#include "base/hash.h"
#include "palpate/servo.h"
#include "servo/safety.h"

/// One tick, in order: object's pose -> tip in the patient -> velocity -> contact -> surface effects ->
/// safety -> record. Nothing here allocates, locks, logs or throws.
namespace palpate {
namespace {

// below this the halo of a smoothed structure is not called a touch
constexpr double kTouch_N = 0.02;

// a commanded rotation is a unit quaternion but for rounding
bool is_rotation(const Eigen::Quaterniond& q) {
  const double norm = q.norm();
  return norm > 0.5 && norm < 2;
}

// a new command starts a turn from where the object is felt now; it takes kRotationInterval_s. A command
// that is no rotation is left alone.
void advance_rotation(const Parameters& parameters, double dt_s, SessionState& state) {
  const Eigen::Quaterniond& target = parameters.rotation_target;
  if (target.coeffs() != state.rotation_target.coeffs() && is_rotation(target)) {
    state.rotation_start = state.rotation_felt;
    state.rotation_target = target;
    state.rotation_elapsed_s = 0;
  }
  if (state.rotation_elapsed_s >= kRotationInterval_s) return;
  state.rotation_elapsed_s += dt_s;
  const double part = std::min(1.0, state.rotation_elapsed_s / kRotationInterval_s);
  const Rotation<World, World> start(state.rotation_start), target_rotation(state.rotation_target);
  state.rotation_felt = start.slerp(part, target_rotation).quaternion();
}

// what one point of the tool meets
struct PointContact {
  FieldSample sample;
  ContactSite site;
  Vector<Patient> force_N;
};

PointContact touch(const Model& model, const Parameters& parameters, const Point<Patient>& x,
                   const Vector<Patient>& velocity_mm_s) {
  PointContact contact;
  contact.sample = sample_central_differences(*model.field, x);
  const Vector<Patient> normal_N = normal_force(contact.sample, model.full_force_N);
  contact.force_N = normal_N;
  contact.site = find_contact_site(model, x, contact.sample);
  if (contact.site.tissue < 0) return contact;

  const Tissue& tissue = model.tissues[contact.site.tissue];
  if (parameters.friction) contact.force_N += pseudo_friction(tissue, velocity_mm_s, normal_N);
  if (parameters.viscosity)
    contact.force_N += viscous_force(tissue, velocity_mm_s, contact.sample.value / contact.site.level);
  return contact;
}

// felt, or so deep inside that there is no direction to push in
bool is_touch(const PointContact& contact) {
  const bool inside = contact.sample.value >= 0.5 * contact.site.level;
  return contact.site.label != 0 && (inside || contact.force_N.norm() >= kTouch_N);
}

bool outside(const Field& field, const Point<Patient>& x) {
  const Point<Voxel> p = field.X_VoxelPatient() * x;
  for (int axis = 0; axis < 3; ++axis)
    if (!(p[axis] >= -0.5 && p[axis] <= field.geometry().dims[axis] - 0.5)) return true;
  return false;
}

template <class Frame>
std::array<double, 3> plain(const Vector<Frame>& v) {
  return {v.x(), v.y(), v.z()};
}
template <class Frame>
std::array<double, 3> plain(const Point<Frame>& p) {
  return {p.x(), p.y(), p.z()};
}
std::array<double, 4> plain(const Eigen::Quaterniond& q) {
  return {q.w(), q.x(), q.y(), q.z()};
}

void tick_device(const Model& model, const Parameters& parameters, const DeviceState& device, double dt_s,
                 const Transform<World, Patient>& X_WorldPatient,
                 const Transform<Patient, World>& X_PatientWorld, SessionState::Hand& hand, Wrench& wrench,
                 DeviceTick& out) {
  out = {};
  out.tip_world_mm = plain(device.tip);
  out.orientation_wxyz = plain(device.R_WorldTool);
  out.buttons = device.buttons;
  wrench = {};

  // a pose that is not finite changes nothing and gets no force
  if (!device.tip.all_finite() || !device.R_WorldTool.coeffs().allFinite() ||
      !is_rotation(device.R_WorldTool)) {
    hand.seen = false;
    hand.velocity.clear();
    out.flags = kFlagNotFinite;
    return;
  }

  // tip in the patient, which carries the object's rotation: the velocity is relative to the object
  const Point<Patient> tip = X_PatientWorld * device.tip;
  if (hand.seen) hand.velocity.push(tip - hand.previous_tip, dt_s);
  hand.previous_tip = tip;
  hand.seen = true;
  const Vector<Patient> velocity_mm_s = hand.velocity.velocity_mm_s();

  // contact and surface effects at each point of the tool; the strongest one is reported
  const Eigen::Matrix3d R_WorldTool = device.R_WorldTool.normalized().toRotationMatrix();
  Wrench asked;
  PointContact strongest;
  for (const Eigen::Vector3d& offset_mm : model.tool.points_mm) {
    const Vector<World> arm_mm(R_WorldTool * offset_mm);
    const PointContact contact = touch(model, parameters, tip + X_PatientWorld * arm_mm, velocity_mm_s);
    const Vector<World> force_N = X_WorldPatient * contact.force_N;
    asked.force_N += force_N;
    asked.torque_Nmm += arm_mm.cross(force_N);
    if (&offset_mm == &model.tool.points_mm.front() ||
        contact.force_N.squared_norm() > strongest.force_N.squared_norm())
      strongest = contact;
  }

  // safety: the only way out
  const SafeWrench safe = make_safe(asked, parameters.max_force_N, parameters.paused);
  wrench = safe.wrench;

  out.flags = safe.flags;
  if (outside(*model.field, tip)) out.flags |= kFlagOutside;
  if (is_touch(strongest)) {
    out.flags |= kFlagContact;
    out.label = strongest.site.label;
  }
  out.force_N = plain(wrench.force_N);
  out.torque_Nmm = plain(wrench.torque_Nmm);
  out.unclamped_force_N = asked.force_N.norm();
  out.tip_patient_mm = plain(tip);
  out.normal_patient = plain(-strongest.sample.gradient.normalized());
  out.velocity_patient_mm_s = plain(velocity_mm_s);
  out.field = strongest.sample.value;
  out.depth_mm = strongest.site.depth_mm;
}

}  // namespace

void tick(const Model& model, const Parameters& parameters, std::span<const DeviceState> devices, double dt_s,
          SessionState& state, std::span<Wrench> wrenches, TickRecord& record) {
  PALPATE_CHECK(!devices.empty() && devices.size() <= kMaxDevices && devices.size() == wrenches.size());

  // inputs, before anything moves
  record.tick = state.tick;
  record.time_s = state.time_s;
  record.dt_s = dt_s;
  record.model_version = model.version;
  record.method = static_cast<std::uint8_t>(parameters.method);
  record.switches = static_cast<std::uint8_t>((parameters.friction ? kSwitchFriction : 0) |
                                              (parameters.viscosity ? kSwitchViscosity : 0) |
                                              (parameters.paused ? kSwitchPaused : 0));
  record.max_force_N = parameters.max_force_N;
  record.rotation_target_wxyz = plain(parameters.rotation_target);
  record.devices = static_cast<int>(devices.size());

  // the object's pose
  advance_rotation(parameters, dt_s, state);
  const Transform<World, World> turn(Rotation<World, World>(state.rotation_felt), Vector<World>());
  const Transform<World, Patient> X_WorldPatient = turn * model.X_WorldPatient;
  const Transform<Patient, World> X_PatientWorld = X_WorldPatient.inverse();
  record.rotation_felt_wxyz = plain(state.rotation_felt);

  // each device
  const std::uint32_t rotation_flag = is_rotation(parameters.rotation_target) ? 0u : kFlagRotationIgnored;
  for (std::size_t d = 0; d < devices.size(); ++d) {
    tick_device(model, parameters, devices[d], dt_s, X_WorldPatient, X_PatientWorld, state.hands[d],
                wrenches[d], record.device[d]);
    record.device[d].flags |= rotation_flag;
  }
  state.tick += 1;
  state.time_s += dt_s;

  // what replay compares: the state and what was sent
  std::uint64_t hash = state.hash(static_cast<int>(devices.size()));
  for (const Wrench& wrench : wrenches) {
    for (int axis = 0; axis < 3; ++axis) hash_double(hash, wrench.force_N[axis]);
    for (int axis = 0; axis < 3; ++axis) hash_double(hash, wrench.torque_Nmm[axis]);
  }
  record.state_hash = hash_finish(hash);
}

}  // namespace palpate
