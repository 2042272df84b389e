#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "device/test_drivers.h"
#include "palpate/haply/haply_driver.h"

namespace palpate::testing {

/// Fake Inverse Service with a simulated hand and device, implemented from the tables of the vendor's
/// protocol, independently of the driver. Protocol violations are counted and have no effect: a first message
/// without a session, a later one with it, a force with the key of another version, invalid JSON.
class FakeInverseService {
 public:
  /// @param version  reported version: "3.0.2" and "3.1.1" serve it on a separate port, "3.5.0" on the
  ///                 WebSocket's
  explicit FakeInverseService(const SimulatedDevice& device, std::string version = "3.1.1");
  ~FakeInverseService();

  HaplySettings settings() const;
  /// Kills the service; the ports are closed.
  void stop();
  /// Restarts it on the same ports, possibly with another version.
  void start(const std::string& version);
  /// Sets the target of the simulated hand.
  void intend(const Point<Device>& tip);

  // ---- faults, each active until reset
  std::atomic<bool> silent{false};        ///< Reads and acts, but does not reply
  std::atomic<bool> deaf{false};          ///< Does not read
  std::atomic<bool> breaks_json{false};   ///< Truncates each reply to half
  std::atomic<bool> says_other{false};    ///< Replies with unrelated JSON
  std::atomic<bool> odd_position{false};  ///< Sends a non-finite position
  /// Rate of unsolicited states, each with its own time of sampling; 0: none
  std::atomic<double> pushes_hz{0};
  std::atomic<int> answers_each{1};           ///< Number of replies per request, all with the same state
  std::atomic<bool> withholds_states{false};  ///< Withholds its states, and sends them all later
  std::atomic<bool> encodes_time{
      false};  ///< Encodes the time in the z coordinate in mm: milliseconds of monotonic_ns() modulo kEra_ns
  std::atomic<bool> calibrated{true}, power{true}, ready{true}, present{true}, in_use{false};
  std::atomic<std::uint32_t> buttons{0};
  std::atomic<double> turned_rad{0};  ///< Rotation of the grip about z
  void close_connections();
  /// Sends an event to all listeners, from version 3.5 on.
  void report_event(const std::string& text);
  int event_listeners() const { return event_listeners_; }

  // ---- observations
  /// Log of deliveries: one per force, and one whenever the device goes idle, after kIdle_ns without a force
  /// or when the client disconnects.
  std::vector<Delivery> delivered() const { return delivered_.all(); }
  int violations() const { return violations_; }
  /// Current force of the device, N; 0 while idle.
  double force_N() const { return force_N_; }
  std::uint64_t messages() const { return messages_; }
  std::string last_message() const;
  /// Longest time from sampling a state that was not withheld to writing it to the socket, which grows with
  /// the load on the machine.
  double max_late_ms() const { return max_late_ms_; }
  int connections() const { return connections_; }

  static constexpr std::int64_t kIdle_ns = 20'000'000;
  static constexpr std::int64_t kEra_ns = 1'000'000'000'000;

 private:
  struct Listener;
  class Session;
  void listen(Listener& listener);
  void serve(int socket);
  bool is_old() const;
  std::string state_text(const DeviceSample& sample, bool inventory) const;

  mutable std::mutex mutex_;  // protects the following members
  std::string version_, last_message_;
  std::vector<int> sockets_;
  std::vector<std::thread> sessions_;
  RealTimePlant plant_;
  DeviceCommand acting_;

  std::string event_;  // protected by mutex_; the latest event
  std::atomic<int> events_{0}, event_listeners_{0};

  std::uint16_t port_ = 0, http_port_ = 0, events_port_ = 0;
  std::atomic<bool> ended_{false};
  std::vector<std::unique_ptr<Listener>> listeners_;
  DeliveryLog delivered_;
  std::atomic<int> violations_{0}, connections_{0};
  std::atomic<std::uint64_t> messages_{0};
  std::atomic<double> force_N_{0}, max_late_ms_{0};
};

}  // namespace palpate::testing
