#include "live_tracker.h"

#include <Eigen/Geometry>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <deque>
#include <filesystem>
#include <mutex>
#include <numbers>
#include <thread>
#include <utility>

#include "apps/command/keys.h"
#include "palpate/base/printable.h"
#include "palpate/navigation/pivot.h"

namespace palpate::app {
namespace {

using ToolMarkers = Transform<Tracker, TrackedTool>;

constexpr auto kPollInterval = std::chrono::milliseconds(30);
// capacity of the pose queue: some seconds of a fast tracker
constexpr std::size_t kMaxWaiting = 4096;
// minimum rotation between successive poses of a pivot calibration
constexpr double kAnotherPose_rad = 1 * std::numbers::pi / 180;
constexpr std::size_t kEnoughPoses = 200, kMinPoses = 6;
constexpr double kEnoughTurn_deg = 15;
// minimum distance between traced points, and their number
constexpr double kTraceStep_mm = 1;
constexpr std::size_t kTracePoints = 100;
constexpr double kTooNearReported_s = 3;

/// Stream of a tracker with a queue of its poses.
class LivePoses {
 public:
  LivePoses(const TrackerSettings& settings, Console& console)
      : console_(console), stream_(settings, [this](const MarkersPose& pose) { take(pose); }) {}

  Result<void> open() { return stream_.open(3, console_.progress()); }
  /// Poses received since the last call. Warns once about trouble with the stream.
  std::deque<MarkersPose> next() {
    const auto problems = stream_.failure();
    const std::string wrong = problems ? problems->message() : "";
    if (wrong != reported_) console_.warn()(wrong.empty() ? "the tool is visible again" : wrong);
    reported_ = wrong;
    const std::lock_guard lock(mutex_);
    return std::exchange(waiting_, {});
  }

 private:
  void take(const MarkersPose& pose) {
    const std::lock_guard lock(mutex_);
    if (waiting_.size() == kMaxWaiting) waiting_.pop_front();
    waiting_.push_back(pose);
  }

  Console& console_;
  std::string reported_;
  std::mutex mutex_;
  std::deque<MarkersPose> waiting_;
  TrackerStream stream_;  // last: its thread calls take()
};

double turn_between(const ToolMarkers& a, const ToolMarkers& b) {
  const Eigen::Matrix3d turn = a.linear().transpose() * b.linear();
  return Eigen::AngleAxisd(turn).angle();
}

}  // namespace

std::optional<TrackerAddress> stream_named(const std::string& file_or_address) {
  std::error_code failed;
  if (std::filesystem::exists(file_or_address, failed)) return {};
  return parse_tracker_address(file_or_address);
}

Result<TrackerSettings> stream_settings(const TrackerAddress& address, const StreamOptions& options) {
  if (!options.transform.empty()) return TrackerSettings{address, options.transform, options.reference};
  return Error{
      ErrorKind::kUsage, "the tracker's stream has several transforms", "--transform",
      "name the transform of the tool, e.g. --transform StylusToTracker; palpate devices --tracker " +
          printable_name(address.text()) + " lists them"};
}

Result<std::vector<ToolMarkers>> collect_pivot(const TrackerSettings& settings, Console& console) {
  LivePoses live(settings, console);
  if (auto opened = live.open(); !opened) return opened.error();
  console.note(
      "keep the tip in a dimple and tilt the tool by 30 degrees or more in all directions; collection ends "
      "by itself, or with Ctrl-C");
  const Progress progress = console.progress();
  std::vector<ToolMarkers> poses;
  while (!progress.stopped()) {
    for (const MarkersPose& pose : live.next())
      if (poses.empty() || turn_between(poses.back(), pose.tracker_from_tool) >= kAnotherPose_rad)
        poses.push_back(pose.tracker_from_tool);
    const double turn_deg = turned_deg(poses);
    char text[128];
    std::snprintf(text, sizeof text,
                  "%zu of %zu poses, turned by %.1f of %.0f degrees about the axis of least rotation",
                  poses.size(), kEnoughPoses, turn_deg, kEnoughTurn_deg);
    console.show_status(text);
    if (poses.size() >= kEnoughPoses && turn_deg >= kEnoughTurn_deg) break;
    std::this_thread::sleep_for(kPollInterval);
  }
  console.show_status("");
  if (poses.size() < kMinPoses) return Progress::interrupted();
  return poses;
}

Result<CollectedTouches> collect_touches(const TrackerSettings& settings, const ToolTip& tip,
                                         std::span<const std::string> names, const std::string& structure,
                                         Console& console) {
  LivePoses live(settings, console);
  if (auto opened = live.open(); !opened) return opened.error();
  const Progress progress = console.progress();
  Keys keys(console.streams().in);
  TouchDetector touches;
  CollectedTouches out;
  const std::size_t requested = names.size() + (structure.empty() ? 0 : 1);
  const auto ask = [&] {
    const std::size_t n = touches.taken().size();
    if (n < names.size())
      console.note("touch " + printable_name(names[n]) + " (" + std::to_string(n + 1) + " of " +
                   std::to_string(names.size()) + ") and hold the tip still for a second" +
                   (keys.active() ? "; u undoes the last one" : ""));
    else if (n < requested)
      console.note("hold the tip still on " + printable_name(structure) +
                   " for a second, then trace all of the surface that can be reached, without lifting it");
  };
  ask();
  double near_since_s = -1;
  while (touches.taken().size() < names.size() ||
         out.traced.size() < (requested > names.size() ? kTracePoints : 0)) {
    if (progress.stopped()) return Progress::interrupted();
    if (keys.next() == 'u' && out.traced.empty() && !touches.taken().empty()) {
      touches.undo();
      ask();
    }
    for (const MarkersPose& pose : live.next()) {
      const Point<Tracker> at = pose.tracker_from_tool * tip.at;
      const double time_s = 1e-9 * static_cast<double>(pose.at_ns);
      if (touches.taken().size() == requested) {
        // tracing over the structure
        if (out.traced.size() < kTracePoints && !out.traced.empty() &&
            (at - out.traced.back()).norm() >= kTraceStep_mm)
          out.traced.push_back(at);
        continue;
      }
      const TouchDetector::State state = touches.observe(at, time_s);
      if (state != TouchDetector::State::kTooNear) near_since_s = time_s;
      if (time_s - near_since_s > kTooNearReported_s) {
        console.warn()("the tip is less than 5 mm from a point touched before: touch another place");
        near_since_s = INFINITY;
      }
      if (state != TouchDetector::State::kTaken) continue;
      const TouchedPoint& point = touches.taken().back();
      if (touches.taken().size() > names.size()) {
        out.traced.push_back(point.at);
        console.note("trace the surface of " + printable_name(structure));
        continue;
      }
      char text[60];
      std::snprintf(text, sizeof text, ": recorded, held within %.2f mm", point.spread_mm);
      console.note(printable_name(names[touches.taken().size() - 1]) + text);
      ask();
    }
    char text[128];
    std::snprintf(text, sizeof text, "%zu of %zu points, %zu of %zu places",
                  std::min(touches.taken().size(), names.size()), names.size(), out.traced.size(),
                  requested > names.size() ? kTracePoints : 0);
    console.show_status(text);
    std::this_thread::sleep_for(kPollInterval);
  }
  console.show_status("");
  out.points.assign(touches.taken().begin(),
                    touches.taken().begin() + static_cast<std::ptrdiff_t>(names.size()));
  return out;
}

}  // namespace palpate::app
