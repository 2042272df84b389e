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

/// The Inverse Service as its documentation tells it, with a simulated hand and device inside. Written from
/// the tables of the maker's protocol and not from the driver. What breaks its rules is counted, and has no
/// effect: a first message without a session, a later one with it, a force by another version's key, what
/// is no JSON.
class FakeInverseService {
 public:
  /// @param version  as it says it: "3.0.2" and "3.1.1" at a port of their own, "3.5.0" where its WebSocket
  /// is
  explicit FakeInverseService(const SimulatedDevice& device, std::string version = "3.1.1");
  ~FakeInverseService();

  HaplySettings settings() const;
  /// It is killed, and nobody listens any more.
  void stop();
  /// At the same ports, perhaps in another version.
  void start(const std::string& version);
  /// Where its hand wants to be from now on.
  void intend(const Point<Device>& tip);

  // ---- faults, each until it is taken back
  std::atomic<bool> silent{false};       ///< reads and acts, and answers nothing
  std::atomic<bool> deaf{false};         ///< does not even read
  std::atomic<bool> breaks_json{false};  ///< half of each answer
  std::atomic<bool> says_other{false};   ///< JSON of something else
  std::atomic<bool> odd_place{false};    ///< a place that is no number
  std::atomic<double> pushes_hz{0};      ///< sends states without being asked, each of its own moment
  std::atomic<int> answers_each{1};      ///< so many to each request, all of them of its moment
  std::atomic<bool> hoards{false};  ///< keeps its states to itself, and sends them one after the other later
  std::atomic<bool> tells_time{
      false};  ///< as the z of its places, in mm: ms of monotonic_ns() modulo kEra_ns
  std::atomic<bool> calibrated{true}, power{true}, ready{true}, present{true}, in_use{false};
  std::atomic<std::uint32_t> buttons{0};
  std::atomic<double> turned_rad{0};  ///< of the grip, about z
  void close_connections();
  /// Tells whoever listens to its events, which a service has from 3.5 on.
  void tell_event(const std::string& text);
  int event_listeners() const { return event_listeners_; }

  // ---- what was done
  /// One for every force, and one whenever the device goes idle, which it does after kIdle_ns without one or
  /// when who asked is gone.
  std::vector<Delivery> delivered() const { return delivered_.all(); }
  int violations() const { return violations_; }
  /// N, of the device now; 0 while it is idle.
  double force_N() const { return force_N_; }
  std::uint64_t messages() const { return messages_; }
  std::string last_message() const;
  /// The longest that a state which it did not hoard took into the socket, on a machine that has much to do.
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

  mutable std::mutex mutex_;  // of what follows
  std::string version_, last_message_;
  std::vector<int> sockets_;
  std::vector<std::thread> sessions_;
  RealTimePlant plant_;
  DeviceCommand acting_;

  std::string event_;  // of the mutex above; the newest
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
