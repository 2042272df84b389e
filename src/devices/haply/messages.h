#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/device/device.h"

/// Messages of the Inverse Service. Units are m, m/s and N; axes are those of World.
namespace palpate::haply {

struct ServiceVersion {
  int major = 0, minor = 0;
  friend bool operator==(const ServiceVersion&, const ServiceVersion&) = default;
};
/// First version number such as "3.1" or "3.1.0" in a text.
std::optional<ServiceVersion> parse_version(std::string_view text);
/// JSON key of the force, "values" or "vector"; services accept only their own. nullptr: unsupported version.
const char* force_key(const ServiceVersion& version);

/// Conditions for force output, as reported by the service; empty: not reported.
struct Status {
  std::optional<bool> calibrated, power_supply, ready, started, in_use;
};

struct Inverse3 {
  std::string id;
  std::optional<Point<Device>> tip_mm;  ///< Finite
  Vector<Device> velocity_mm_s{kNoValue, kNoValue, kNoValue};
  Status status;
};

/// A grip, wired or wireless.
struct Grip {
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();  ///< Unit quaternion
  std::uint32_t buttons = 0;
};

struct State {
  std::vector<Inverse3> devices;
  std::vector<Grip> grips;
};

/// Whether an event message reports a brake or a disconnected device.
bool reports_brake(std::string_view text);

/// Whether services of this version send events.
inline bool has_events(const ServiceVersion& version) {
  return version.major == 3 && version.minor >= 5;
}

/// Parses a state message. Empty: invalid JSON, or no list of devices. Members of the wrong type and
/// non-finite numbers are treated as absent.
std::optional<State> parse_state(std::string_view text);

/// Writes requests. The text before each device's force is prepared once, so that a request only formats a
/// few numbers.
class RequestWriter {
 public:
  /// @param key  result of force_key()
  RequestWriter(const std::vector<std::string>& ids, const char* key);
  /// @param first     whether it is the first request of a connection, which declares the session and its
  ///                  axes
  /// @param commands  one per device; a non-finite force is written as zero
  const std::string& write(bool first, std::span<const DeviceCommand> commands);

 private:
  std::vector<std::string> before_;  // text before each device's force
  std::string text_;
};

}  // namespace palpate::haply
