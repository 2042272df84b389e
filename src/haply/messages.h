#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/device/device.h"

/// What the Inverse Service says and is told. Its units are m, m/s and N, its axes World's.
namespace palpate::haply {

struct ServiceVersion {
  int major = 0, minor = 0;
  friend bool operator==(const ServiceVersion&, const ServiceVersion&) = default;
};
/// The first "3.1" or "3.1.0" in an answer, whatever stands around it.
std::optional<ServiceVersion> parse_version(std::string_view text);
/// "values" or "vector": one service takes no other's. nullptr: nobody knows what that version takes.
const char* force_key(const ServiceVersion& version);

/// What stands between a device and its force, as the service says it; what it does not say is not known.
struct Status {
  std::optional<bool> calibrated, power_supply, ready, started, in_use;
};

struct Inverse3 {
  std::string id;
  std::optional<Point<Device>> tip_mm;  ///< finite
  Vector<Device> velocity_mm_s{kNotKnown, kNotKnown, kNotKnown};
  Status status;
};

/// Of a grip, with wires or without.
struct Grip {
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();  ///< unit
  std::uint32_t buttons = 0;
};

struct State {
  std::vector<Inverse3> devices;
  std::vector<Grip> grips;
};

/// Whether a message of the service's events tells of a brake, or of a device that was unplugged.
bool tells_of_brake(std::string_view text);

/// True of a service that tells of events.
inline bool has_events(const ServiceVersion& version) {
  return version.major == 3 && version.minor >= 5;
}

/// A message of the service. Empty: it is no JSON, or has no list of devices. What in it is of another type
/// or no number is as though it were not there.
std::optional<State> parse_state(std::string_view text);

/// The beginning of a request up to the force of its only or next device is put together once, so that a
/// request is a few numbers between texts.
class RequestWriter {
 public:
  /// @param key  force_key()
  RequestWriter(const std::vector<std::string>& ids, const char* key);
  /// @param first     the first of a connection says who asks, and in which axes
  /// @param commands  one for each device; a force that is no number is none
  const std::string& write(bool first, std::span<const DeviceCommand> commands);

 private:
  std::vector<std::string> before_;  // each device's force
  std::string text_;
};

}  // namespace palpate::haply
