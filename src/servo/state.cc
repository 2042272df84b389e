#include "palpate/base/hash.h"
#include "palpate/servo/servo.h"

namespace palpate {
namespace {

void hash_quaternion(std::uint64_t& hash, const Eigen::Quaterniond& q) {
  for (const double value : {q.w(), q.x(), q.y(), q.z()}) hash_double(hash, value);
}

void hash_wrench(std::uint64_t& hash, const Wrench& wrench) {
  for (int axis = 0; axis < 3; ++axis) hash_double(hash, wrench.force_N[axis]);
  for (int axis = 0; axis < 3; ++axis) hash_double(hash, wrench.torque_Nmm[axis]);
  hash_double(hash, wrench.gripper_N);
}

void hash_layer(std::uint64_t& hash, const ProxyLayer& proxy) {
  hash_word(hash,
            static_cast<std::uint64_t>(proxy.coupled) << 1 | static_cast<std::uint64_t>(proxy.sticking));
  // it begins anew, and there may be no such layer
  if (!proxy.coupled && proxy.punctured.none()) return;
  for (int axis = 0; axis < 3; ++axis) {
    hash_double(hash, proxy.position[axis]);
    hash_double(hash, proxy.last_way[axis]);
  }
  hash_quaternion(hash, proxy.attitude);
  constexpr std::size_t kWord = 64;
  constexpr SurfaceSet low(~std::uint64_t{0});
  for (std::size_t bit = 0; bit < kMostSurfaces; bit += kWord)
    hash_word(hash, (proxy.punctured >> bit & low).to_ullong());
  hash_double(hash, proxy.part);
  hash_double(hash, proxy.spring_N_per_mm.value_or(-1));
  hash_double(hash, proxy.behind_mm);
  hash_double(hash, proxy.lost_s);
  hash_word(hash, static_cast<std::uint64_t>(proxy.contacts));
  for (int n = 0; n < proxy.contacts; ++n) {
    const ProxyContact& contact = proxy.contact[static_cast<std::size_t>(n)];
    hash_word(hash,
              static_cast<std::uint64_t>(contact.surface) << 8 | static_cast<std::uint64_t>(contact.sphere));
    for (int axis = 0; axis < 3; ++axis) hash_double(hash, contact.normal[axis]);
    // of a sphere it is 0, and left out
    if (contact.part != 0) hash_double(hash, contact.part);
    hash_double(hash, contact.pull_mm);
  }
}

void hash_burr(std::uint64_t& hash, const BurrState& burr) {
  for (const double value :
       {burr.inset_mm, burr.sunk_mm, burr.spare_mJ, burr.pressed_N, burr.edge_mm_per_s, burr.front_mm2,
        burr.energy_mJ_per_mm3, burr.work_mJ, burr.taken_mm3, burr.open_s})
    hash_double(hash, value);
  hash_word(hash, static_cast<std::uint64_t>(burr.layer) << 2 | static_cast<std::uint64_t>(burr.closed) << 1 |
                      static_cast<std::uint64_t>(burr.full));
  if (burr.began_axis_mm != Vector<Patient>())
    for (int axis = 0; axis < 3; ++axis) hash_double(hash, burr.began_axis_mm[axis]);
  hash_word(hash, burr.first);
  for (const Sweep& sweep : burr.pending()) {
    for (int axis = 0; axis < 3; ++axis) {
      hash_double(hash, sweep.from[axis]);
      hash_double(hash, sweep.to[axis]);
    }
    hash_double(hash, sweep.radius_mm);
    hash_word(hash, sweep.stroke);
    if (sweep.is_of_ball()) continue;
    for (int axis = 0; axis < 3; ++axis) hash_double(hash, sweep.axis_mm[axis]);
    hash_double(hash, sweep.end_radius_mm);
  }
}

}  // namespace

std::uint64_t SessionState::hash(int devices) const {
  std::uint64_t hash = kHashSeed;
  hash_word(hash, tick);
  hash_double(hash, time_s);
  hash_quaternion(hash, rotation_start);
  hash_quaternion(hash, rotation_target);
  hash_quaternion(hash, rotation_felt);
  hash_double(hash, rotation_elapsed_s);
  hash_word(hash, made_by);
  // a tool that is no burr makes none
  if (strokes > 0) hash_word(hash, std::uint64_t{strokes} << 1 | static_cast<std::uint64_t>(motor_on));
  // where nothing ever yielded there are none
  if (last_unfelt_frame > 0) hash_word(hash, last_unfelt_frame);
  // of tissue that closes there are none
  if (!holes.empty()) holes.hash_into(hash);
  for (int d = 0; d < devices; ++d) {
    hash_word(hash, hands[d].seen);
    for (int axis = 0; axis < 3; ++axis) {
      hash_double(hash, hands[d].previous_world[axis]);
      hash_double(hash, hands[d].previous_tip[axis]);
    }
    hands[d].velocity.hash_into(hash);
    for (int n = 0; n < kMostLayers; ++n) hash_layer(hash, hands[d].proxy.layer(n));
    // of a proxy that touches nothing it does not matter
    if (const ProxyState& proxy = hands[d].proxy; proxy.stiffness_N_per_mm > 0) {
      for (int axis = 0; axis < 3; ++axis) hash_double(hash, proxy.tip[axis]);
      hash_double(hash, proxy.stiffness_N_per_mm);
    }
    if (hands[d].proxy.yield.modulus_N_per_mm2 > 0) hands[d].proxy.yield.hash_into(hash);
    if (hands[d].proxy.relaxation.remembers()) hands[d].proxy.relaxation.hash_into(hash);
    hash_word(hash, hands[d].proxy_version);
    hash_word(hash, hands[d].held_directly);
    const CouplingState& coupling = hands[d].coupling;
    hash_double(hash, coupling.stiffness_N_per_mm);
    for (int axis = 0; axis < 3; ++axis) hash_double(hash, coupling.pull_mm[axis]);
    coupling.pull_velocity.hash_into(hash);
    // a tool that is no burr has none
    if (hands[d].burr.open_s > 0) hash_burr(hash, hands[d].burr);
    hash_wrench(hash, hands[d].asked);
    hash_wrench(hash, hands[d].difference);
    hash_double(hash, hands[d].blend_elapsed_s);
    const PassivityState& passivity = hands[d].passivity;
    for (const double value :
         {passivity.energy_mJ, passivity.way_mm, passivity.time_s, passivity.speed_mm_s, passivity.play_mm})
      hash_double(hash, value);
    hash_word(hash, passivity.gives_way);
    const BounceState& bounce = passivity.bounce;
    for (const double value : {bounce.fell_mm_s, bounce.time_s, bounce.depth_mm, bounce.push_N_s,
                               bounce.pushed_N_s2, bounce.back_N_s2_mm, bounce.squares_N2_s4})
      hash_double(hash, value);
    hash_word(hash, bounce.touched);
    const SwingState& swing = hands[d].swing;
    for (int axis = 0; axis < 3; ++axis) {
      hash_double(hash, swing.axis[axis]);
      hash_double(hash, swing.aside_mm[axis]);
    }
    for (const double value : {swing.way_mm, swing.time_s, swing.farthest_mm, swing.farthest_s,
                               swing.before_mm, swing.free_s, swing.later_s})
      hash_double(hash, value);
    hash_word(hash, static_cast<std::uint64_t>(swing.halves));
    hash_word(hash, static_cast<std::uint64_t>(hands[d].delay.count) << 1 |
                        static_cast<std::uint64_t>(hands[d].delay.forgot));
    for (int n = 0; n < hands[d].delay.count; ++n) {
      const DelayLine::Held& held = hands[d].delay.held[static_cast<std::size_t>(n)];
      for (int axis = 0; axis < 3; ++axis) hash_double(hash, held.force_N[axis]);
      hash_double(hash, held.time_s);
    }
    hash_double(hash, hands[d].turned_mJ);
    hash_wrench(hash, hands[d].output.sent);
    hash_double(hash, hands[d].output.gain);
    hash_double(hash, hands[d].output.heat);
    hash_double(hash, hands[d].output.whole_s);
    hash_word(hash, static_cast<std::uint64_t>(hands[d].output.away) << 1 |
                        static_cast<std::uint64_t>(hands[d].output.returning));
  }
  return hash_finish(hash);
}

}  // namespace palpate
