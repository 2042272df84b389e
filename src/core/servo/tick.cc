#include <algorithm>
#include <cmath>

#include "palpate/base/hash.h"
#include "palpate/servo/servo.h"
#include "palpate/tissue/carving.h"
#include "servo/output_stage.h"
#include "servo/surface_matching.h"
#include "servo/tick_record.h"
#include "servo/tool_tick.h"
#include "servo/turning.h"

/// One tick, in order: object pose -> tip in the patient -> velocity -> contact -> surface effects -> no-go
/// regions -> blend -> passivity -> output stage -> record. Nothing here allocates, locks, logs or throws.
namespace palpate {
namespace {

// faults of a device's state, as bits of kFaultFlags
std::uint32_t faults_of(const DeviceState& device, const Parameters& parameters, double scale, double dt_s,
                        const SessionState::Hand& hand) {
  std::uint32_t faults = 0;
  const double jump_mm = std::max(kOutputFeel.jump_mm, kOutputFeel.jump_mm_s * dt_s) * scale;
  if (!device.tip.all_finite() || !device.R_WorldTool.coeffs().allFinite() ||
      !is_rotation(device.R_WorldTool))
    faults |= kFlagNotFinite;
  else if (hand.seen && (device.tip - hand.previous_world).norm() > jump_mm)
    faults |= kFlagJump;
  if (device.status & kDeviceFault) faults |= kFlagDeviceFault;
  if (device.status & kDeviceHalted) faults |= kFlagHalted;
  if (parameters.emergency_stop) faults |= kFlagEmergencyStop;
  return faults;
}

// Pushes the tip's displacement in the patient, whose frame includes the object's rotation, and returns the
// tip's velocity relative to the object.
Vector<Patient> follow_tip(const DeviceState& device, const Point<Patient>& tip, double dt_s, bool jumped,
                           SessionState::Hand& hand) {
  if (jumped) hand.velocity.clear();
  if (hand.seen && !jumped) hand.velocity.push(tip - hand.previous_tip, dt_s);
  hand.previous_world = device.tip;
  hand.previous_tip = tip;
  hand.seen = true;
  return hand.velocity.velocity_mm_s();
}

// After a change of force source (method, model, switches) the difference between old and new force at that
// moment is added to the new force and fades out. The blend is relative to the current force, so that the
// operator's motion takes effect at once.
Wrench blended(const Wrench& asked, bool changed, double dt_s, SessionState::Hand& hand) {
  if (!asked.force_N.all_finite() || !asked.torque_Nmm.all_finite()) {
    hand.asked = hand.difference = {};
    return asked;
  }
  if (changed) {
    hand.difference = {hand.asked.force_N - asked.force_N, hand.asked.torque_Nmm - asked.torque_Nmm};
    hand.blend_elapsed_s = 0;
  }
  // The blend advances in the tick of the change already: if changes follow each other faster than they are
  // blended, the force lags but is never frozen. A late tick must not complete the blend in one step.
  const double on_s = changed ? std::min(dt_s, 0.1 * kOutputFeel.blend_s) : dt_s;
  hand.blend_elapsed_s = std::min(kOutputFeel.blend_s, hand.blend_elapsed_s + on_s);
  hand.asked = asked;
  if (hand.blend_elapsed_s >= kOutputFeel.blend_s) return asked;
  const double rest = 1 - hand.blend_elapsed_s / kOutputFeel.blend_s;
  const double left = rest * std::sqrt(rest);  // decreases from 1 to 0 and reaches 0 with zero slope
  hand.asked.force_N += hand.difference.force_N * left;
  hand.asked.torque_Nmm += hand.difference.torque_Nmm * left;
  return hand.asked;
}

/// Change of surfaces between two versions of the model.
struct Changed {
  std::span<const SurfaceCorrespondence> before;  // correspondence to the previous surfaces; empty: unknown
  bool layers = false;                            // structures belong to other layers
};

// Prepares contact for this tick. After a jump, or while the output is off and faded out, the tip's path is
// unknown and so is the side of each surface on which it lies: the proxy is reset. While the force still
// fades out the path is known.
ProxyChange prepare_contact(const Model& model, std::size_t device, const Changed& surfaces,
                            const OutputRequest& request, SessionState::Hand& hand) {
  const bool lost = (request.faults & kFlagJump) != 0 || (request.off && hand.output.gain == 0);
  const std::uint64_t carved = model.carving != nullptr ? model.carving->sweeps(device) : 0;
  const ProxyChange change{hand.proxy_version != model.version, surfaces.before, surfaces.layers,
                           hand.pushed_directly && !lost, carved};
  if (lost) {
    hand.proxy = {};
    hand.coupling = {};
  }
  hand.proxy_version = model.version;
  hand.pushed_directly = false;
  return change;
}

// Factor for the force, 0 ... 2, that adds a damper along the force while it recovers from a short dropout; 1
// at any other time. The unsupported hand accelerates towards the surface meanwhile: the damper stops it
// sooner than the contact stiffness alone and prevents a rebound.
double recovery_damping_factor(const DeviceParameters& own, const Vector<World>& velocity_mm_s,
                               const SessionState::Hand& hand, const OutputRequest& request) {
  const double force_N = request.asked.force_N.norm();
  const bool returns = (hand.output.away || hand.output.returning) && request.age_s <= kOutputFeel.fresh_s;
  if (!returns || !(force_N > 0) || !std::isfinite(force_N)) return 1;
  const double damping_N_s_per_mm = kOutputFeel.return_damping_N_s_per_m * 1e-3;
  const double bears_N_s_per_mm = own.max_damping_N_s_per_mm;
  const double out_mm_s = velocity_mm_s.dot(request.asked.force_N) / force_N;
  const double damper_N =
      out_mm_s * (bears_N_s_per_mm > 0 ? std::min(damping_N_s_per_mm, bears_N_s_per_mm) : damping_N_s_per_mm);
  return std::clamp(1 - damper_N / force_N, 0.0, 2.0);
}

// Passivity: reduces the requested force so that it returns no more energy than the operator has put in.
// @param way_mm         displacement of the tip relative to the object since the last tick, device mm
// @param velocity_mm_s  mean velocity of the tip relative to the object, device mm/s
// @param most           factor that another damper leaves of the force; the smaller factor applies, not the
//                       product
void apply_passivity(const ToolContact& tool, const Parameters& parameters, const DeviceParameters& own,
                     const Vector<World>& way_mm, const Vector<World>& velocity_mm_s, double most,
                     double max_force_N, double dt_s, SessionState::Hand& hand, OutputRequest& request,
                     DeviceTick& out) {
  const double step_mm = own.position_step_mm > 0 ? own.position_step_mm : kPassivityFeel.coarse_step_mm;
  detect_oscillation(request.asked.force_N, way_mm, step_mm, dt_s, hand.swing);
  // a long tick holds the force longer, which counts as additional delay
  const double held_s = 0.5 * std::max(0.0, dt_s - kPassivityFeel.covered_tick_s);
  const double told_s = own.delay_s + hand.swing.later_s, delay_s = told_s + held_s;
  const Vector<World> acted_N = follow_delay(hand.output.sent.force_N, dt_s, delay_s, hand.delay);
  // a force that has faded out ends the energy account
  const bool faded_out = request.off && hand.output.gain == 0;
  if (faded_out || request.faults != 0 || !request.asked.force_N.all_finite()) {
    hand.passivity = {};
    return;
  }
  const double asked_N = request.asked.force_N.norm();
  const double limit_N = next_limit_N(own.limits, max_force_N, dt_s, hand.output);
  const double within = asked_N > limit_N ? limit_N / asked_N : 1;
  const PassivityOutput kept = control_passivity(
      {request.asked.force_N * (within * hand.output.gain), asked_N * hand.output.gain, acted_N, way_mm,
       tool.stored_mJ, tool.stiffness_N_per_mm, own.position_step_mm, dt_s,
       pending_impulse_N_s(hand.delay, request.asked.force_N.normalized(), delay_s), told_s, velocity_mm_s},
      parameters.passivity, hand.passivity);
  const double factor = std::min(kept.factor, most);
  if (factor == 1) return;
  if (within < 1) out.flags |= kFlagClamped;
  request.asked.force_N = request.asked.force_N * (within * factor);
  request.asked.torque_Nmm = request.asked.torque_Nmm * (within * factor);
  // a later blend starts from the force that was rendered
  hand.asked = request.asked;
  if (kept.factor == 1) return;
  out.damping_N_s_per_m = kept.damping_N_s_per_m;
  out.flags |= kFlagPassivity;
}

bool outside(const Field& field, const Point<Patient>& x) {
  const Point<Voxel> p = field.X_VoxelPatient() * x;
  for (int axis = 0; axis < 3; ++axis)
    if (!(p[axis] >= -0.5 && p[axis] <= field.geometry().dims[axis] - 0.5)) return true;
  return false;
}

// A motor runs only while the force is rendered in full, so that the operator can feel the tool.
MotorState motor_of(const TickContext& tick, const DeviceContext& context, bool switched_on,
                    double max_force_N, const OutputRequest& request, const OutputState& output,
                    std::uint32_t stroke) {
  if (!context.tool.burr) return {};
  const bool force = !request.off && request.faults == 0 && output.gain == 1 && !output.away;
  const double limit_N = next_limit_N(context.device.limits, max_force_N, tick.dt_s, output);
  return {switched_on && force, limit_N / context.device.force_gain, stroke};
}

// a stroke lasts from the start of the first motor to the stop of the last one
void count_strokes(const Model& model, const Parameters& parameters, std::span<const DeviceState> devices,
                   SessionState& state) {
  bool on = false;
  for (std::size_t d = 0; d < devices.size(); ++d)
    on = on || model.tool_of(d).motor_is_on(parameters.motor, devices[d].buttons);
  if (on && !state.motor_on) ++state.strokes;
  state.motor_on = on;
}

// tick inputs besides those of the contacts (TickContext)
struct SharedInputs {
  const Parameters& parameters;
  bool changed;  // the force source differs from the last tick's
  std::uint32_t stroke;
};

void tick_device(const TickContext& tick, const SharedInputs& shared, std::size_t number,
                 const DeviceState& device, const Changed& surfaces, SessionState::Hand& hand, Wrench& wrench,
                 DeviceTick& out) {
  const Model& model = tick.model;
  const Parameters& parameters = shared.parameters;
  const DeviceParameters& own = parameters.device[number];
  record_inputs(device, own, out);
  const bool clutched = (device.status & kDeviceClutched) != 0;
  OutputRequest request{{}, device.age_s, faults_of(device, parameters, own.scale, tick.dt_s, hand), false};
  request.off = parameters.paused || clutched;

  const double max_force_N = std::min(parameters.max_force_N, model.scene_max_force_N);
  ToolContact tool;
  if (request.faults & kFlagNotFinite) {
    // a pose that is not finite resets the contact state and moves nothing
    hand.seen = false;
    hand.velocity.clear();
    hand.asked = {};
    hand.proxy = {};
    // the stroke may end in this tick
    if (model.tool_of(number).burr) hand.burr.closed = true;
    hand.pushed_directly = false;
    hand.coupling = {};
    hand.passivity = {};
    hand.swing = {};
    hand.delay = {};
  } else {
    const Point<Patient> tip = tick.X_PatientWorld * device.tip;
    const Vector<Patient> way_mm = hand.seen ? tip - hand.previous_tip : Vector<Patient>();
    const bool jumped = (request.faults & kFlagJump) != 0;
    const DeviceContext context{model.tool_of(number),
                                own,
                                device.R_WorldTool.normalized().toRotationMatrix(),
                                tip,
                                follow_tip(device, tip, tick.dt_s, jumped, hand),
                                number};
    if (tick.method == ForceMethod::kProxy && model.has(ForceMethod::kProxy)) {
      const ProxyChange change = prepare_contact(model, number, surfaces, request, hand);
      const MotorState motor =
          motor_of(tick, context, context.tool.motor_is_on(parameters.motor, device.buttons), max_force_N,
                   request, hand.output, shared.stroke);
      tool = advance_tool(tick, context, change, motor, hand);
    } else {
      hand.proxy = {};
      hand.coupling = {};
      tool = touch_directly(tick, context);
      // Deep inside, where a direct method gives no force, a proxy initialised at the distant surface would
      // pull with the full force limit.
      const bool pushes = tool.strongest.is_touch() && tool.strongest.force_N != Vector<Patient>();
      hand.pushed_directly = pushes && !request.off && request.faults == 0;
    }
    keep_away(tick, context, tool, out);
    out.flags |= tool.flags;
    request.asked = blended(tool.asked, shared.changed || tool.let_go, tick.dt_s, hand);
    request.unclamped_N = request.asked.force_N.norm();
    const Vector<World> velocity_mm_s = tick.X_WorldPatient * context.velocity_mm_s / own.scale;
    const double stop = recovery_damping_factor(own, velocity_mm_s, hand, request);
    if (stop > 1) {
      request.asked.force_N = request.asked.force_N * stop;
      request.asked.torque_Nmm = request.asked.torque_Nmm * stop;
    }
    apply_passivity(tool, parameters, own, tick.X_WorldPatient * way_mm / own.scale, velocity_mm_s,
                    std::min(stop, 1.0), max_force_N, tick.dt_s, hand, request, out);
    if (outside(*model.field, tip)) out.flags |= kFlagOutside;
    if (hand.blend_elapsed_s < kOutputFeel.blend_s) out.flags |= kFlagBlend;
  }

  // every force passes the output stage
  const Output sent = make_output(request, own.limits, max_force_N, tick.dt_s, hand.output);
  wrench = sent.wrench;
  if (parameters.paused) out.flags |= kFlagPaused;
  if (clutched) out.flags |= kFlagClutched;
  record_outputs(tool, request, sent, hand, out);
}

// digest of everything that selects the force computation; a new value starts a blend
std::uint64_t force_source_digest(const Model& model, const Parameters& parameters, std::size_t devices) {
  std::uint64_t maker = kHashSeed;
  // local edits are excluded: material that was cut away takes effect at once
  hash_word(maker, model.version - model.edits);
  const ForceMethod felt = model.has(parameters.method) ? parameters.method : ForceMethod::kTrilinear;
  hash_word(maker, static_cast<std::uint64_t>(felt) << 3 | parameters.passivity << 2 |
                       parameters.friction << 1 | static_cast<std::uint64_t>(parameters.viscosity));
  for (std::size_t d = 0; d < devices; ++d) {
    hash_double(maker, parameters.device[d].force_gain);
    hash_double(maker, parameters.device[d].scale);
    hash_double(maker, parameters.device[d].max_stiffness_N_per_mm);
    hash_double(maker, parameters.device[d].max_damping_N_s_per_mm);
  }
  return hash_finish(maker) | 1;
}

}  // namespace

void tick(const Model& model, const Parameters& parameters, std::span<const DeviceState> devices, double dt_s,
          SessionState& state, std::span<Wrench> wrenches, TickRecord& record) {
  PALPATE_CHECK(!devices.empty() && devices.size() <= kMaxDevices && devices.size() == wrenches.size());
  PALPATE_CHECK(model.has(ForceMethod::kTrilinear));

  record_inputs(model, parameters, state, dt_s, devices.size(), record);

  // pose of the object
  const std::uint32_t holding = turn_object(model, parameters, devices, dt_s, state);
  const Transform<World, Patient> X_WorldPatient = turned_object(model.X_WorldPatient, state.rotation_felt);
  const bool yields = is_elastic(model.tissue_law);
  if (!yields) state.last_ignored_yield_frame = parameters.yields.number;
  const bool is_felt = yields && (state.last_ignored_yield_frame == 0 ||
                                  parameters.yields.number > state.last_ignored_yield_frame);
  const TickContext context{
      model,       parameters.method, parameters.friction,      parameters.viscosity,
      dt_s,        X_WorldPatient,    X_WorldPatient.inverse(), is_felt ? &parameters.yields : nullptr,
      &state.holes};
  record.rotation_felt_wxyz = plain(state.rotation_felt);

  // a change of force source starts a blend
  const std::uint64_t maker = force_source_digest(model, parameters, devices.size());
  const bool changed = state.force_source != 0 && state.force_source != maker;
  state.force_source = maker;

  // proxies stay on surfaces that a new version of the model shares with the old one
  SurfaceMatches before;
  const bool other_surfaces = state.surfaces.version != model.version;
  const auto surfaces_before = other_surfaces ? match_surfaces(model, state.surfaces, before)
                                              : std::span<const SurfaceCorrespondence>();

  const bool other_layers = other_surfaces && state.surfaces.version != 0 && state.surfaces.yield != yields;

  if (other_surfaces && !state.holes.empty()) state.holes.keep(surfaces_before);

  // each device
  count_strokes(model, parameters, devices, state);
  const std::uint32_t common_flags = (is_rotation(parameters.rotation_target) ? 0u : kFlagRotationIgnored) |
                                     (model.has(parameters.method) ? 0u : kFlagMethodMissing);
  for (std::size_t d = 0; d < devices.size(); ++d) {
    const bool known = state.hands[d].proxy_version == state.surfaces.version;
    const Changed surfaces{known ? surfaces_before : std::span<const SurfaceCorrespondence>(), other_layers};
    tick_device(context, {parameters, changed, state.strokes}, d, devices[d], surfaces, state.hands[d],
                wrenches[d], record.device[d]);
    record.device[d].flags |= common_flags | ((holding >> d & 1) != 0 ? kFlagTurnHeld : 0u);
  }
  if (other_surfaces) remember_surfaces(model, state.surfaces);
  state.tick += 1;
  state.time_s += dt_s;

  // replay compares this hash
  record.state_hash = state.hash(static_cast<int>(devices.size()));
}

}  // namespace palpate
