#include "servo/burr_tick.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include "palpate/servo/burr_rendering.h"
#include "palpate/tissue/tissue_settings.h"

namespace palpate {
namespace {

// whether a point is in material of one layer that is neither removed nor swept
bool is_material(const std::vector<ContactSurface>& surfaces, const ProxyLayer& layer, int number,
                 const BurrState& burr, const Point<Patient>& at) {
  bool inside = false;
  for (std::size_t s = 0; s < surfaces.size() && !inside; ++s) {
    const ContactSurface& surface = surfaces[s];
    if (surface.layer != number || surface.surface == nullptr || layer.punctured[s]) continue;
    inside = !surface.surface->is_farther_than(at, 0) && surface.surface->distance_mm(at) < 0;
  }
  if (!inside) return false;
  for (const Sweep& sweep : burr.pending())
    if (SweptShape(sweep).depth_mm(at) > 0) return false;
  return true;
}

// Foremost point of a head in a direction; the first ball's centre is at `at`.
Point<Patient> foremost(const ToolPart& head, const Point<Patient>& at, const Vector<Patient>& ahead) {
  const double end = head.axis_mm.dot(ahead) + head.radius_change_mm > 0 ? 1 : 0;
  return at + head.axis_mm * end + ahead * head.radius_at_mm(end);
}

// direction in which the operator presses the head, unit; zero without contact
Vector<Patient> press_direction_of(const SessionState::DeviceSession& session) {
  const ProxyLayer& layer = session.proxy.layer(std::max(session.burr.layer, 0));
  const Vector<Patient> pressed_mm = session.proxy.tip - layer.position;
  const double length_mm = pressed_mm.norm();
  return layer.coupled && length_mm > 0 ? pressed_mm / length_mm : Vector<Patient>();
}

// Updates whether a burr is about to break through: material is directly ahead of the head's foremost point,
// and ends within free_mm. Returns whether that material ended in this tick under pressure.
bool breaks_through(const std::vector<ContactSurface>& surfaces, const ToolPart& head,
                    const BurrSnapshot& before, SessionState::DeviceSession& session) {
  const BurrState& burr = session.burr;
  const int number = std::max(burr.layer, 0);
  const ProxyLayer& layer = session.proxy.layer(number);
  Vector<Patient> press_direction = press_direction_of(session);
  if (press_direction == Vector<Patient>()) press_direction = before.press_direction;
  // a withdrawing head leaves the cavity that it has cut
  const bool advances = (layer.position - before.at).dot(press_direction) >= -kCuttingSettings.at_rest_mm;
  const bool pressed = before.front_mm2 > 0 && before.pressed_N >= kBurrRenderingSettings.min_press_N;
  const bool was_thin = std::exchange(session.burr_rendering.is_wall_thin, false);
  if (press_direction == Vector<Patient>() || !advances || !pressed) return false;
  const Point<Patient> foot = foremost(head, layer.position, press_direction);
  const auto is_material_at = [&](double ahead_mm) {
    return is_material(surfaces, layer, number, burr, foot + press_direction * ahead_mm);
  };
  const double lookahead_mm = kCuttingSettings.lookahead_mm;
  const bool touches = is_material_at(lookahead_mm);
  // a break-through requires that the material ahead was thin
  if (!touches && !was_thin) return false;
  const int samples =
      static_cast<int>(std::floor(kBurrRenderingSettings.free_mm / kBurrRenderingSettings.free_step_mm));
  int material = 0;
  for (int n = 1; n <= samples; ++n)
    material += is_material_at(lookahead_mm + n * kBurrRenderingSettings.free_step_mm);
  session.burr_rendering.is_wall_thin = touches && material < samples;
  return !touches && material == 0;
}

// Unit direction in which the head would roll on the surface, World; transverse to the spindle where it is
// pressed along it.
Vector<World> rolling_direction(const TickContext& tick, const DeviceContext& context,
                                const Vector<World>& force_N, double& sine) {
  const Vector<Patient> spindle = context.in_patient(tick, context.tool.burr->spindle);
  // the head rotates clockwise when viewed from the handle
  const Vector<World> rotation = tick.X_WorldPatient * (spindle * -1.0);
  const Vector<World> across = rotation.cross(force_N.normalized());
  sine = across.norm();
  if (sine >= kBurrRenderingSettings.min_sine) return across / sine;
  int smallest = 0;
  rotation.eigen().cwiseAbs().minCoeff(&smallest);
  return rotation.cross(Vector<World>(Eigen::Vector3d::Unit(smallest))).normalized();
}

// counts down or restarts the time for which a break-through is signalled
void update_break_through(const TickContext& tick, const Burr& burr, const BurrConditions& conditions,
                          ToolContact& contact, SessionState::DeviceSession& session) {
  BurrRenderingState& state = session.burr_rendering;
  state.break_through_s = std::max(0.0, state.break_through_s - tick.dt_s);
  if (conditions.runs && breaks_through(tick.model.surfaces, burr.head(0), conditions.before, session))
    state.break_through_s = kBurrRenderingSettings.break_through_s;
  if (state.break_through_s > 0) contact.flags |= kFlagBreakThrough;
}

// temperature rise of the bone at a head without irrigation
void update_temperature(const TickContext& tick, const Burr& burr, const BurrConditions& conditions,
                        SessionState::DeviceSession& session, DeviceTick& out) {
  BurrRenderingState& state = session.burr_rendering;
  const double work_mJ = std::max(0.0, session.burr.work_mJ - conditions.before.work_mJ);
  state.bone_rise_K = bone_rise_K(state.bone_rise_K, burr.max_radius_mm(), work_mJ, tick.dt_s);
  out.bone_rise_K = state.bone_rise_K;
}

// @param cuts  whether the running burr removes material in this tick
void add_vibration(const TickContext& tick, const DeviceContext& context, const BurrConditions& conditions,
                   bool cuts, ToolContact& contact, SessionState::DeviceSession& session, DeviceTick& out) {
  const BurrSettings& settings = *context.tool.burr;
  const BurrState& burr = session.burr;
  BurrRenderingState& state = session.burr_rendering;
  const double dt_s = tick.dt_s;
  // the frequency is that of the motor's start, so that late ticks do not change it
  if (!conditions.runs || !conditions.vibrates || !(dt_s > 0)) {
    state.frequency_hz = state.phase = state.mean_N = 0;
    return;
  }
  if (!(state.frequency_hz > 0)) state.frequency_hz = vibration_hz(settings, dt_s);
  state.phase += state.frequency_hz * dt_s;
  state.phase -= std::floor(state.phase);
  const double pressed_N = cuts ? burr.pressed_N : 0;
  state.mean_N += (pressed_N - state.mean_N) * (1 - std::exp(-dt_s / kBurrRenderingSettings.kick_s));

  const Vector<World>& contact_N = contact.requested.force_N;
  const double force_N = contact_N.norm();
  if (!(force_N > 0) || !std::isfinite(force_N)) return;
  const DeviceParameters& device = context.device;
  const double step_mm =
      device.position_step_mm > 0 ? device.position_step_mm : kPassivitySettings.default_step_mm;
  double allowed_N = std::max(0.0, conditions.limit_N - force_N);
  allowed_N = std::min(allowed_N, std::max(0.0, session.passivity.energy_mJ) / (2 * step_mm));
  const auto allot_N = [&](double requested_N, double max_N) {
    const double limit_N = std::min(allowed_N, max_N);
    const double force = std::clamp(requested_N, -limit_N, limit_N);
    allowed_N -= std::abs(force);
    return force;
  };
  double sine = 0;
  const Vector<World> along = rolling_direction(tick, context, contact_N, sine);
  out.vibration_hz = state.frequency_hz;
  out.vibration_N = allot_N(device.force_gain * vibration_amplitude_N(settings, burr, state.frequency_hz),
                            kBurrRenderingSettings.max_vibration_N);
  out.kick_N = allot_N(device.force_gain * settings.grip * sine * (pressed_N - state.mean_N),
                       kBurrRenderingSettings.max_kick_N);
  const double wave = std::sin(2 * std::numbers::pi * state.phase);
  contact.requested.force_N += along * (out.vibration_N * wave + out.kick_N);
}

}  // namespace

BurrSnapshot burr_snapshot(const SessionState::DeviceSession& session) {
  const BurrState& burr = session.burr;
  return {session.proxy.layer(std::max(burr.layer, 0)).position, press_direction_of(session), burr.front_mm2,
          burr.pressed_N, burr.work_mJ};
}

void render_burr(const TickContext& tick, const DeviceContext& context, const BurrConditions& conditions,
                 ToolContact& contact, SessionState::DeviceSession& session, DeviceTick& out) {
  const BurrSettings& settings = *context.tool.burr;
  const BurrState& burr = session.burr;

  const bool cuts = conditions.runs && burr.front_mm2 > 0 && std::isfinite(burr.energy_mJ_per_mm3);
  if (cuts) {
    out.cutting_N = burr.pressed_N;
    out.cutting_energy_mJ_per_mm3 = burr.energy_mJ_per_mm3;
  }
  const Burr head{.radius_mm = context.tool.radius_mm,
                  .revolutions_per_s = settings.revolutions_per_s,
                  .axis = context.in_patient(tick, settings.spindle),
                  .grip = settings.grip,
                  .max_press_N = 0,
                  .length_mm = settings.length_mm,
                  .end_radius_mm = settings.end_radius_mm};
  update_break_through(tick, head, conditions, contact, session);
  if (!settings.irrigation) update_temperature(tick, head, conditions, session, out);
  add_vibration(tick, context, conditions, cuts, contact, session, out);
}

}  // namespace palpate
