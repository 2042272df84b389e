#include "palpate/contact/velocity.h"

#include "palpate/base/hash.h"

namespace palpate {

void VelocityWindow::push(const Vector<Patient>& displacement_mm, double dt_s, double window_s) {
  const auto drop_oldest = [&] {
    before_window_ = sums_[first_];
    first_ = (first_ + 1) % kCapacity;
    --count_;
  };
  if (count_ == kCapacity) drop_oldest();
  now_.displacement_mm += displacement_mm;
  now_.time_s += dt_s;
  sums_[(first_ + count_) % kCapacity] = now_;
  ++count_;
  for (int axis = 0; axis < 3; ++axis) hash_double(pushed_, displacement_mm[axis]);
  hash_double(pushed_, dt_s);

  // drops entries older than the window, with a tolerance because the times are sums of rounded steps
  while (count_ > 1 && now_.time_s - sums_[first_].time_s >= window_s - 1e-3 * dt_s) drop_oldest();
}

Vector<Patient> VelocityWindow::velocity_mm_s() const {
  const double time_s = now_.time_s - before_window_.time_s;
  return time_s > 0 ? (now_.displacement_mm - before_window_.displacement_mm) / time_s : Vector<Patient>();
}

void VelocityWindow::hash_into(std::uint64_t& hash) const {
  hash_word(hash, static_cast<std::uint64_t>(count_));
  hash_word(hash, pushed_);
}

}  // namespace palpate
