#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

#include "palpate/device/simulated_device.h"

/// Drivers of the kinds that have a clock of their own, for tests, with what stands behind them: a vendor's
/// scheduler that calls back, and a peer that answers requests. Each holds a SimulatedDevice on the real
/// clock, so that the samples tell what a force does.
namespace palpate::testing {

/// A clock that a test's servo turns on, whatever the machine has to do; it has run for an hour.
inline std::atomic<std::int64_t> virtual_ns{3'600'000'000'000};
inline std::int64_t virtual_time() noexcept {
  return virtual_ns;
}

/// The servo's clock in a test: even ticks until it is stopped.
class TestClock final : public ServoClock {
 public:
  explicit TestClock(std::int64_t period_ns = 500'000) : period_ns_(period_ns) {}
  bool wait() noexcept override;
  bool stopped() const noexcept override { return stopped_; }
  void stop() { stopped_ = true; }

 private:
  const std::int64_t period_ns_;
  std::atomic<bool> stopped_{false};
};

/// A command that a device was given, and its state then.
struct Delivery {
  std::int64_t at_ns = 0;
  DeviceCommand command;
  DeviceSample sample;
  bool idle = false;  ///< by the device itself, because no command came
};

/// What a device was given, in order. Any thread.
class DeliveryLog {
 public:
  void add(const Delivery& delivery);
  std::vector<Delivery> all() const;

 private:
  mutable std::mutex mutex_;
  std::vector<Delivery> all_;
};

/// A plant that goes on by the real time between two looks at it.
class RealTimePlant {
 public:
  explicit RealTimePlant(const SimulatedDevice& device);
  /// Up to now under `acting`; what the encoders say then.
  DeviceSample advance(const DeviceCommand& acting);
  DeviceInfo info() const { return device_.info(); }
  void intend(const Point<Device>& tip) { device_.intend(tip); }

 private:
  SimulatedDevice device_;
  std::int64_t last_ns_;
};

/// A vendor's library in the manner of HDAPI: one scheduler thread calls back; states are read and forces set
/// between the begin and the end of a frame, by that thread alone. What breaks these rules is counted and has
/// no effect. A force acts from the end of its frame.
class FakeVendor {
 public:
  explicit FakeVendor(const SimulatedDevice& device) : plant_(device) {}
  ~FakeVendor() { unschedule(); }

  /// Starts the scheduler: `callback` once a period, until it returns false.
  void schedule(std::function<bool()> callback);
  bool scheduled() const { return scheduled_; }
  /// Calls no more, and returns when the callback has.
  void unschedule();

  void begin_frame();
  void end_frame();
  DeviceSample state();
  void set_force(const DeviceCommand& command);
  /// The motors' switch: off, no force acts. Any thread, in a frame or not.
  void enable_force(bool on) { enabled_ = on; }

  DeviceInfo info() const { return plant_.info(); }
  int violations() const { return violations_; }
  /// One for every frame.
  std::vector<Delivery> delivered() const { return delivered_.all(); }

  static constexpr std::int64_t kPeriod_ns = 500'000;

 private:
  bool may_call(bool in_frame);

  RealTimePlant plant_;
  std::thread scheduler_;
  std::atomic<std::thread::id> scheduler_id_{};
  std::atomic<bool> scheduled_{false}, enabled_{true};
  std::atomic<int> violations_{0};
  // of the scheduler's thread
  bool in_frame_ = false;
  DeviceSample sample_;
  DeviceCommand set_, acting_;
  DeliveryLog delivered_;
};

/// Called back inside the vendor's frame: DeviceInfo::Drive::kCallback.
class CallbackDriver final : public DeviceDriver {
 public:
  /// @param moves_by_itself  its calibration moves the arm
  explicit CallbackDriver(FakeVendor& vendor, bool moves_by_itself = false);
  std::span<const DeviceInfo> devices() const override { return {&info_, 1}; }
  Result<void> open(bool may_move) override { return require_consent(info_, may_move); }
  void run(ServoFunction& servo, ServoClock& clock) noexcept override;
  void halt() noexcept override;
  void resume(std::uint64_t newest) noexcept override;

 private:
  FakeVendor& vendor_;
  DeviceInfo info_;
  std::atomic<bool> halted_{false};
};

/// The far end of a connection, which holds a device: one reply for every request. Where none comes for
/// kIdle_ns the device goes idle, without force.
class FakePeer {
 public:
  explicit FakePeer(const SimulatedDevice& device);
  ~FakePeer();

  struct Request {
    std::uint64_t number;
    Eigen::Vector3d force_N;
  };
  struct Reply {
    std::uint64_t number;  ///< of its request
    Eigen::Vector3d tip_mm;
  };
  /// The driver's end: messages keep their bounds.
  int socket() const { return near_; }
  /// Takes requests and answers none, until told otherwise.
  void silence(bool on) { silent_ = on; }

  DeviceInfo info() const { return plant_.info(); }
  /// One for every request, and one whenever the device goes idle.
  std::vector<Delivery> delivered() const { return delivered_.all(); }

  static constexpr std::int64_t kIdle_ns = 20'000'000;

 private:
  void serve();

  RealTimePlant plant_;
  int near_ = -1, far_ = -1;
  std::atomic<bool> silent_{false}, ended_{false};
  DeliveryLog delivered_;
  std::thread thread_;
};

/// One request, one reply, the round trip is the tick: DeviceInfo::Drive::kExchange.
class ExchangeDriver final : public DeviceDriver {
 public:
  explicit ExchangeDriver(FakePeer& peer);
  std::span<const DeviceInfo> devices() const override { return {&info_, 1}; }
  Result<void> open(bool may_move) override { return require_consent(info_, may_move); }
  void run(ServoFunction& servo, ServoClock& clock) noexcept override;
  void halt() noexcept override { halted_ = true; }
  void resume(std::uint64_t /*newest*/) noexcept override { halted_ = false; }

  /// How long a reply is awaited before the servo is told the old state, which ages.
  static constexpr int kTimeout_ms = 2;

 private:
  void exchange(const DeviceCommand& command, DeviceSample& sample) noexcept;

  FakePeer& peer_;
  DeviceInfo info_;
  std::uint64_t number_ = 0;
  std::atomic<bool> halted_{false};
};

}  // namespace palpate::testing
