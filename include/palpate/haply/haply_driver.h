#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "palpate/device/device.h"
#include "palpate/device/registry.h"

namespace palpate {

/// Where the Inverse Service of Haply listens, and how its device is driven.
struct HaplySettings {
  std::string host = "127.0.0.1";
  std::uint16_t old_http_port = 10000;  ///< version of services 3.0 and 3.1
  std::uint16_t port = 10001;           ///< WebSocket; from 3.5 on the version, too
  std::uint16_t events_port = 10020;    ///< WebSocket of events, from 3.5 on
  double peak_force_N = 3;              ///< the maker states none
  double max_rate_hz = 2000;            ///< exchanges a second, however fast the service answers
};

/// Haply's Inverse3, through the Inverse Service, a program of its maker's that holds the device and talks
/// JSON by a WebSocket. One request, one reply: the round trip is the tick (DeviceInfo::Drive::kExchange).
/// All Inverse3 that the service has at open() are devices of the driver, kMaxDevices at most; each has the
/// grip (orientation, buttons) of its place in the service's list.
///
/// **A fault** takes the force first: the samples say `fault` and the requests ask for zero, or none goes out
/// and the device goes idle by itself. Then trouble() says what it is. A lost service is looked for by a
/// thread of its own, ten times a second, and the session goes on with it when it is back. What is
/// awaited longer than kSilence_s is asked for zero without waiting any longer.
///
/// The exchange allocates (Beast, JSON); servo.update() does not.
///
/// Not tried on hardware: written from the maker's documentation.
class HaplyDriver final : public DeviceDriver {
 public:
  explicit HaplyDriver(const HaplySettings& settings = {});
  ~HaplyDriver() override;

  std::span<const DeviceInfo> devices() const override;
  /// Errors: kUnavailable where no service answers within some seconds, for one of a version that is not
  /// known, and where it has no Inverse3 that is ready.
  Result<void> open(bool may_move) override;
  void run(ServoFunction& servo, ServoClock& clock) noexcept override;
  void halt() noexcept override;
  void resume(std::uint64_t newest) noexcept override;
  std::optional<Error> trouble() const override;

  /// How long a reply is awaited before the servo is told the old state, which ages.
  static constexpr double kTimeout_s = 0.002;
  /// How long it is awaited before zero is asked for all the same.
  static constexpr double kSilence_s = 0.008;
  /// How long a brake or a disconnection that the service has told of is a fault.
  static constexpr double kBraked_s = 1;
  /// How long until the connection is given up and looked for anew.
  static constexpr double kGivenUp_s = 0.5;

 private:
  class Core;
  std::unique_ptr<Core> core_;
};

/// `--device haply`.
DeviceVendor haply_maker(const HaplySettings& settings = {});

}  // namespace palpate
