#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

#include "palpate/device/simulated_device.h"

/// Test drivers of the kinds with a clock of their own, and their counterparts: a vendor's scheduler that
/// calls back, and a peer that answers requests. Each holds a SimulatedDevice on the real clock, so that
/// samples respond to forces.
namespace palpate::testing {

/// Clock advanced by a test's servo, independent of the machine's load; starts at one hour.
inline std::atomic<std::int64_t> virtual_ns{3'600'000'000'000};
inline std::int64_t virtual_time() noexcept {
  return virtual_ns;
}

/// The servo's clock in a test: evenly spaced ticks until it is stopped.
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

/// A command that a device received, and its state at that time.
struct Delivery {
  std::int64_t at_ns = 0;
  DeviceCommand command;
  DeviceSample sample;
  bool idle = false;  ///< Sent by the device itself, because no command arrived
};

/// Commands that a device received, in order. Any thread.
class DeliveryLog {
 public:
  void add(const Delivery& delivery);
  std::vector<Delivery> all() const;

 private:
  mutable std::mutex mutex_;
  std::vector<Delivery> all_;
};

/// Simulated device that advances by the real time between two calls.
class RealTimePlant {
 public:
  explicit RealTimePlant(const SimulatedDevice& device);
  /// Advances to now under `acting`; returns the encoders' sample.
  DeviceSample advance(const DeviceCommand& acting);
  DeviceInfo info() const { return device_.info(); }
  void intend(const Point<Device>& tip) { device_.intend(tip); }

 private:
  SimulatedDevice device_;
  std::int64_t last_ns_;
};

/// Stand-in for a vendor's library modelled on HDAPI: one scheduler thread calls back; states are read and
/// forces set between begin and end of a frame, on that thread only. Violations of these rules are counted
/// and have no effect. A force acts from the end of its frame.
class FakeVendor {
 public:
  explicit FakeVendor(const SimulatedDevice& device) : plant_(device) {}
  ~FakeVendor() { unschedule(); }

  /// Starts the scheduler, which calls `callback` once a period until it returns false.
  void schedule(std::function<bool()> callback);
  bool scheduled() const { return scheduled_; }
  /// Stops calling back; returns once a running callback has returned.
  void unschedule();

  void begin_frame();
  void end_frame();
  DeviceSample state();
  void set_force(const DeviceCommand& command);
  /// Motor switch: while off, no force acts. Any thread, inside or outside a frame.
  void enable_force(bool on) { enabled_ = on; }

  DeviceInfo info() const { return plant_.info(); }
  int violations() const { return violations_; }
  /// One entry per frame.
  std::vector<Delivery> delivered() const { return delivered_.all(); }

  static constexpr std::int64_t kPeriod_ns = 500'000;

 private:
  bool may_call(bool in_frame);

  RealTimePlant plant_;
  std::thread scheduler_;
  std::atomic<std::thread::id> scheduler_id_{};
  std::atomic<bool> scheduled_{false}, enabled_{true};
  std::atomic<int> violations_{0};
  // owned by the scheduler's thread
  bool in_frame_ = false;
  DeviceSample sample_;
  DeviceCommand set_, acting_;
  DeliveryLog delivered_;
};

/// Driver that is called back inside the vendor's frame: DeviceInfo::Drive::kCallback.
class CallbackDriver final : public DeviceDriver {
 public:
  /// @param moves_by_itself  calibration moves the arm
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

/// Remote end of a connection, which holds a device and sends one reply per request. Without a request for
/// kIdle_ns the device goes idle and exerts no force.
class FakePeer {
 public:
  explicit FakePeer(const SimulatedDevice& device);
  ~FakePeer();

  struct Request {
    std::uint64_t number;
    Eigen::Vector3d force_N;
  };
  struct Reply {
    std::uint64_t number;  ///< Number of its request
    Eigen::Vector3d tip_mm;
  };
  /// The driver's end of the socket; message boundaries are preserved.
  int socket() const { return near_; }
  /// While on, requests are received but not answered.
  void silence(bool on) { silent_ = on; }

  DeviceInfo info() const { return plant_.info(); }
  /// One entry per request, and one each time the device goes idle.
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

/// Driver with one reply per request, each round trip a tick: DeviceInfo::Drive::kExchange.
class ExchangeDriver final : public DeviceDriver {
 public:
  explicit ExchangeDriver(FakePeer& peer);
  std::span<const DeviceInfo> devices() const override { return {&info_, 1}; }
  Result<void> open(bool may_move) override { return require_consent(info_, may_move); }
  void run(ServoFunction& servo, ServoClock& clock) noexcept override;
  void halt() noexcept override { halted_ = true; }
  void resume(std::uint64_t /*newest*/) noexcept override { halted_ = false; }

  /// Time to wait for a reply before the servo gets the previous state, which ages.
  static constexpr int kTimeout_ms = 2;

 private:
  void exchange(const DeviceCommand& command, DeviceSample& sample) noexcept;

  FakePeer& peer_;
  DeviceInfo info_;
  std::uint64_t number_ = 0;
  std::atomic<bool> halted_{false};
};

}  // namespace palpate::testing
