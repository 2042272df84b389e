#pragma once

#include <array>
#include <atomic>
#include <cstdint>

/// What a test says to the stand-in for libHD (test_fake_hd.cc, a library of its own that is built for tests
/// alone) and hears from it. Written from the reference's tables and not from the driver.
namespace palpate::testing {

/// A device behind the library, with a hand that holds it. Places in its own axes.
struct FakeHdDevice {
  // ---- by the test
  std::atomic<const char*> config{"Default PHANToM"};  ///< and NULL, of the first one
  std::atomic<const char*> model{"Touch"};
  std::atomic<const char*> serial{"4711"};
  std::atomic<bool> plugged{true};
  std::atomic<double> max_force_N{3.3}, continuous_N{0.88}, stiffness_N_per_mm{0};  ///< 0: not answered
  std::atomic<int> rate_hz{1000};
  std::atomic<int> style{2};           ///< of calibration, a sum: 1 reset, 2 auto, 4 inkwell
  std::atomic<bool> calibrated{true};  ///< false: an update is wanted, or a hand (inkwell)
  std::atomic<bool> in_inkwell{true};  ///< an update works
  std::atomic<bool> never_calibrates{false};
  std::atomic<unsigned> error{0};         ///< pushed once, in the next frame
  std::atomic<bool> communication{true};  ///< false: every frame fails
  std::atomic<bool> nowhere{false}, crooked{false};
  std::atomic<bool> mute{false};       ///< its state is asked for, and nothing is written, nor an error told
  std::atomic<bool> unguarded{false};  ///< its guards cannot be switched on
  std::atomic<double> velocity_x_mm_s{0}, velocity_y_mm_s{0}, velocity_z_mm_s{0};  ///< beside the hand's
  std::atomic<double> intended_x_mm{1.2}, intended_y_mm{0}, intended_z_mm{0};
  std::atomic<double> turned_rad{0};  ///< about y
  std::atomic<int> buttons{0};
  // ---- by the library
  std::atomic<double> force_N{0};  ///< that acts
  std::atomic<double> asked_x_N{0}, asked_y_N{0}, asked_z_N{0};
  std::atomic<double> largest_N{0};
  std::atomic<std::uint64_t> frames{0};
  std::atomic<int> inits{0}, updates{0};
  std::atomic<bool> force_on{false}, ramping{false}, clamping{false};
};

struct FakeHd {
  std::array<FakeHdDevice, 2> device;
  std::atomic<bool> licence{true};
  std::atomic<bool> null_name{true};    ///< NULL is a name
  std::atomic<bool> stalled{false};     ///< the scheduler calls nobody
  std::atomic<bool> hangs{false};       ///< a frame's beginning does not come back, nor is it waited for
  std::atomic<bool> stop_hangs{false};  ///< the scheduler's stop does not come back
  std::atomic<bool> running{false}, scheduled{false};
  /// Rules of the documentation that were broken, and the first of them.
  std::atomic<int> violations{0};
  std::atomic<const char*> first_violation{""};
  /// As at the beginning. Only while nothing is initialised.
  void (*reset)() = nullptr;
};

using FakeHdFunction = FakeHd* (*)();
inline constexpr const char* kFakeHdFunction = "palpate_fake_hd";

}  // namespace palpate::testing
