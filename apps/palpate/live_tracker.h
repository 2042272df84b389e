#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "known_devices.h"
#include "palpate/navigation/touches.h"
#include "verb.h"

/// Interactive use of a tracked tool at the terminal: collects its poses from the stream and prompts for
/// each step.
namespace palpate::app {

/// Address of a tracker server; empty: the text is the name of a file, which may not exist.
std::optional<TrackerAddress> stream_named(const std::string& file_or_address);

/// Settings of the stream. Errors: kUsage if no transform is named.
Result<TrackerSettings> stream_settings(const TrackerAddress& address, const StreamOptions& options);

/// Collects poses of a tool whose tip rests in a dimple, until there are enough for a pivot calibration or
/// Ctrl-C is pressed.
/// Errors: those of TrackerStream::open(); kInterrupted if there are fewer than six.
Result<std::vector<Transform<Tracker, TrackedTool>>> collect_pivot(const TrackerSettings& settings,
                                                                   Console& console);

struct CollectedTouches {
  std::vector<TouchedPoint> points;    ///< Touched point for each name
  std::vector<Point<Tracker>> traced;  ///< Points traced on a structure; empty if none was requested
};
/// Collects the points that the tip touches, one for each of the names and in their order, then as many
/// points traced on a structure as a surface registration needs.
/// @param structure  empty: no tracing
/// Errors: those of TrackerStream::open(); kInterrupted.
Result<CollectedTouches> collect_touches(const TrackerSettings& settings, const ToolTip& tip,
                                         std::span<const std::string> names, const std::string& structure,
                                         Console& console);

}  // namespace palpate::app
