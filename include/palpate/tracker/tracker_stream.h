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

/// A tracking system's poses as they come, over OpenIGTLink: from PLUS and what speaks as it does.
namespace palpate {

struct TrackerAddress {
  std::string host;
  int port = 18944;  ///< PLUS'

  std::string text() const;  ///< "host:port", as parse_tracker_address takes it
};
/// Of "HOST:PORT" or "[::1]:PORT". Empty: it is no address.
std::optional<TrackerAddress> parse_tracker_address(const std::string& text);

struct TrackerSettings {
  TrackerAddress address;
  std::string transform;  ///< of the tool's markers, "StylusToTracker"; empty: none is awaited
  /// Of markers on the patient, "ReferenceToTracker": poses are told in their coordinates. Empty: in the
  /// tracking system's own, in which the patient must not move.
  std::string reference;
};

/// Where a tool's markers were.
struct MarkersPose {
  Transform<Tracker, TrackedTool> tracker_from_tool;
  std::int64_t at_ns = 0;  ///< CLOCK_MONOTONIC when it came; it was true earlier, nobody says by how much
};

/// A connection to a tracker's server that comes back by itself. A thread of its own reads as fast as the
/// server sends, so that nothing old piles up, and calls whoever wants the poses.
///
///     connecting ──► greeted ──► reading ──► closed, garbage, silent for 5 s
///         ▲            (a STATUS of version 2, so that PLUS says whether a tool was seen)  │
///         └───────────────────── a fifth of a second later ──────────────────────────────┘
///
/// With a reference only pairs count whose time stamps are less than 5 ms apart, which those of one frame of
/// the cameras are.
class TrackerStream {
 public:
  /// @param told  called with each pose that was seen, on the stream's own thread, after open()
  TrackerStream(const TrackerSettings& settings, std::function<void(const MarkersPose&)> told);
  ~TrackerStream();

  /// Connects, and waits until the tool is seen, so that there is a pose; without a transform until anything
  /// came. A second call does nothing. Errors: kUnavailable with what is missing, kInterrupted.
  /// @param patience_s  for each of the two
  Result<void> open(double patience_s = 3, const Progress& progress = {});
  /// Why no pose comes at present, with its cure. Empty: poses come. Any thread.
  std::optional<Error> trouble() const;
  /// Names of all transforms that came, each once, in order of the alphabet, fit to be shown; 64 at most.
  std::vector<std::string> heard() const;

  /// A tool that was not seen for so long is told of.
  static constexpr double kUnseen_s = 0.5;

 private:
  class Core;
  std::unique_ptr<Core> core_;
};

}  // namespace palpate
