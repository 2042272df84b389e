#pragma once

#include <CLI/CLI.hpp>
#include <cstddef>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "palpate/openigtlink_server/openigtlink_server.h"
#include "palpate/ros2/ros2_publisher.h"
#include "palpate/server/viewer_server.h"
#include "verb.h"

/// Shared by the verbs that serve the page.
namespace palpate::app {

struct ServingOptions {
  std::optional<int> port;  ///< Port; empty: kViewerPort, or the next free one
  ViewerServerOptions viewers;
  std::optional<OpenIgtLinkOptions> openigtlink;  ///< Empty: not published by OpenIGTLink
  std::optional<Ros2Options> ros2;                ///< Empty: not published to ROS 2

  /// Whether the session is published to programs without access control.
  bool publishes() const { return openigtlink || ros2; }
};
void add_serving_options(CLI::App& verb, ServingOptions& options);

/// Queue for messages about faults of viewers, from the thread of the server to the terminal. A stopped
/// terminal (Ctrl-S) or a full pipe must block neither the server nor the thread that polls the keys.
class ViewerFaultQueue {
 public:
  void enqueue(const std::string& line);
  /// Prints at most one message, because a terminal that is ready for output may not take more without
  /// blocking.
  void show_next(Console& console);

 private:
  static constexpr std::size_t kMaxLines = 100;
  std::mutex mutex_;
  std::deque<std::string> lines_;
};

/// Starts the server at the requested port; without one at the default port, or at the next free one.
/// @param faults  must outlive the server
Result<std::unique_ptr<ViewerServer>> serve(ViewerHost& host, const ServingOptions& options, Console& console,
                                            ViewerFaultQueue& faults);
/// Publishers of a session, those that were requested.
struct Publishers {
  std::unique_ptr<OpenIgtLinkServer> openigtlink;
  std::unique_ptr<Ros2Publisher> ros2;
};
/// Starts publishing as requested.
/// @param faults  must outlive the publishers
Result<Publishers> publish(ViewerHost& host, const ServingOptions& options, Console& console,
                           ViewerFaultQueue& faults);

}  // namespace palpate::app
