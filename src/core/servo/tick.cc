#include <algorithm>
#include <cmath>

#include "palpate/base/hash.h"
#include "palpate/direct/direct_methods.h"
#include "palpate/servo/servo.h"
#include "palpate/tissue/carving.h"
#include "servo/burr_tick.h"
#include "servo/object_rotation.h"
#include "servo/output_stage.h"
#include "servo/surface_matching.h"
#include "servo/tick_record.h"
#include "servo/tool_tick.h"

/// One tick.
///
/// - All devices: rotation of the object, change of force source, match of surfaces to the last model's.
/// - Each device: faults -> tip in the patient -> velocity -> contact -> no-go regions -> blend -> recovery
///   damping -> passivity -> output stage -> record.
///
/// Nothing here allocates, locks, logs or throws.
namespace palpate {
namespace {

// Faults of a device's state, as bits of kFaultFlags. A jump is a displacement that is implausible both as a
// distance and as a speed; the limits are in device mm and are scaled to World.
std::uint32_t faults_of(const DeviceState& device, const Parameters& parameters, double scale, double dt_s,
                        const SessionState::DeviceSession& session) {
  std::uint32_t faults = 0;
  const double jump_mm = std::max(kOutputSettings.jump_mm, kOutputSettings.jump_mm_s * dt_s) * scale;
  if (!device.tip.all_finite() || !device.R_WorldTool.coeffs().allFinite() ||
      !is_rotation(device.R_WorldTool))
    faults |= kFlagNotFinite;
  else if (session.has_previous && (device.tip - session.previous_world).norm() > jump_mm)
    faults |= kFlagJump;
  if (device.status & kDeviceFault) faults |= kFlagDeviceFault;
  if (device.status & kDeviceHalted) faults |= kFlagHalted;
  if (parameters.emergency_stop) faults |= kFlagEmergencyStop;
  return faults;
}

// Updates the tip's history and returns its velocity relative to the object; the patient frame rotates with
// the object. A jump does not count as motion.
Vector<Patient> update_tip_history(const DeviceState& device, const Point<Patient>& tip, double dt_s,
                                   bool jumped, SessionState::DeviceSession& session) {
  if (jumped) session.velocity.clear();
  if (session.has_previous && !jumped) session.velocity.push(tip - session.previous_tip, dt_s);
  session.previous_world = device.tip;
  session.previous_tip = tip;
  session.has_previous = true;
  return session.velocity.velocity_mm_s();
}

// Blends over a change of force source (method, model, switches, gains): the difference between the old and
// the new wrench at the change is added to the new wrench and fades out over kOutputSettings.blend_s. Because
// only the difference fades, the operator's motion takes effect at once.
// @param requested    wrench of the current force source
// @param changed  whether the force source differs from the last tick's
Wrench blend_force_source(const Wrench& requested, bool changed, double dt_s,
                          SessionState::DeviceSession& session) {
  if (!requested.force_N.all_finite() || !requested.torque_Nmm.all_finite()) {
    session.requested = session.difference = {};
    return requested;
  }
  if (changed) {
    session.difference = {session.requested.force_N - requested.force_N,
                          session.requested.torque_Nmm - requested.torque_Nmm};
    session.blend_elapsed_s = 0;
  }
  // The blend already advances in the tick of the change; otherwise a change in every tick would freeze the
  // force. This first advance is limited to a tenth of blend_s, so that a late tick cannot skip the blend.
  const double blend_dt_s = changed ? std::min(dt_s, 0.1 * kOutputSettings.blend_s) : dt_s;
  session.blend_elapsed_s = std::min(kOutputSettings.blend_s, session.blend_elapsed_s + blend_dt_s);
  session.requested = requested;
  if (session.blend_elapsed_s >= kOutputSettings.blend_s) return requested;
  const double remaining_fraction = 1 - session.blend_elapsed_s / kOutputSettings.blend_s;
  // (remaining fraction)^1.5 falls from 1 to 0 and ends with zero slope
  const double fade_weight = remaining_fraction * std::sqrt(remaining_fraction);
  session.requested.force_N += session.difference.force_N * fade_weight;
  session.requested.torque_Nmm += session.difference.torque_Nmm * fade_weight;
  return session.requested;
}

/// Change of surfaces between two versions of the model.
struct SurfaceChange {
  std::span<const SurfaceCorrespondence>
      correspondences;             // correspondence to the previous surfaces; empty: unknown
  bool layers_reassigned = false;  // whether structures were assigned to other layers
};

/// Inputs of a tick that all devices share.
struct SharedInputs {
  const TickContext& tick;
  const Parameters& parameters;
  bool force_source_changed;  // whether the force source differs from the last tick's
  std::uint32_t stroke;       // number of the current or last stroke of the cutting tools
};

/// Inputs of one device in a tick.
struct DeviceInputs {
  std::size_t device_index;  // index of the device
  const DeviceState& state;
  const DeviceParameters& parameters;
  SurfaceChange surfaces;  // change since the last advance of the device's proxy
  double max_force_N;      // lesser of the user's and the scene's limit
};

/// Contact of a device's tool, and the motion of its tip.
struct RenderedContact {
  const ToolContact& tool;
  Vector<World> displacement_mm;  // displacement of the tip relative to the object in this tick, device mm
  Vector<World> velocity_mm_s;    // windowed mean velocity of the tip relative to the object, device mm/s
};

// Changes since the proxy's last tick. Resets the proxy after a jump, or once the force of a paused or
// clutched device has faded out: the path of the tip is then unknown, and with it the side of each surface on
// which the tip lies. While the force is still fading out, the proxy is advanced as usual.
ProxyChange prepare_contact(const Model& model, const DeviceInputs& in, const OutputRequest& request,
                            SessionState::DeviceSession& session) {
  const bool lost = (request.faults & kFlagJump) != 0 || (request.fade_out && session.output.gain == 0);
  const CarvedMaterial carved =
      model.carving != nullptr ? model.carving->carved(in.device_index) : CarvedMaterial();
  const ProxyChange change{session.proxy_version != model.version, in.surfaces.correspondences,
                           in.surfaces.layers_reassigned, session.pushed_by_direct_method && !lost, carved};
  if (lost) session.reset_contact();
  session.proxy_version = model.version;
  session.pushed_by_direct_method = false;
  return change;
}

// Factor, 0 ... 2, by which a damper along the force changes the force while it returns after a short
// dropout; 1 otherwise. During the dropout the unsupported hand has accelerated towards the surface. The
// damper stops it sooner than the contact stiffness alone and prevents a rebound.
double recovery_damping_factor(const DeviceParameters& device, const Vector<World>& velocity_mm_s,
                               const SessionState::DeviceSession& session, const OutputRequest& request) {
  const double force_N = request.requested.force_N.norm();
  const bool is_recovering =
      (session.output.in_dropout || session.output.returning) && request.age_s <= kOutputSettings.fresh_s;
  if (!is_recovering || !(force_N > 0) || !std::isfinite(force_N)) return 1;
  const double damping_N_s_per_mm = kOutputSettings.return_damping_N_s_per_m * 1e-3;
  const double max_damping_N_s_per_mm = device.max_damping_N_s_per_mm;
  const double outward_speed_mm_s = velocity_mm_s.dot(request.requested.force_N) / force_N;
  const double damper_N =
      outward_speed_mm_s * (max_damping_N_s_per_mm > 0 ? std::min(damping_N_s_per_mm, max_damping_N_s_per_mm)
                                                       : damping_N_s_per_mm);
  return std::clamp(1 - damper_N / force_N, 0.0, 2.0);
}

// Passivity: reduces the requested force so that it returns no more energy than the operator has put in.
// @param max_factor  upper bound of the factor, 0 ... 1, from the recovery damper; the two factors are not
//                    multiplied
void apply_passivity(const SharedInputs& shared, const DeviceInputs& in, const RenderedContact& contact,
                     double max_factor, SessionState::DeviceSession& session, OutputRequest& request,
                     DeviceTick& out) {
  const DeviceParameters& device = in.parameters;
  const ToolContact& tool = contact.tool;
  const double dt_s = shared.tick.dt_s;
  const double step_mm =
      device.position_step_mm > 0 ? device.position_step_mm : kPassivitySettings.default_step_mm;
  detect_oscillation(request.requested.force_N, contact.displacement_mm, step_mm, dt_s, session.oscillation);
  // in a long tick the force is constant for longer; half of the excess counts as delay
  const double held_s = 0.5 * std::max(0.0, dt_s - kPassivitySettings.covered_tick_s);
  const double device_delay_s = device.delay_s + session.oscillation.extra_delay_s,
               delay_s = device_delay_s + held_s;
  const Vector<World> delayed_force_N =
      advance_delay_line(session.output.sent.force_N, dt_s, delay_s, session.delay);
  // a force that is not rendered does no work: the energy balance starts again from zero
  const bool faded_out = request.fade_out && session.output.gain == 0;
  if (faded_out || request.faults != 0 || !request.requested.force_N.all_finite()) {
    session.passivity = {};
    return;
  }
  const double requested_N = request.requested.force_N.norm();
  const double limit_N = next_limit_N(device.limits, in.max_force_N, dt_s, session.output);
  const double clamp_factor = requested_N > limit_N ? limit_N / requested_N : 1;
  const PassivityOutput reduced =
      control_passivity({request.requested.force_N * (clamp_factor * session.output.gain),
                         requested_N * session.output.gain, delayed_force_N, contact.displacement_mm,
                         tool.stored_mJ, tool.stiffness_N_per_mm, device.position_step_mm, dt_s,
                         pending_impulse_N_s(session.delay, request.requested.force_N.normalized(), delay_s),
                         device_delay_s, contact.velocity_mm_s, tool.received_mJ},
                        shared.parameters.passivity, session.passivity);
  const double factor = std::min(reduced.factor, max_factor);
  if (factor == 1) return;
  if (clamp_factor < 1) out.flags |= kFlagClamped;
  request.requested.force_N = request.requested.force_N * (clamp_factor * factor);
  request.requested.torque_Nmm = request.requested.torque_Nmm * (clamp_factor * factor);
  // a later blend starts from the force that was rendered
  session.requested = request.requested;
  if (reduced.factor == 1) return;
  out.damping_N_s_per_m = reduced.damping_N_s_per_m;
  out.flags |= kFlagPassivity;
}

// whether a point is outside the volume, which extends half a voxel beyond the outermost voxel centres
bool is_outside_volume(const Bricks<LabelId>& labels, const Point<Patient>& x) {
  const Point<Voxel> p = labels.X_VoxelPatient() * x;
  for (int axis = 0; axis < 3; ++axis)
    if (!(p[axis] >= -0.5 && p[axis] <= labels.geometry().dims[axis] - 0.5)) return true;
  return false;
}

// State of a burr's motor. It runs only while the force is rendered in full, so that no tissue is removed
// without haptic feedback.
MotorState motor_of(const SharedInputs& shared, const DeviceInputs& in, const Tool& tool,
                    const OutputRequest& request, const OutputState& output) {
  // a gain of 0 renders no force at all
  if (!tool.burr || !(in.parameters.force_gain > 0)) return {.stroke = shared.stroke};
  const bool is_on = tool.motor_is_on(shared.parameters.motor, in.state.buttons);
  const bool is_rendered = !request.fade_out && request.faults == 0 && output.gain == 1 && !output.in_dropout;
  const double limit_N = next_limit_N(in.parameters.limits, in.max_force_N, shared.tick.dt_s, output);
  return {is_on && is_rendered, limit_N / in.parameters.force_gain, shared.stroke};
}

// Counts strokes of cutting tools. A stroke lasts from the start of the first motor until no motor is on.
void count_strokes(const Model& model, const Parameters& parameters, std::span<const DeviceState> devices,
                   SessionState& state) {
  bool on = false;
  for (std::size_t d = 0; d < devices.size(); ++d)
    on = on || model.tool_of(d).motor_is_on(parameters.motor, devices[d].buttons);
  if (on && !state.motor_on) ++state.strokes;
  state.motor_on = on;
}

// contact of the tool by the selected method, or by Model::rendered_method() if the model is not prepared for
// it
ToolContact touch(const SharedInputs& shared, const DeviceInputs& in, const DeviceContext& context,
                  const OutputRequest& request, SessionState::DeviceSession& session, DeviceTick& out) {
  const Model& model = shared.tick.model;
  if (model.rendered_method(shared.tick.method) == ForceMethod::kProxy) {
    const ProxyChange change = prepare_contact(model, in, request, session);
    const MotorState motor = motor_of(shared, in, context.tool, request, session.output);
    const BurrSnapshot before = burr_snapshot(session);
    ToolContact tool = advance_tool(shared.tick, context, change, motor, session);
    if (context.tool.burr)
      render_burr(shared.tick, context,
                  {before, motor.runs, shared.parameters.vibration,
                   next_limit_N(in.parameters.limits, in.max_force_N, shared.tick.dt_s, session.output)},
                  tool, session, out);
    return tool;
  }
  session.reset_contact();
  const ToolContact tool = touch_directly(shared.tick, context);
  // On a later change to the proxy method, a tip inside tissue is coupled only if a direct method pushed it.
  // Deep inside, where direct methods give no force, the proxy would start at a distant surface and pull with
  // the full force limit.
  const bool pushes = tool.strongest.is_contact() && tool.strongest.force_N != Vector<Patient>();
  session.pushed_by_direct_method = pushes && !request.fade_out && request.faults == 0;
  return tool;
}

// Requested force of a device whose pose is finite: contact, no-go regions, blend, recovery damping and
// passivity.
ToolContact request_force(const SharedInputs& shared, const DeviceInputs& in,
                          SessionState::DeviceSession& session, OutputRequest& request, DeviceTick& out) {
  const TickContext& tick = shared.tick;
  const DeviceParameters& device = in.parameters;
  const Point<Patient> tip = tick.X_PatientWorld * in.state.tip;
  const Vector<Patient> displacement_mm =
      session.has_previous ? tip - session.previous_tip : Vector<Patient>();
  const bool jumped = (request.faults & kFlagJump) != 0;
  const DeviceContext context{tick.model.tool_of(in.device_index),
                              device,
                              in.state.R_WorldTool.normalized().toRotationMatrix(),
                              tip,
                              update_tip_history(in.state, tip, tick.dt_s, jumped, session),
                              in.device_index};
  ToolContact tool = touch(shared, in, context, request, session, out);
  add_no_go_force(tick, context, tool, out);
  out.flags |= tool.flags;
  request.requested =
      blend_force_source(tool.requested, shared.force_source_changed || tool.released, tick.dt_s, session);
  request.unclamped_N = request.requested.force_N.norm();

  const RenderedContact contact{tool, tick.X_WorldPatient * displacement_mm / device.scale,
                                tick.X_WorldPatient * context.velocity_mm_s / device.scale};
  // a factor above 1 precedes the passivity controller; one below 1 is combined with the controller's
  const double recovery_factor = recovery_damping_factor(device, contact.velocity_mm_s, session, request);
  if (recovery_factor > 1) {
    request.requested.force_N = request.requested.force_N * recovery_factor;
    request.requested.torque_Nmm = request.requested.torque_Nmm * recovery_factor;
  }
  apply_passivity(shared, in, contact, std::min(recovery_factor, 1.0), session, request, out);
  if (is_outside_volume(*tick.model.labels, tip)) out.flags |= kFlagOutside;
  if (session.blend_elapsed_s < kOutputSettings.blend_s) out.flags |= kFlagBlend;
  return tool;
}

// contacts of all devices with deformable tissue in the last tick; none with a single device
std::span<const TissueContact> last_tissue_contacts(const SessionState& state, std::size_t devices,
                                                    std::array<TissueContact, kMaxDevices>& tissue_contacts) {
  if (devices < 2) return {};
  for (std::size_t d = 0; d < devices; ++d) tissue_contacts[d] = state.device[d].tissue_contact;
  return std::span(tissue_contacts).first(devices);
}

// one tick of one device, from its state to the wrench and the record
void tick_device(const SharedInputs& shared, const DeviceInputs& in, SessionState::DeviceSession& session,
                 Wrench& wrench, DeviceTick& out) {
  const Parameters& parameters = shared.parameters;
  const double dt_s = shared.tick.dt_s;
  record_inputs(in.state, in.parameters, out);
  if (in.state.status & kDeviceSetDown) session.reset_path();
  const bool clutched = (in.state.status & kDeviceClutched) != 0;
  OutputRequest request{
      {}, in.state.age_s, faults_of(in.state, parameters, in.parameters.scale, dt_s, session), false};
  request.fade_out = parameters.paused || clutched;

  ToolContact tool;
  if (request.faults & kFlagNotFinite) {
    session.reset_path();
    // Without a pose the burr is not advanced, but the stroke may end in this tick: a sweep of the next one
    // must not extend this sweep.
    if (shared.tick.model.tool_of(in.device_index).burr) session.burr.sweep_closed = true;
  } else {
    tool = request_force(shared, in, session, request, out);
  }
  session.tissue_contact = shared.tick.tissue_contacts.empty() ? TissueContact{} : tool.tissue_contact;

  // every force passes the output stage
  const Output sent = make_output(request, in.parameters.limits, in.max_force_N, dt_s, session.output);
  wrench = sent.wrench;
  if (parameters.paused) out.flags |= kFlagPaused;
  if (clutched) out.flags |= kFlagClutched;
  record_outputs(tool, request, sent, session, out);
}

// whether a tick can be computed: finite non-negative duration, one wrench per device, and a prepared model
bool is_usable(const Model& model, std::size_t devices, double dt_s, std::size_t wrenches) {
  return std::isfinite(dt_s) && dt_s >= 0 && devices >= 1 && devices <= kMaxDevices && devices == wrenches &&
         model.has(model.rendered_method(ForceMethod::kProxy));
}

// Outputs of a tick that cannot be computed: zero force, and the inputs in the record.
void write_refused_tick(const Model& model, const Parameters& parameters,
                        std::span<const DeviceState> devices, double dt_s, const SessionState& state,
                        std::span<Wrench> wrenches, TickRecord& record) {
  const std::size_t count = std::min<std::size_t>(devices.size(), kMaxDevices);
  std::fill(wrenches.begin(), wrenches.end(), Wrench{});
  record_inputs(model, parameters, state, dt_s, count, record);
  record.rotation_applied_wxyz = plain(state.rotation_applied);
  for (std::size_t d = 0; d < count; ++d) {
    record_inputs(devices[d], parameters.device[d], record.device[d]);
    record.device[d].flags = kFlagNotFinite;
  }
  record.state_hash = state.hash(static_cast<int>(count));
}

// digest of all inputs that select the force computation; a changed digest starts a blend
std::uint64_t force_source_digest(const Model& model, const Parameters& parameters, std::size_t devices) {
  std::uint64_t digest = kHashSeed;
  // Each local edit increments both the version and the edits, so that their difference identifies the model
  // without its local edits: removal of material takes effect without a blend.
  hash_word(digest, model.version - model.edits);
  const ForceMethod method = model.rendered_method(parameters.method);
  hash_word(digest, static_cast<std::uint64_t>(method) << 8 | blended_switch_bits(parameters));
  for (std::size_t d = 0; d < devices; ++d) {
    hash_double(digest, parameters.device[d].force_gain);
    hash_double(digest, parameters.device[d].scale);
    hash_double(digest, parameters.device[d].max_stiffness_N_per_mm);
    hash_double(digest, parameters.device[d].max_damping_N_s_per_mm);
  }
  // 0 is reserved for the state before the first tick
  return hash_finish(digest) | 1;
}

}  // namespace

void tick(const Model& model, const Parameters& parameters, std::span<const DeviceState> devices, double dt_s,
          SessionState& state, std::span<Wrench> wrenches, TickRecord& record) {
  if (!is_usable(model, devices.size(), dt_s, wrenches.size()))
    return write_refused_tick(model, parameters, devices, dt_s, state, wrenches, record);

  record_inputs(model, parameters, state, dt_s, devices.size(), record);

  // pose of the object
  const std::uint32_t rotation_limiting_devices = rotate_object(model, parameters, devices, dt_s, state);
  const Transform<World, Patient> X_WorldPatient =
      rotated_object_pose(model.X_WorldPatient, state.rotation_applied);
  // solver frames published while no tissue was deformable are stale and stay ignored afterwards
  const bool is_deformable = is_elastic(model.tissue_law);
  if (!is_deformable) state.last_ignored_solver_frame = parameters.compliance.number;
  const bool has_current_compliance =
      is_deformable && (state.last_ignored_solver_frame == 0 ||
                        parameters.compliance.number > state.last_ignored_solver_frame);
  std::array<TissueContact, kMaxDevices> tissue_contacts;
  const TickContext context{model,
                            parameters.method,
                            parameters.friction,
                            parameters.viscosity,
                            dt_s,
                            X_WorldPatient,
                            X_WorldPatient.inverse(),
                            has_current_compliance ? &parameters.compliance : nullptr,
                            &state.holes,
                            last_tissue_contacts(state, devices.size(), tissue_contacts)};
  record.rotation_applied_wxyz = plain(state.rotation_applied);

  // a change of force source starts a blend
  const std::uint64_t source = force_source_digest(model, parameters, devices.size());
  const bool force_source_changed = state.force_source != 0 && state.force_source != source;
  state.force_source = source;

  // match the surfaces of a new model version to the old ones; proxies stay on those that are unchanged
  SurfaceMatches matches;
  const bool surfaces_changed = state.surfaces.version != model.version;
  const auto surfaces_before = surfaces_changed ? match_surfaces(model, state.surfaces, matches)
                                                : std::span<const SurfaceCorrespondence>();

  const bool layers_reassigned =
      surfaces_changed && state.surfaces.version != 0 && state.surfaces.is_deformable != is_deformable;

  if (surfaces_changed && !state.holes.empty()) state.holes.transfer(surfaces_before);

  // each device
  count_strokes(model, parameters, devices, state);
  const SharedInputs shared{context, parameters, force_source_changed, state.strokes};
  const double max_force_N = std::min(parameters.max_force_N, model.scene_max_force_N);
  const std::uint32_t common_flags = (is_rotation(parameters.rotation_target) ? 0u : kFlagRotationIgnored) |
                                     (model.has(parameters.method) ? 0u : kFlagMethodMissing);
  for (std::size_t d = 0; d < devices.size(); ++d) {
    const bool proxy_is_current = state.device[d].proxy_version == state.surfaces.version;
    const SurfaceChange surfaces{
        proxy_is_current ? surfaces_before : std::span<const SurfaceCorrespondence>(), layers_reassigned};
    tick_device(shared, {d, devices[d], parameters.device[d], surfaces, max_force_N}, state.device[d],
                wrenches[d], record.device[d]);
    record.device[d].flags |=
        common_flags | ((rotation_limiting_devices >> d & 1) != 0 ? kFlagRotationLimited : 0u);
  }
  if (surfaces_changed) store_surfaces(model, state.surfaces);
  state.tick += 1;
  state.time_s += dt_s;

  // a replay compares this hash with the recorded one
  record.state_hash = state.hash(static_cast<int>(devices.size()));
}

}  // namespace palpate
