#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "palpate/device/device.h"
#include "palpate/device/registry.h"

namespace palpate {

/// Connection to Haply's Inverse Service, and limits of its device.
struct HaplySettings {
  std::string host = "127.0.0.1";
  std::uint16_t old_http_port = 10000;  ///< HTTP port with the version of services 3.0 and 3.1
  std::uint16_t port = 10001;           ///< WebSocket; from 3.5 on also HTTP with the version
  std::uint16_t events_port = 10020;    ///< WebSocket of events, from 3.5 on
  double peak_force_N = 3;              ///< Force limit; the vendor specifies none
  double max_rate_hz = 2000;            ///< Maximum number of exchanges per second
};

/// Driver of Haply's Inverse3 through the Inverse Service, a program of the vendor that owns the device and
/// exchanges JSON over a WebSocket. One request, one reply: the round trip is the tick
/// (DeviceInfo::Drive::kExchange). All Inverse3 that the service lists at open() are devices of the driver,
/// at most kMaxDevices; each uses the grip (orientation, buttons) at the same position of the service's list.
///
/// **Fault handling**: the force is removed first. Samples are marked `fault`, and the requests ask for zero
/// force, or none is sent and the device goes idle by itself. failure() then describes the fault. A separate
/// thread searches for a lost service ten times a second, and the session continues when it is found. If a
/// reply takes longer than kSilence_s, zero force is requested without waiting for it.
///
/// The exchange allocates (Beast, JSON); servo.update() does not.
///
/// Not tested on hardware: written from the vendor's documentation.
class HaplyDriver final : public DeviceDriver {
 public:
  explicit HaplyDriver(const HaplySettings& settings = {});
  ~HaplyDriver() override;

  std::span<const DeviceInfo> devices() const override;
  /// Errors: kUnavailable if no service answers within some seconds, if its version is unknown, or if it has
  /// no Inverse3 that is ready.
  Result<void> open(bool may_move) override;
  void run(ServoFunction& servo, ServoClock& clock) noexcept override;
  void halt() noexcept override;
  void resume(std::uint64_t newest) noexcept override;
  std::optional<Error> failure() const override;

  /// Timeout of a reply, after which the servo runs with the previous state, whose age increases.
  static constexpr double kTimeout_s = 0.002;
  /// Timeout of a reply, after which zero force is requested.
  static constexpr double kSilence_s = 0.008;
  /// Duration for which a brake or disconnection event counts as a fault.
  static constexpr double kBraked_s = 1;
  /// Timeout after which the connection is closed and the service searched for.
  static constexpr double kAbandoned_s = 0.5;

 private:
  class Core;
  std::unique_ptr<Core> core_;
};

/// The device option `--device haply`.
DeviceVendor haply_vendor(const HaplySettings& settings = {});

}  // namespace palpate
