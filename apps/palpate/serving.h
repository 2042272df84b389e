#pragma once

#include <CLI/CLI.hpp>
#include <cstddef>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "palpate/link/viewer_server.h"
#include "verb.h"

/// What the verbs share that serve the page.
namespace palpate::app {

struct ServingOptions {
  std::optional<int> port;  ///< empty: kViewerPort, or the next that is free
  ViewerServerOptions viewers;
};
void add_serving_options(CLI::App& verb, ServingOptions& options);

/// Faults of viewers, on their way from the server's thread to the terminal. A terminal that is held (Ctrl-S)
/// or a full pipe must hold neither the server nor who looks for keys.
class FaultLines {
 public:
  void put(const std::string& line);
  /// One at most: what a terminal takes without waiting is not known to be more.
  void show_next(Console& console);

 private:
  static constexpr std::size_t kMost = 100;
  std::mutex mutex_;
  std::deque<std::string> lines_;
};

/// At the port that was asked for; without one at the usual one, or at one of those after it.
/// @param faults  outlives the server
Result<std::unique_ptr<ViewerServer>> serve(ViewerHost& host, const ServingOptions& options, Console& console,
                                            FaultLines& faults);

}  // namespace palpate::app
