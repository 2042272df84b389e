#pragma once

#include <array>
#include <atomic>
#include <cstdint>

/// Interface between tests and the fake of libHD (test_fake_hd.cc, a separate library that is built for tests
/// only). Written from the tables of the reference, independently of the driver.
namespace palpate::testing {

/// A device behind the library, held by a simulated hand. Positions are in its own axes.
struct FakeHdDevice {
  // ---- set by the test
  std::atomic<const char*> config{"Default PHANToM"};  ///< The first device is also found under NULL
  std::atomic<const char*> model{"Touch"};
  std::atomic<const char*> serial{"4711"};
  std::atomic<bool> plugged{true};
  /// Values reported by the device; 0: not reported
  std::atomic<double> max_force_N{3.3}, continuous_N{0.88}, stiffness_N_per_mm{0};
  std::atomic<int> rate_hz{1000};
  std::atomic<int> style{2};  ///< Calibration styles, bit set: 1 reset, 2 auto, 4 inkwell
  std::atomic<bool> calibrated{
      true};  ///< Whether it is calibrated; false: needs an update, or manual action (inkwell)
  std::atomic<bool> in_inkwell{true};  ///< Whether an update succeeds
  std::atomic<bool> never_calibrates{false};
  std::atomic<unsigned> error{0};         ///< Raised once, in the next frame
  std::atomic<bool> communication{true};  ///< Whether frames succeed; false: every frame fails
  std::atomic<bool> nowhere{false}, crooked{false};
  std::atomic<bool> mute{false};       ///< State queries write nothing and raise no error
  std::atomic<bool> unguarded{false};  ///< The safety limits cannot be enabled
  /// Added to the hand's velocity
  std::atomic<double> velocity_x_mm_s{0}, velocity_y_mm_s{0}, velocity_z_mm_s{0};
  std::atomic<double> intended_x_mm{1.2}, intended_y_mm{0}, intended_z_mm{0};
  std::atomic<double> turned_rad{0};  ///< About y
  std::atomic<int> buttons{0};
  // ---- set by the library
  std::atomic<double> force_N{0};  ///< Acting force
  std::atomic<double> requested_x_N{0}, requested_y_N{0}, requested_z_N{0};
  std::atomic<double> largest_N{0};
  std::atomic<std::uint64_t> frames{0};
  std::atomic<int> inits{0}, updates{0};
  std::atomic<bool> force_on{false}, ramping{false}, clamping{false};
};

struct FakeHd {
  std::array<FakeHdDevice, 2> device;
  std::atomic<bool> licence{true};
  std::atomic<bool> null_name{true};    ///< Whether NULL is a valid name
  std::atomic<bool> stalled{false};     ///< The scheduler makes no calls
  std::atomic<bool> hangs{false};       ///< Beginning a frame blocks, and stopping does not wait for it
  std::atomic<bool> stop_hangs{false};  ///< Stopping the scheduler blocks
  std::atomic<bool> running{false}, scheduled{false};
  /// Number of violations of the documented rules, and the first of them.
  std::atomic<int> violations{0};
  std::atomic<const char*> first_violation{""};
  /// Resets everything. Only valid while no device is initialised.
  void (*reset)() = nullptr;
};

using FakeHdFunction = FakeHd* (*)();
inline constexpr const char* kFakeHdFunction = "palpate_fake_hd";

}  // namespace palpate::testing
