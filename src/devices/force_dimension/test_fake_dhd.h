#pragma once

#include <array>
#include <atomic>
#include <cstdint>

/// Interface between tests and the fake of Force Dimension's library (test_fake_dhd.cc, a separate library
/// that is built for tests only). Written from the tables of the reference, independently of the driver.
namespace palpate::testing {

/// A device behind the library, held by a simulated hand. Positions are in its own axes.
struct FakeDhdDevice {
  // ---- set by the test
  std::atomic<int> type{33};
  std::atomic<bool> left{false};
  std::atomic<unsigned short> serial{117};
  std::atomic<bool> plugged{true}, power{true}, in_use{false}, error{false}, initialised{true};
  std::atomic<bool> fails{false};      ///< Every call for the device fails
  std::atomic<bool> mute{false};       ///< Only pose queries fail
  std::atomic<bool> deaf{false};       ///< Only force commands fail: it keeps the last one
  std::atomic<bool> old{false};        ///< States are old (TIMEGUARD), with arbitrary contents
  std::atomic<bool> nowhere{false};    ///< The position is not finite
  std::atomic<bool> crooked{false};    ///< The frame is not a rotation
  std::atomic<bool> saturated{false};  ///< The motors give less than commanded
  /// Reports this velocity, m/s along each axis, instead of the hand's.
  std::atomic<bool> says_velocity{false};
  std::atomic<double> velocity_x_m_s{0}, velocity_y_m_s{0}, velocity_z_m_s{0};
  /// Disables forces once, as the device does by itself: 1 button, 2 velocity, 3 watchdog, 5 USB, 6 dead
  /// man's switch. For button, USB and dead man's switch they are enabled when `restored` is set.
  std::atomic<int> trip{0};
  std::atomic<bool> restored{false};
  std::atomic<double> intended_x_mm{1.2}, intended_y_mm{0}, intended_z_mm{0};
  std::atomic<double> turned_rad{0}, gripper_rad{0};  ///< Rotation about z, and angle of the gripper
  std::atomic<unsigned> buttons{0};
  // ---- set by the library
  std::atomic<double> force_N{0};  ///< Acting force
  std::atomic<double> requested_x_N{0}, requested_y_N{0}, requested_z_N{0}, requested_x_Nm{0},
      requested_y_Nm{0}, requested_z_Nm{0};
  std::atomic<double> requested_gripper_N{0};  ///< Command of the last call
  std::atomic<double> largest_N{0}, max_force_N{-1}, held_kg{-1};
  std::atomic<int> gravity{-1};          ///< -1: never set
  std::atomic<std::uint64_t> forces{0};  ///< Number of force commands
  std::atomic<int> opened{0}, auto_inits{0}, brakes{0};
  std::atomic<bool> forces_on{false};
};

struct FakeDhd {
  std::array<FakeDhdDevice, 4> device;
  std::atomic<int> count{1};
  std::atomic<bool> auto_init_fails{false};
  /// Number of violations of the library's documented rules, and the first of them.
  std::atomic<int> violations{0};
  std::atomic<const char*> first_violation{""};
  /// Resets everything. Only valid while no device is open.
  void (*reset)() = nullptr;
};

/// The only exported function that the vendor's library does not have.
using FakeDhdFunction = FakeDhd* (*)();
inline constexpr const char* kFakeDhdFunction = "palpate_fake_dhd";

}  // namespace palpate::testing
