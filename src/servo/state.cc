#include "palpate/base/hash.h"
#include "palpate/servo/servo.h"

namespace palpate {
namespace {

// As a part of hash(): called, each of them would keep the count of words in memory, and every word wait for
// that.

// what hashes itself
template <class Part>
[[gnu::always_inline]] inline void hash_part(HashOfWords& hash, const Part& part) {
  std::uint64_t of_part = kHashSeed;
  part.hash_into(of_part);
  hash.add_word(of_part);
}

[[gnu::always_inline]] inline void hash_quaternion(HashOfWords& hash, const Eigen::Quaterniond& q) {
  for (const double value : {q.w(), q.x(), q.y(), q.z()}) hash.add_double(value);
}

[[gnu::always_inline]] inline void hash_wrench(HashOfWords& hash, const Wrench& wrench) {
  for (int axis = 0; axis < 3; ++axis) hash.add_double(wrench.force_N[axis]);
  for (int axis = 0; axis < 3; ++axis) hash.add_double(wrench.torque_Nmm[axis]);
  hash.add_double(wrench.gripper_N);
}

[[gnu::always_inline]] inline void hash_layer(HashOfWords& hash, const ProxyLayer& proxy) {
  hash.add_word(static_cast<std::uint64_t>(proxy.coupled) << 1 | static_cast<std::uint64_t>(proxy.sticking));
  // it begins anew, and there may be no such layer
  if (!proxy.coupled && proxy.punctured.none()) return;
  for (int axis = 0; axis < 3; ++axis) {
    hash.add_double(proxy.position[axis]);
    hash.add_double(proxy.last_way[axis]);
  }
  hash_quaternion(hash, proxy.attitude);
  constexpr std::size_t kWord = 64;
  constexpr SurfaceSet low(~std::uint64_t{0});
  for (std::size_t bit = 0; bit < kMostSurfaces; bit += kWord)
    hash.add_word((proxy.punctured >> bit & low).to_ullong());
  hash.add_double(proxy.part);
  hash.add_double(proxy.spring_N_per_mm.value_or(-1));
  hash.add_double(proxy.behind_mm);
  hash.add_double(proxy.lost_s);
  hash.add_word(static_cast<std::uint64_t>(proxy.contacts));
  for (int n = 0; n < proxy.contacts; ++n) {
    const ProxyContact& contact = proxy.contact[static_cast<std::size_t>(n)];
    hash.add_word(static_cast<std::uint64_t>(contact.surface) << 8 |
                  static_cast<std::uint64_t>(contact.sphere));
    for (int axis = 0; axis < 3; ++axis) hash.add_double(contact.normal[axis]);
    // of a sphere it is 0, and left out
    if (contact.part != 0) hash.add_double(contact.part);
    hash.add_double(contact.pull_mm);
  }
}

void hash_burr(HashOfWords& hash, const BurrState& burr) {
  for (const double value :
       {burr.inset_mm, burr.sunk_mm, burr.spare_mJ, burr.pressed_N, burr.edge_mm_per_s, burr.front_mm2,
        burr.energy_mJ_per_mm3, burr.work_mJ, burr.taken_mm3, burr.open_s})
    hash.add_double(value);
  hash.add_word(static_cast<std::uint64_t>(burr.layer) << 2 | static_cast<std::uint64_t>(burr.closed) << 1 |
                static_cast<std::uint64_t>(burr.full));
  if (burr.began_axis_mm != Vector<Patient>())
    for (int axis = 0; axis < 3; ++axis) hash.add_double(burr.began_axis_mm[axis]);
  hash.add_word(burr.first);
  for (const Sweep& sweep : burr.pending()) {
    for (int axis = 0; axis < 3; ++axis) {
      hash.add_double(sweep.from[axis]);
      hash.add_double(sweep.to[axis]);
    }
    hash.add_double(sweep.radius_mm);
    hash.add_word(sweep.stroke);
    if (sweep.is_of_ball()) continue;
    for (int axis = 0; axis < 3; ++axis) hash.add_double(sweep.axis_mm[axis]);
    hash.add_double(sweep.end_radius_mm);
  }
}

}  // namespace

std::uint64_t SessionState::hash(int devices) const {
  HashOfWords hash;
  hash.add_word(tick);
  hash.add_double(time_s);
  hash_quaternion(hash, rotation_start);
  hash_quaternion(hash, rotation_target);
  hash_quaternion(hash, rotation_felt);
  hash.add_double(rotation_elapsed_s);
  hash.add_word(made_by);
  // a tool that is no burr makes none
  if (strokes > 0) hash.add_word(std::uint64_t{strokes} << 1 | static_cast<std::uint64_t>(motor_on));
  // where nothing ever yielded there are none
  if (last_unfelt_frame > 0) hash.add_word(last_unfelt_frame);
  // of tissue that closes there are none
  if (!holes.empty()) hash_part(hash, holes);
  for (int d = 0; d < devices; ++d) {
    hash.add_word(hands[d].seen);
    for (int axis = 0; axis < 3; ++axis) {
      hash.add_double(hands[d].previous_world[axis]);
      hash.add_double(hands[d].previous_tip[axis]);
    }
    hash_part(hash, hands[d].velocity);
    for (int n = 0; n < kMostLayers; ++n) hash_layer(hash, hands[d].proxy.layer(n));
    // of a proxy that touches nothing it does not matter
    if (const ProxyState& proxy = hands[d].proxy; proxy.stiffness_N_per_mm > 0) {
      for (int axis = 0; axis < 3; ++axis) hash.add_double(proxy.tip[axis]);
      hash.add_double(proxy.stiffness_N_per_mm);
    }
    if (hands[d].proxy.yield.modulus_N_per_mm2 > 0) hash_part(hash, hands[d].proxy.yield);
    if (hands[d].proxy.relaxation.remembers()) hash_part(hash, hands[d].proxy.relaxation);
    hash.add_word(hands[d].proxy_version);
    hash.add_word(hands[d].held_directly);
    const CouplingState& coupling = hands[d].coupling;
    hash.add_double(coupling.stiffness_N_per_mm);
    for (int axis = 0; axis < 3; ++axis) hash.add_double(coupling.pull_mm[axis]);
    hash_part(hash, coupling.pull_velocity);
    // a tool that is no burr has none
    if (hands[d].burr.open_s > 0) hash_burr(hash, hands[d].burr);
    hash_wrench(hash, hands[d].asked);
    hash_wrench(hash, hands[d].difference);
    hash.add_double(hands[d].blend_elapsed_s);
    const PassivityState& passivity = hands[d].passivity;
    for (const double value :
         {passivity.energy_mJ, passivity.way_mm, passivity.time_s, passivity.speed_mm_s, passivity.play_mm})
      hash.add_double(value);
    hash.add_word(passivity.gives_way);
    const BounceState& bounce = passivity.bounce;
    for (const double value : {bounce.fell_mm_s, bounce.time_s, bounce.depth_mm, bounce.push_N_s,
                               bounce.pushed_N_s2, bounce.back_N_s2_mm, bounce.squares_N2_s4})
      hash.add_double(value);
    hash.add_word(bounce.touched);
    const SwingState& swing = hands[d].swing;
    for (int axis = 0; axis < 3; ++axis) {
      hash.add_double(swing.axis[axis]);
      hash.add_double(swing.aside_mm[axis]);
    }
    for (const double value : {swing.way_mm, swing.time_s, swing.farthest_mm, swing.farthest_s,
                               swing.before_mm, swing.free_s, swing.later_s})
      hash.add_double(value);
    hash.add_word(static_cast<std::uint64_t>(swing.halves));
    hash.add_word(static_cast<std::uint64_t>(hands[d].delay.count) << 1 |
                  static_cast<std::uint64_t>(hands[d].delay.forgot));
    for (int n = 0; n < hands[d].delay.count; ++n) {
      const DelayLine::Held& held = hands[d].delay.held[static_cast<std::size_t>(n)];
      for (int axis = 0; axis < 3; ++axis) hash.add_double(held.force_N[axis]);
      hash.add_double(held.time_s);
    }
    hash.add_double(hands[d].turned_mJ);
    hash_wrench(hash, hands[d].output.sent);
    hash.add_double(hands[d].output.gain);
    hash.add_double(hands[d].output.heat);
    hash.add_double(hands[d].output.whole_s);
    hash.add_word(static_cast<std::uint64_t>(hands[d].output.away) << 1 |
                  static_cast<std::uint64_t>(hands[d].output.returning));
  }
  return hash.value();
}

}  // namespace palpate
