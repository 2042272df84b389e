#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "palpate/device/device.h"

/// The simulated hand and device on which everything is tested, on a virtual clock and on the real one.
namespace palpate {

template <class T>
class Mailbox;

/// Mechanical constants of a simulated device (methods: Abbott & Okamura 2005; Diolaiti 2006). SI.
struct PlantDevice {
  std::string name;
  double mass_kg, damping_N_s_per_m, coulomb_N, encoder_step_m, peak_force_N, continuous_force_N;
  double reach_m =
      kNotKnown;  ///< radius of the ball that the tip can be led through; the plant does not end there
  double stiffness_N_per_mm = kNotKnown;  ///< the most that the maker vouches for
};
/// The hand between the intended and the actual position: of one mass with the device, or of a mass of its
/// own behind the skin of the fingers. SI.
struct PlantHand {
  std::string name;
  double mass_kg, damping_N_s_per_m, stiffness_N_per_m;
  double skin_N_per_m = 0;  ///< between the device and the hand's mass; 0: they are one
  double skin_N_s_per_m = 0;

  bool has_skin() const { return skin_N_per_m > 0; }
};

/// "premium-1.5", "touch"
const std::vector<PlantDevice>& known_plant_devices();
/// "light-grip", "firm-grip", "whole-arm"
const std::vector<PlantHand>& known_plant_hands();
/// Hands that have skin: "pen-grip", "firm-pen-grip" as the light and the firm grip hold a pen, and
/// "fingertip" which only rests on the device.
const std::vector<PlantHand>& plant_hands_with_skin();
Result<PlantDevice> find_plant_device(const std::string& name);
Result<PlantHand> find_plant_hand(const std::string& name);

/// A hand holding a device: intended position - hand - device mass - encoder (floor quantiser) - servo -
/// delay line - saturation - zero-order hold. Semi-implicit Euler in steps of 10 us, Coulomb friction with
/// stick. Deterministic; time is what advance() is told. advance() allocates nothing.
class SimulatedDevice {
 public:
  /// @param delay_s  from a command to its force; kMostDelay_s at most
  SimulatedDevice(const PlantDevice& device, const PlantHand& hand, double delay_s = 0);
  static constexpr double kMostDelay_s = 0.02;

  /// Axes are World's. The workspace is the largest cube in the device's reach.
  DeviceInfo info() const;
  /// Places everything at rest at `tip`.
  void reset(const Point<Device>& tip);
  /// Where the hand wants the tip to be at the end of the next advance; it moves there evenly.
  void intend(const Point<Device>& target) { target_mm_ = target; }
  Point<Device> intention() const { return target_mm_; }
  /// What the encoders say now.
  DeviceSample read() const;
  /// The true tip, unquantised, for tests and figures.
  Point<Device> true_tip() const;
  Vector<Device> true_velocity_mm_s() const;
  /// Work of the force that acted, over the true way of the tip, in the last advance().
  double work_mJ() const { return work_mJ_; }
  /// Holds the commanded force (saturated, delayed) and integrates the mechanics for dt.
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
  // of a hand that has skin
  Eigen::Vector3d hand_m_ = Eigen::Vector3d::Zero(), hand_m_s_ = Eigen::Vector3d::Zero();
  double time_s_ = 0, work_mJ_ = 0;
  std::array<Command, 512> line_;  // a ring: kMostDelay_s at more than 20 kHz
  std::size_t first_ = 0, count_ = 0;
};

/// The simulated device as a driver, pulled, on the real clock: in every tick the plant goes on by the real
/// time since the tick before, under the command of that tick. run() allocates, locks and logs nothing and
/// makes no system call but those of its clock. It may be run again after it has ended.
class SimulatedDriver final : public DeviceDriver {
 public:
  /// @param device  as it stands: reset() it to where the hand shall begin
  /// @param now  the clock by which it moves and stamps its samples; none: CLOCK_MONOTONIC
  explicit SimulatedDriver(const SimulatedDevice& device, TimeSource now = nullptr);
  ~SimulatedDriver() override;

  /// The hand moves evenly from where it wants to be now to `target`, gets there at `at_ns` of
  /// its clock, and rests. A time that has passed: at once. The latest one holds. Any one thread; never
  /// waits.
  void intend(const Point<Device>& target, std::int64_t at_ns) noexcept;

  std::span<const DeviceInfo> devices() const override { return {&info_, 1}; }
  Result<void> open(bool may_move) override;
  void run(ServoFunction& servo, ServoClock& clock) noexcept override;
  void halt() noexcept override { halted_.store(true); }
  void resume(std::uint64_t /*newest*/) noexcept override { halted_.store(false); }

  /// The plant, for tests and figures. Only while run() does not run: anything else is a bug.
  const SimulatedDevice& device() const;
  Point<Device> true_tip() const { return device().true_tip(); }

  /// The most real time that one tick makes up for. A longer stall is time in which the plant stands still.
  static constexpr double kMostAdvance_s = 0.1;

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
  // the way of the hand: from where and when to where and when
  Point<Device> from_;
  std::int64_t from_ns_ = 0;
  Intention to_;
  std::int64_t last_ns_ = 0;  // up to when the plant has been advanced
};

}  // namespace palpate
