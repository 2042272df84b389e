#pragma once

#include <array>
#include <atomic>
#include <cstdint>

/// What a test says to the stand-in for Force Dimension's library (test_fake_dhd.cc, a library of its own
/// that is built for tests alone) and hears from it. Written from the reference's tables and not from the
/// driver.
namespace palpate::testing {

/// A device behind the library, with a hand that holds it. Places in its own axes.
struct FakeDhdDevice {
  // ---- by the test
  std::atomic<int> type{33};
  std::atomic<bool> left{false};
  std::atomic<unsigned short> serial{117};
  std::atomic<bool> plugged{true}, power{true}, in_use{false}, error{false}, initialised{true};
  std::atomic<bool> fails{false};      ///< every call about it fails
  std::atomic<bool> mute{false};       ///< and of its pose alone
  std::atomic<bool> deaf{false};       ///< and of forces alone: it holds what it was told last
  std::atomic<bool> old{false};        ///< states are old ones, TIMEGUARD, and hold anything
  std::atomic<bool> nowhere{false};    ///< its place is no number
  std::atomic<bool> crooked{false};    ///< its frame is no turn
  std::atomic<bool> saturated{false};  ///< its motors give less than they are asked for
  /// What it says of its velocity, m/s along each axis, in place of the hand's own.
  std::atomic<bool> says_velocity{false};
  std::atomic<double> velocity_x_m_s{0}, velocity_y_m_s{0}, velocity_z_m_s{0};
  /// Switches forces off once, as the device does by itself: 1 button, 2 velocity, 3 watchdog, 5 USB, 6
  /// dead man's switch. Of button, USB and dead man's switch they come back when `restored` is set.
  std::atomic<int> trip{0};
  std::atomic<bool> restored{false};
  std::atomic<double> intended_x_mm{1.2}, intended_y_mm{0}, intended_z_mm{0};
  std::atomic<double> turned_rad{0}, gripper_rad{0};  ///< turned about z
  std::atomic<unsigned> buttons{0};
  // ---- by the library
  std::atomic<double> force_N{0};  ///< that acts
  std::atomic<double> asked_x_N{0}, asked_y_N{0}, asked_z_N{0}, asked_x_Nm{0}, asked_y_Nm{0}, asked_z_Nm{0};
  std::atomic<double> asked_gripper_N{0};  ///< of the last call
  std::atomic<double> largest_N{0}, max_force_N{-1}, held_kg{-1};
  std::atomic<int> gravity{-1};          ///< -1: was never said
  std::atomic<std::uint64_t> forces{0};  ///< calls
  std::atomic<int> opened{0}, auto_inits{0}, brakes{0};
  std::atomic<bool> forces_on{false};
};

struct FakeDhd {
  std::array<FakeDhdDevice, 4> device;
  std::atomic<int> count{1};
  std::atomic<bool> auto_init_fails{false};
  /// Rules of the library's documentation that were broken, and the first of them.
  std::atomic<int> violations{0};
  std::atomic<const char*> first_violation{""};
  /// As at the beginning. Only while nothing is open.
  void (*reset)() = nullptr;
};

/// The library's one function that is not the maker's.
using FakeDhdFunction = FakeDhd* (*)();
inline constexpr const char* kFakeDhdFunction = "palpate_fake_dhd";

}  // namespace palpate::testing
