#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "palpate/device/device.h"

/// Simulated hand and device, used by all tests, on a virtual clock or on the real one.
namespace palpate {

template <class T>
class Mailbox;

/// Mechanical constants of a simulated device (methods: Abbott & Okamura 2005; Diolaiti 2006). SI units.
struct PlantDevice {
  std::string name;
  double mass_kg, damping_N_s_per_m, coulomb_N, encoder_step_m, peak_force_N, continuous_force_N;
  double reach_m = kNoValue;             ///< Radius of the reachable ball; not enforced by the simulation
  double stiffness_N_per_mm = kNoValue;  ///< Stiffness that the vendor vouches for
};
/// Model of the hand between intended and actual position: rigidly attached to the device's mass, or a mass
/// of its own behind the compliant skin of the fingers. SI units.
struct PlantHand {
  std::string name;
  double mass_kg, damping_N_s_per_m, stiffness_N_per_m;
  double skin_N_per_m = 0;  ///< Stiffness between the device and the hand's mass; 0: rigid
  double skin_N_s_per_m = 0;

  bool has_skin() const { return skin_N_per_m > 0; }
};

/// Built-in device models: "premium-1.5", "touch".
const std::vector<PlantDevice>& known_plant_devices();
/// Built-in hand models without skin: "light-grip", "firm-grip", "whole-arm".
const std::vector<PlantHand>& known_plant_hands();
/// Built-in hand models with skin: "pen-grip" and "firm-pen-grip", which are the light and the firm grip
/// holding a pen, and "fingertip", which rests on the device without holding it.
const std::vector<PlantHand>& plant_hands_with_skin();
/// Built-in models by name, hands without skin only. Errors: kBadInput for an unknown name.
Result<PlantDevice> find_plant_device(const std::string& name);
Result<PlantHand> find_plant_hand(const std::string& name);

/// A hand holding a device: intended position - hand - device mass - encoder (floor quantiser) - servo -
/// delay line - saturation - zero-order hold. Integrated by semi-implicit Euler in steps of 10 us, Coulomb
/// friction with stick. Deterministic: time advances only by advance(), which allocates nothing.
class SimulatedDevice {
 public:
  /// @param delay_s  delay from a command to its force, clamped to 0 ... kMaxDelay_s; NaN: 0
  SimulatedDevice(const PlantDevice& device, const PlantHand& hand, double delay_s = 0);
  static constexpr double kMaxDelay_s = 0.02;

  /// Device properties. The axes are World's; the workspace is the largest cube in the device's reach.
  DeviceInfo info() const;
  /// Places hand and device at rest at `tip`; a non-finite tip is ignored.
  void reset(const Point<Device>& tip);
  /// Sets the hand's intended position at the end of the next advance(); it moves there at constant velocity.
  /// A non-finite target is ignored.
  void intend(const Point<Device>& target) {
    if (target.all_finite()) target_mm_ = target;
  }
  Point<Device> intention() const { return target_mm_; }
  /// Sample as the encoders report it now.
  DeviceSample read() const;
  /// True tip position, unquantised, for tests and figures.
  Point<Device> true_tip() const;
  Vector<Device> true_velocity_mm_s() const;
  /// Work of the acting force along the tip's true path in the last advance(), mJ.
  double work_mJ() const { return work_mJ_; }
  /// Greatest duration of one advance().
  static constexpr double kMaxAdvance_s = 10;
  /// Holds the commanded force (saturated, delayed) and integrates the mechanics over dt_s. A non-finite
  /// force counts as zero. Unless dt_s is above 0 and at most kMaxAdvance_s, no time passes and nothing
  /// moves.
  void advance(const DeviceCommand& command, double dt_s);

 private:
  // commanded forces with the time from which each acts, oldest first; the first one is acting
  struct Command {
    double from_s;
    Eigen::Vector3d force_N;
  };
  void push(const Command& command);
  const Command& acting_at(double time_s);

  PlantDevice device_;
  PlantHand hand_;
  double delay_s_;
  Point<Device> target_mm_, previous_target_mm_;
  Eigen::Vector3d position_m_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d velocity_m_s_ = Eigen::Vector3d::Zero();
  // state of the hand's mass if it has skin
  Eigen::Vector3d hand_m_ = Eigen::Vector3d::Zero(), hand_m_s_ = Eigen::Vector3d::Zero();
  double time_s_ = 0, work_mJ_ = 0;
  std::array<Command, 512> delay_line_;  // ring buffer: kMaxDelay_s at more than 20 kHz
  std::size_t first_ = 0, count_ = 0;
};

/// The simulated device as a pulled driver on the real clock. In every tick the simulation advances by the
/// real time since the last one, under the command of that tick. run() allocates, locks and logs nothing and
/// makes no system call except those of its clock. It can be run repeatedly.
class SimulatedDriver final : public DeviceDriver {
 public:
  /// @param device  initial state; reset() it to the hand's starting position first
  /// @param now     clock for motion and sample times; nullptr: CLOCK_MONOTONIC
  explicit SimulatedDriver(const SimulatedDevice& device, TimeSource now = nullptr);
  ~SimulatedDriver() override;

  /// Moves the intended position at constant velocity from its current value to `target`, which it reaches at
  /// `at_ns` of the driver's clock and then holds. If that time has passed, it moves at once. A new call
  /// replaces the last one. From one thread at a time; never blocks.
  void intend(const Point<Device>& target, std::int64_t at_ns) noexcept;

  std::span<const DeviceInfo> devices() const override { return {&info_, 1}; }
  Result<void> open(bool may_move) override;
  void run(ServoFunction& servo, ServoClock& clock) noexcept override;
  void halt() noexcept override { halted_.store(true); }
  void resume(std::uint64_t /*newest*/) noexcept override { halted_.store(false); }

  /// The simulation, for tests and figures. Calling it while run() is active is a bug.
  const SimulatedDevice& device() const;
  Point<Device> true_tip() const { return device().true_tip(); }

  /// Longest real time that one tick simulates. In a longer stall the simulation stands still for the rest.
  static constexpr double kMaxAdvance_s = 0.1;

 private:
  struct Intention {
    Point<Device> target;
    std::int64_t at_ns = 0;
  };
  void lead_hand(std::int64_t now_ns);

  const TimeSource now_;
  SimulatedDevice device_;
  DeviceInfo info_;
  std::unique_ptr<Mailbox<Intention>> intentions_;
  std::atomic<bool> halted_{false}, running_{false};
  // motion of the intended position: from one place and time to another
  Point<Device> from_;
  std::int64_t from_ns_ = 0;
  Intention to_;
  std::int64_t last_ns_ = 0;  // time up to which the simulation has been advanced
};

}  // namespace palpate
