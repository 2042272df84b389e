// Age of a pose when a viewer receives it: from the snapshot to the last byte of its WebSocket message, on
// loopback. See README.md.

#include <CLI/CLI.hpp>
#include <cstdio>
#include <thread>
#include <vector>

#include "json_file.h"
#include "palpate/server/viewer_server.h"
#include "viewer_client.h"

namespace palpate::bench {
namespace {

struct Options {
  int viewers = 8;
  double poses_hz = 120, seconds = 20;
  bool stuck = false;
  std::string json;
};

/// A session at rest: its snapshots cost a copy, as in the loop.
class StillHost : public ViewerHost {
 public:
  StillHost() {
    GridGeometry grid;
    grid.dims = {8, 8, 8};
    scene_.labels = label_bricks(Volume<LabelId>(grid));
  }
  const ViewedScene& scene() const override { return scene_; }
  TickRecord snapshot(std::array<double, kMaxDevices>&) const override { return tick_; }
  ViewedHealth health() const override { return {}; }
  ViewedState state() const override { return {}; }
  void emergency_stop(const ViewerIdentity&) override {}

 private:
  ViewedScene scene_;
  TickRecord tick_;
};

int run(const Options& options) {
  StillHost host;
  ViewerServerOptions server_options;
  server_options.port = 0;
  const auto server = ViewerServer::start(host, server_options);
  if (!server) {
    std::fprintf(stderr, "viewer_bench: %s\n", server.error().message().c_str());
    return 1;
  }
  std::vector<std::unique_ptr<ViewerClient>> clients;
  for (int n = 0; n < options.viewers; ++n)
    clients.push_back(std::make_unique<ViewerClient>((*server)->port(), options.poses_hz));
  // sends its greeting and then reads nothing
  std::unique_ptr<ViewerClient> stuck;
  if (options.stuck) stuck = std::make_unique<ViewerClient>((*server)->port(), options.poses_hz);

  const std::int64_t until_ns = steady_ns() + static_cast<std::int64_t>(options.seconds * 1e9);
  std::vector<std::thread> threads;
  for (const auto& client : clients)
    threads.emplace_back([&client, until_ns] { client->read_until(until_ns); });
  for (std::thread& thread : threads) thread.join();

  ReceivedPoses observed;
  for (const auto& client : clients) observed.add(client->received());
  const double p50 = quantile(observed.ages_ms, 0.5), p99 = quantile(observed.ages_ms, 0.99),
               p999 = quantile(observed.ages_ms, 0.999), most = quantile(observed.ages_ms, 1);
  std::printf("%d viewers at %g Hz for %g s%s: %zu poses, %llu missed\n", options.viewers, options.poses_hz,
              options.seconds, options.stuck ? ", one more that reads nothing" : "", observed.ages_ms.size(),
              static_cast<unsigned long long>(observed.missed));
  std::printf("snapshot to receipt: median %.3f ms, p99 %.3f ms, p99.9 %.3f ms, largest %.3f ms\n", p50, p99,
              p999, most);
  return write_json("viewer_bench", options.json,
                    {{"viewers", options.viewers},
                     {"poses_hz", options.poses_hz},
                     {"seconds", options.seconds},
                     {"stuck", options.stuck},
                     {"poses", observed.ages_ms.size()},
                     {"missed", observed.missed},
                     {"p50_ms", p50},
                     {"p99_ms", p99},
                     {"p999_ms", p999},
                     {"max_ms", most}});
}

}  // namespace
}  // namespace palpate::bench

int main(int argc, char** argv) {
  CLI::App app("From a snapshot to its receipt by viewers of WebSockets, on loopback");
  palpate::bench::Options options;
  app.add_option("--viewers", options.viewers, "how many watch")
      ->check(CLI::Range(1, 63))
      ->capture_default_str();
  app.add_option("--rate", options.poses_hz, "poses a second for each")
      ->check(CLI::Range(1.0, 120.0))
      ->capture_default_str();
  app.add_option("--seconds", options.seconds, "for how long")
      ->check(CLI::Range(0.1, 86400.0))
      ->capture_default_str();
  app.add_flag("--stuck", options.stuck, "and one more that reads nothing");
  app.add_option("--json", options.json, "write the figures to this file");
  CLI11_PARSE(app, argc, argv);
  return palpate::bench::run(options);
}
