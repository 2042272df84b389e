#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"
#include "palpate/navigation/pivot.h"
#include "palpate/navigation/registration.h"

/// Poses of a tracking system, received by OpenIGTLink from PLUS or a compatible server.
namespace palpate {

/// Network address of a tracker's server.
struct TrackerAddress {
  std::string host;
  int port = 18944;  ///< Default port of PLUS

  std::string text() const;  ///< "host:port", in the form that parse_tracker_address accepts
};
/// Parses "HOST:PORT" or "[::1]:PORT". Empty: not an address.
std::optional<TrackerAddress> parse_tracker_address(const std::string& text);

/// Settings of TrackerStream.
struct TrackerSettings {
  TrackerAddress address;
  /// Name of the tool markers' transform, "StylusToTracker"; empty: no pose is expected
  std::string transform;
  /// Name of the patient markers' transform, "ReferenceToTracker": poses are then relative to the reference.
  /// Empty: relative to the tracking system, so the patient must not move.
  std::string reference;
};

/// Pose of a tool's markers.
struct MarkersPose {
  Transform<Tracker, TrackedTool> tracker_from_tool;
  /// Time of arrival, CLOCK_MONOTONIC; the unknown latency of the measurement is not subtracted
  std::int64_t at_ns = 0;
};

/// Client of a tracker's server that reconnects by itself. A thread reads as fast as the server sends, so
/// that no data queue up, and passes the poses to a callback.
///
///    connecting ──► greeted ──► reading ──► closed, malformed data, silent for 5 s
///        ▲            (a STATUS of version 2, so that PLUS reports whether a tool was seen)  │
///        └───────────────────── after a fifth of a second ───────────────────────────────────┘
///
/// With a reference, only pairs of poses with time stamps less than 5 ms apart are used, which is true within
/// one frame of the cameras.
class TrackerStream {
 public:
  /// @param on_pose  called with each valid pose, on the stream's thread, after open()
  TrackerStream(const TrackerSettings& settings, std::function<void(const MarkersPose&)> on_pose);
  ~TrackerStream();

  /// Connects, and waits until the tool is seen; without a transform until any data arrived. A second call
  /// does nothing. Errors: kUnavailable with what is missing, kInterrupted.
  /// @param patience_s  time limit for each of the two
  Result<void> open(double patience_s = 3, const Progress& progress = {});
  /// Reason why no poses arrive, with its remedy. Empty: poses arrive. Thread-safe.
  std::optional<Error> failure() const;
  /// Names of all transforms received, unique, in alphabetical order, printable; at most 64.
  std::vector<std::string> received_transforms() const;

  /// Time without a pose after which a tool is reported as not seen.
  static constexpr double kUnseen_s = 0.5;

 private:
  class Core;
  std::unique_ptr<Core> core_;
};

}  // namespace palpate
