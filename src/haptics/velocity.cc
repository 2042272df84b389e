#include "base/hash.h"
#include "palpate/haptics.h"

namespace palpate {

void VelocityWindow::push(const Vector<Patient>& displacement_mm, double dt_s, double window_s) {
  // a full ring forgets its oldest entry
  if (count_ == kCapacity) {
    first_ = (first_ + 1) % kCapacity;
    --count_;
  }
  const int last = (first_ + count_) % kCapacity;
  x_[last] = displacement_mm.x();
  y_[last] = displacement_mm.y();
  z_[last] = displacement_mm.z();
  dt_[last] = dt_s;
  ++count_;

  // entries that the window does not need go; a little slack, because times are sums of rounded steps
  double time = 0;
  for (int i = 0; i < count_; ++i) time += dt_[(first_ + i) % kCapacity];
  while (count_ > 1 && time - dt_[first_] >= window_s - 1e-3 * dt_s) {
    time -= dt_[first_];
    first_ = (first_ + 1) % kCapacity;
    --count_;
  }
}

Vector<Patient> VelocityWindow::velocity_mm_s() const {
  double x = 0, y = 0, z = 0, time = 0;
  for (int i = 0; i < count_; ++i) {
    const int at = (first_ + i) % kCapacity;
    x += x_[at];
    y += y_[at];
    z += z_[at];
    time += dt_[at];
  }
  return time > 0 ? Vector<Patient>(x / time, y / time, z / time) : Vector<Patient>();
}

void VelocityWindow::hash_into(std::uint64_t& hash) const {
  hash_word(hash, static_cast<std::uint64_t>(count_));
  for (int i = 0; i < count_; ++i) {
    const int at = (first_ + i) % kCapacity;
    for (const double value : {x_[at], y_[at], z_[at], dt_[at]}) hash_double(hash, value);
  }
}

}  // namespace palpate
