#include "base/hash.h"
#include "palpate/servo.h"

namespace palpate {
namespace {

void hash_quaternion(std::uint64_t& hash, const Eigen::Quaterniond& q) {
  for (const double value : {q.w(), q.x(), q.y(), q.z()}) hash_double(hash, value);
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
  for (int d = 0; d < devices; ++d) {
    hash_word(hash, hands[d].seen);
    for (int axis = 0; axis < 3; ++axis) hash_double(hash, hands[d].previous_tip[axis]);
    hands[d].velocity.hash_into(hash);
  }
  return hash_finish(hash);
}

}  // namespace palpate
