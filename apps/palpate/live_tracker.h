#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "known_devices.h"
#include "palpate/navigation/touches.h"
#include "verb.h"

/// What somebody with a tracked tool does at the terminal: its poses as they come, told step by step.
namespace palpate::app {

/// The address of a tracker's server; empty: it is the name of a file, or of one that may be missing.
std::optional<TrackerAddress> stream_named(const std::string& file_or_address);

/// Errors: kUsage where no transform is named.
Result<TrackerSettings> stream_settings(const TrackerAddress& address, const StreamOptions& options);

/// Poses of a tool whose tip stands in a dimple, until they are enough, or Ctrl-C.
/// Errors: those of TrackerStream::open(); kInterrupted where there are fewer than six.
Result<std::vector<Transform<Tracker, TrackedTool>>> collect_pivot(const TrackerSettings& settings,
                                                                   Console& console);

struct CollectedTouches {
  std::vector<TouchedPoint> points;    ///< one for each name
  std::vector<Point<Tracker>> traced;  ///< where a structure was; empty where none was asked for
};
/// Places that the tip touches, one for each of the names, in their order; then, led over a structure, as
/// many as a surface needs.
/// @param structure  empty: none is traced
/// Errors: those of TrackerStream::open(); kInterrupted.
Result<CollectedTouches> collect_touches(const TrackerSettings& settings, const ToolTip& tip,
                                         std::span<const std::string> names, const std::string& structure,
                                         Console& console);

}  // namespace palpate::app
