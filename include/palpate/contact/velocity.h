#pragma once

#include <array>
#include <cstdint>

#include "palpate/contact/contact_settings.h"
#include "palpate/geometry/geometry.h"

namespace palpate {

/// Velocity over a sliding time window: sum of displacements over sum of times of the last `window_s` seconds
/// (MERL c. 1997; 0.01 s), never a one-tick difference. Stored as running sums, so that a push costs the same
/// at every tick rate.
class VelocityWindow {
 public:
  static constexpr int kCapacity = 128;  ///< Entries; 0.01 s at up to 10 kHz with margin
  void push(const Vector<Patient>& displacement_mm, double dt_s,
            double window_s = kContactSettings.velocity_window_s);
  /// Mean velocity in the window, mm/s; zero before the first push.
  Vector<Patient> velocity_mm_s() const;
  void clear() { *this = {}; }
  /// Mixes all pushes since the last clear() into a state hash.
  void hash_into(std::uint64_t& hash) const;

 private:
  // running sums after a push
  struct Sum {
    Vector<Patient> displacement_mm;
    double time_s = 0;
  };
  Sum now_, before_window_;
  std::array<Sum, kCapacity> sums_;
  int first_ = 0, count_ = 0;
  std::uint64_t pushed_ = 0;  // hash of all pushes
};

}  // namespace palpate
