#include <array>
#include <bit>
#include <cstdint>

#include "palpate/base/hash.h"
#include "palpate/servo/servo.h"

namespace palpate {
namespace {

// Functions are forced inline so that the hash's count of pending words stays in a register.

// types that hash themselves
template <class Part>
[[gnu::always_inline]] inline void hash_part(WordHasher& hash, const Part& part) {
  std::uint64_t of_part = kHashSeed;
  part.hash_into(of_part);
  hash.add(of_part);
}

template <class Place>
[[gnu::always_inline]] inline void hash_point(WordHasher& hash, const Place& p) {
  hash.add(p.x(), p.y(), p.z());
}

[[gnu::always_inline]] inline void hash_quaternion(WordHasher& hash, const Eigen::Quaterniond& q) {
  hash.add(q.w(), q.x(), q.y(), q.z());
}

[[gnu::always_inline]] inline void hash_wrench(WordHasher& hash, const Wrench& wrench) {
  const Vector<World>&force_N = wrench.force_N, &torque_Nmm = wrench.torque_Nmm;
  hash.add(force_N.x(), force_N.y(), force_N.z(), torque_Nmm.x(), torque_Nmm.y(), torque_Nmm.z(),
           wrench.gripper_N);
}

// usually empty
void hash_surfaces(WordHasher& hash, const SurfaceSet& surfaces) {
  hash.add(static_cast<std::uint64_t>(surfaces.any()));
  if (surfaces.none()) return;
  // hashes the words of the bit set directly: shifts of the whole set cost more
  for (const std::uint64_t bits : std::bit_cast<std::array<std::uint64_t, kMaxSurfaces / 64>>(surfaces))
    hash.add(bits);
}

[[gnu::always_inline]] inline void hash_layer(WordHasher& hash, const ProxyLayer& proxy) {
  hash.add(static_cast<std::uint64_t>(proxy.coupled) << 1 | static_cast<std::uint64_t>(proxy.sticking));
  // an uncoupled layer is reinitialised before use, and the layer may not exist
  if (!proxy.coupled && proxy.punctured.none()) return;
  hash_point(hash, proxy.position);
  hash_point(hash, proxy.last_displacement);
  hash_quaternion(hash, proxy.attitude);
  hash_surfaces(hash, proxy.punctured);
  hash.add(proxy.stretch_fraction, proxy.spring_N_per_mm.value_or(-1), proxy.catch_up_mm, proxy.stranded_s,
           proxy.contact_count);
  for (int n = 0; n < proxy.contact_count; ++n) {
    const ProxyContact& contact = proxy.contacts[static_cast<std::size_t>(n)];
    const std::uint64_t of =
        static_cast<std::uint64_t>(contact.surface) << 8 | static_cast<std::uint64_t>(contact.part);
    hash.add(of, contact.normal.x(), contact.normal.y(), contact.normal.z(), contact.axis_fraction,
             contact.multiplier_mm);
  }
}

void hash_burr(WordHasher& hash, const BurrState& burr) {
  hash.add(burr.inset_mm, burr.penetration_mm, burr.unspent_work_mJ, burr.pressed_N, burr.edge_speed_mm_s,
           burr.front_mm2, burr.energy_mJ_per_mm3, burr.work_mJ, burr.removed_mm3, burr.sweep_age_s);
  hash.add(static_cast<std::uint64_t>(burr.layer) << 2 | static_cast<std::uint64_t>(burr.sweep_closed) << 1 |
           static_cast<std::uint64_t>(burr.sweeps_full));
  if (burr.sweep_start_axis_mm != Vector<Patient>()) hash_point(hash, burr.sweep_start_axis_mm);
  hash.add(burr.first_sweep);
  // only burrs in thin bone have an energy debt
  if (burr.debt_mJ > 0 || burr.thin_ticks > 0) {
    hash.add(burr.balance_mJ[kThick], burr.balance_mJ[kThin], burr.debt_mJ, burr.debt_mJ_per_mm3);
    hash.add(burr.thin_ticks);
  }
  for (const Sweep& sweep : burr.pending()) {
    hash_point(hash, sweep.from);
    hash_point(hash, sweep.to);
    hash.add(sweep.radius_mm, sweep.stroke);
    if (sweep.is_of_ball()) continue;
    hash_point(hash, sweep.axis_mm);
    hash.add(sweep.end_radius_mm);
  }
}

void hash_device(WordHasher& hash, const SessionState::DeviceSession& session) {
  hash.add(session.has_previous);
  hash_point(hash, session.previous_world);
  hash_point(hash, session.previous_tip);
  hash_part(hash, session.velocity);
  for (int n = 0; n < kMaxLayers; ++n) hash_layer(hash, session.proxy.layer(n));
  // without contact stiffness the proxy's tip has no effect
  if (const ProxyState& proxy = session.proxy; proxy.stiffness_N_per_mm > 0) {
    hash_point(hash, proxy.tip);
    hash.add(proxy.stiffness_N_per_mm);
  }
  if (const ProxyState& proxy = session.proxy; proxy.contact_count > 0) {
    hash_point(hash, proxy.free_tip);
    hash_quaternion(hash, proxy.free_attitude);
    hash_point(hash, proxy.last_search_tip);
  }
  if (const ResidualForce& release = session.proxy.release; release.force_N != Vector<Patient>()) {
    hash_point(hash, release.force_N);
    hash_point(hash, release.torque_Nmm);
    hash.add(release.stored_mJ);
  }
  if (session.proxy.compliance.modulus_N_per_mm2 > 0) hash_part(hash, session.proxy.compliance);
  if (session.proxy.relaxation.is_active()) hash_part(hash, session.proxy.relaxation);
  if (session.tissue_contact.is_known()) hash_part(hash, session.tissue_contact);
  const CouplingState& coupling = session.coupling;
  hash.add(session.proxy_version, session.pushed_by_direct_method, coupling.stiffness_N_per_mm);
  hash_point(hash, coupling.spring_mm);
  hash_part(hash, coupling.spring_velocity);
  // only burrs have this state
  if (session.burr.sweep_age_s > 0) hash_burr(hash, session.burr);
  if (const BurrRenderingState& burr = session.burr_rendering; burr.is_used())
    hash.add(burr.frequency_hz, burr.phase, burr.mean_N, burr.break_through_s, burr.bone_rise_K,
             burr.is_wall_thin);
  hash_wrench(hash, session.requested);
  hash_wrench(hash, session.difference);
  const PassivityState& passivity = session.passivity;
  hash.add(session.blend_elapsed_s, passivity.energy_mJ, passivity.displacement_mm, passivity.time_s,
           passivity.speed_mm_s, passivity.dead_band_mm, passivity.moves_with_force);
  const ReboundState& rebound = passivity.rebound;
  hash.add(rebound.impact_mm_s, rebound.time_s, rebound.depth_mm, rebound.impulse_N_s,
           rebound.impulse_integral_N_s2, rebound.sum_lag_impulse_N_s2_mm, rebound.sum_impulse_squared_N2_s4,
           rebound.touched);
  const OscillationState& oscillation = session.oscillation;
  hash_point(hash, oscillation.axis);
  hash_point(hash, oscillation.lateral_mm);
  hash.add(oscillation.displacement_mm, oscillation.time_s, oscillation.farthest_mm, oscillation.farthest_s,
           oscillation.previous_amplitude_mm, oscillation.free_space_s, oscillation.extra_delay_s,
           oscillation.half_cycles);
  hash.add(session.delay.count, session.delay.dropped_older);
  for (int n = 0; n < session.delay.count; ++n) {
    const DelayLine::Sample& sample = session.delay.samples[static_cast<std::size_t>(n)];
    hash.add(sample.force_N.x(), sample.force_N.y(), sample.force_N.z(), sample.time_s);
  }
  hash.add(session.turned_mJ);
  hash_wrench(hash, session.output.sent);
  hash.add(session.output.gain, session.output.heat, session.output.since_fault_s, session.output.in_dropout,
           session.output.returning);
}

}  // namespace

void SessionState::DeviceSession::reset_contact() {
  proxy = {};
  coupling = {};
  tissue_contact = {};
}

void SessionState::DeviceSession::reset_path() {
  reset_contact();
  has_previous = false;
  velocity.clear();
  requested = {};
  pushed_by_direct_method = false;
  passivity = {};
  oscillation = {};
  delay = {};
}

std::uint64_t SessionState::hash(int devices) const {
  WordHasher hash;
  hash.add(tick, time_s);
  hash_quaternion(hash, rotation_start);
  hash_quaternion(hash, rotation_target);
  hash_quaternion(hash, rotation_applied);
  hash.add(rotation_elapsed_s, force_source);
  // only burrs make strokes
  if (strokes > 0) hash.add(std::uint64_t{strokes} << 1 | static_cast<std::uint64_t>(motor_on));
  // 0 if no tissue was ever deformable
  if (last_ignored_solver_frame > 0) hash.add(last_ignored_solver_frame);
  // empty if all punctures close
  if (!holes.empty()) hash_part(hash, holes);
  for (int d = 0; d < devices; ++d) hash_device(hash, device[d]);
  return hash.value();
}

}  // namespace palpate
