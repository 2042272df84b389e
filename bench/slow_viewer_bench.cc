// Effect of a viewer that stops reading, viewers that download, deformable tissue, pictures of the volume, or
// an evaluated task on the servo and the other viewers: alternating pairs of sessions on the real clock, with
// and without them. See README.md.

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "json_file.h"
#include "palpate/rendering/volume_picture.h"
#include "palpate/server/viewer_server.h"
#include "palpate/session/explore.h"
#include "viewer_client.h"

namespace palpate::bench {
namespace {

constexpr double kPoses_hz = 120;
constexpr int kResamples = 20000;
// small, so that the writer soon blocks on a viewer that stops reading
constexpr int kStuckBuffer_bytes = 4096;
// The server disconnects a viewer that has read nothing for 10 s; a viewer that does not read cannot notice
// that, so it is replaced earlier.
constexpr double kStuckFor_s = 8;

struct Options {
  int pairs = 10, viewers = 8, downloading = 0;  // 0: one viewer that stops reading
  int threads = 2;                               // number of drawing threads
  double seconds = 60;
  std::uint64_t seed = 1;
  bool tissue = false;    // whether tissue deforms; the viewers are the same
  bool pictures = false;  // whether pictures of the volume are drawn continuously; the viewers are the same
  // task that is evaluated and published to the viewers; empty: none; the viewers are the same
  std::string task;
  std::string scene = "knee-phantom", json;
};

// Figures of the viewers of a session, from their process.
struct ViewersReport {
  std::uint64_t poses = 0, missed = 0, stuck_connections = 0;
  double age_p50_ms = 0, age_p99_ms = 0;
  std::uint64_t downloaded_bytes = 0, volumes = 0;
  double first_load_p50_ms = 0;  // time until a downloading viewer has scan and labels
};

struct Session {
  bool troubled = false;
  Percentiles lateness;
  std::uint64_t skipped = 0;
  ViewersReport viewers;
  std::uint64_t pictures = 0;
};

[[noreturn]] void fail(const std::string& what) {
  std::fprintf(stderr, "slow_viewer_bench: %s\n", what.c_str());
  std::exit(1);
}

// ---- viewers' process

ViewersReport watch(const Options& options, int port, bool troubled) {
  const std::int64_t until_ns = steady_ns() + static_cast<std::int64_t>(options.seconds * 1e9);
  std::vector<std::unique_ptr<ViewerClient>> clients;
  for (int n = 0; n < options.viewers; ++n)
    clients.push_back(std::make_unique<ViewerClient>(port, kPoses_hz, 0, troubled && !options.task.empty()));
  std::vector<std::thread> threads;
  for (const auto& client : clients)
    threads.emplace_back([&client, until_ns] { client->read_until(until_ns); });

  // viewers that download volumes, repeatedly
  const bool others = troubled && !options.tissue && !options.pictures && options.task.empty(),
             stuck = others && options.downloading == 0;
  std::vector<Downloads> downloads(others ? static_cast<std::size_t>(options.downloading) : 0);
  for (Downloads& one : downloads)
    threads.emplace_back([&one, port, until_ns] { one = download_until(port, until_ns); });

  // a viewer that sends its greeting and then reads nothing, repeatedly
  ViewersReport report;
  while (stuck && steady_ns() < until_ns) {
    const ViewerClient silent(port, kPoses_hz, kStuckBuffer_bytes);
    ++report.stuck_connections;
    const auto leaves_ns = steady_ns() + static_cast<std::int64_t>(kStuckFor_s * 1e9);
    std::this_thread::sleep_for(std::chrono::nanoseconds(std::min(until_ns, leaves_ns) - steady_ns()));
  }
  for (std::thread& thread : threads) thread.join();

  ReceivedPoses observed;
  for (const auto& client : clients) observed.add(client->received());
  report.poses = observed.ages_ms.size();
  report.missed = observed.missed;
  std::vector<double> first_ms;
  for (const Downloads& one : downloads) {
    report.downloaded_bytes += one.bytes;
    report.volumes += one.whole;
    if (one.first_ms > 0) first_ms.push_back(one.first_ms);
  }
  report.first_load_p50_ms = first_ms.empty() ? 0 : quantile(first_ms, 0.5);
  report.age_p50_ms = quantile(observed.ages_ms, 0.5);
  report.age_p99_ms = quantile(observed.ages_ms, 0.99);
  return report;
}

// Forked before this process starts threads: it waits for a port and replies with a report.
struct ViewersProcess {
  pid_t id = -1;
  int port_to = -1, report_from = -1;
};

ViewersProcess start_viewers(const Options& options, bool troubled) {
  int ports[2], reports[2];
  if (::pipe(ports) != 0 || ::pipe(reports) != 0) fail("no pipe is to be had");
  const pid_t id = ::fork();
  if (id < 0) fail("no process is to be had");
  if (id == 0) {
    ::close(ports[1]);
    ::close(reports[0]);
    int port = 0;
    if (::read(ports[0], &port, sizeof port) != sizeof port) ::_exit(1);
    const ViewersReport report = watch(options, port, troubled);
    ::_exit(::write(reports[1], &report, sizeof report) == sizeof report ? 0 : 1);
  }
  ::close(ports[0]);
  ::close(reports[1]);
  return {id, ports[1], reports[0]};
}

// ---- pictures

constexpr int kPicture_px = 512;
// same priority as for the pictures that palpate draws for viewers
constexpr int kLowestPriority = 19;

/// Draws the volume from all around, one picture after another, during its lifetime.
class Drawing {
 public:
  Drawing(VolumeRenderer& renderer, const GridGeometry& grid)
      : thread_([this, &renderer, &grid](std::stop_token stop) {
          ::setpriority(PRIO_PROCESS, static_cast<id_t>(::gettid()), kLowestPriority);
          std::vector<std::uint8_t> rgb(std::size_t{3} * kPicture_px * kPicture_px);
          VolumePictureRequest request;
          request.pixels = kPicture_px;
          for (; !stop.stop_requested(); ++pictures_) {
            request.turn_deg = 5.0 * static_cast<double>(pictures_ % 72);
            renderer.render(camera_of(grid, request), {}, rgb);
          }
        }) {}
  std::uint64_t end() {
    thread_.request_stop();
    thread_.join();
    return pictures_;
  }

 private:
  std::uint64_t pictures_ = 0;
  std::jthread thread_;
};

// ---- session

Session run_session(const LoadedScene& loaded, const Options& options, bool troubled,
                    VolumeRenderer* renderer) {
  const ViewersProcess viewers = start_viewers(options, troubled);
  ExploreOptions explore_options;
  explore_options.repeat = true;
  // viewers connect shortly before the loop starts, and the session ends when they have left
  explore_options.seconds = options.seconds;
  explore_options.viewers = [&](LiveHost& host) -> Result<std::shared_ptr<void>> {
    ViewerServerOptions server_options;
    server_options.port = 0;
    auto server = ViewerServer::start(host, server_options);
    if (!server) return server.error();
    const int port = (*server)->port();
    if (::write(viewers.port_to, &port, sizeof port) != sizeof port) fail("the viewers are gone");
    return std::shared_ptr<void>(std::move(*server));
  };
  if (troubled && !options.task.empty()) {
    auto task = load_task(options.task);
    if (!task) fail(task.error().message());
    // until the session ends
    task->end = TaskEnd::kRecording;
    task->time_limit_s.reset();
    explore_options.training.tasks = {{"task", *std::move(task)}};
    explore_options.training.requires_all_tasks = explore_options.training.begins_with_first_tick = true;
  }
  std::optional<Drawing> drawing;
  if (troubled && renderer != nullptr) drawing.emplace(*renderer, loaded.model->labels->geometry());
  const auto result = explore(loaded, {}, explore_options, {});
  if (!result) fail(result.error().message());

  Session session{troubled, result->health.lateness, result->health.skipped, {}, 0};
  if (drawing) session.pictures = drawing->end();
  if (::read(viewers.report_from, &session.viewers, sizeof session.viewers) != sizeof session.viewers)
    fail("the viewers did not report");
  ::waitpid(viewers.id, nullptr, 0);
  ::close(viewers.port_to);
  ::close(viewers.report_from);
  return session;
}

// ---- pairs

double mean_of(const std::vector<double>& values) {
  double sum = 0;
  for (const double value : values) sum += value;
  return sum / static_cast<double>(values.size());
}

// Mean of the differences within pairs, and its 5th and 95th percentile by bootstrap over the pairs.
struct Increase {
  double mean = 0, least = 0, bound = 0;
};
Increase increase_of(const std::vector<double>& differences, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::uniform_int_distribution<std::size_t> any(0, differences.size() - 1);
  std::vector<double> means;
  for (int n = 0; n < kResamples; ++n) {
    std::vector<double> drawn(differences.size());
    for (double& value : drawn) value = differences[any(random)];
    means.push_back(mean_of(drawn));
  }
  return {mean_of(differences), quantile(means, 0.05), quantile(means, 0.95)};
}

void print(const Session& session) {
  std::printf(
      "  %-7s lateness p50 %6.1f us, p99 %6.1f us, largest %7.1f us, %llu skipped; poses %llu, %llu "
      "missed, age p50 %.3f ms, p99 %.3f ms",
      session.troubled ? "with" : "without", session.lateness.p50_us, session.lateness.p99_us,
      session.lateness.max_us, static_cast<unsigned long long>(session.skipped),
      static_cast<unsigned long long>(session.viewers.poses),
      static_cast<unsigned long long>(session.viewers.missed), session.viewers.age_p50_ms,
      session.viewers.age_p99_ms);
  if (session.viewers.stuck_connections > 0)
    std::printf(", %llu connections", static_cast<unsigned long long>(session.viewers.stuck_connections));
  if (session.viewers.downloaded_bytes > 0)
    std::printf(", %llu volumes, %.0f MB, first load %.0f ms",
                static_cast<unsigned long long>(session.viewers.volumes),
                static_cast<double>(session.viewers.downloaded_bytes) * 1e-6,
                session.viewers.first_load_p50_ms);
  if (session.pictures > 0) std::printf(", %llu pictures", static_cast<unsigned long long>(session.pictures));
  std::printf("\n");
  std::fflush(stdout);
}

nlohmann::json json_of(const Session& session) {
  return {{"lateness_p50_us", session.lateness.p50_us},
          {"lateness_p99_us", session.lateness.p99_us},
          {"lateness_max_us", session.lateness.max_us},
          {"skipped", session.skipped},
          {"poses", session.viewers.poses},
          {"missed", session.viewers.missed},
          {"age_p50_ms", session.viewers.age_p50_ms},
          {"age_p99_ms", session.viewers.age_p99_ms},
          {"stuck_connections", session.viewers.stuck_connections},
          {"downloaded_bytes", session.viewers.downloaded_bytes},
          {"volumes", session.viewers.volumes},
          {"pictures", session.pictures},
          {"first_load_p50_ms", session.viewers.first_load_p50_ms}};
}

// the same scene with rigid layers
LoadedScene by_layers(const LoadedScene& loaded) {
  if (!is_elastic(loaded.model->tissue_law)) fail("nothing yields in this scene");
  LoadedScene other = loaded;
  Model model = *loaded.model;
  model.tissue_law = TissueLaw::kLayers;
  other.model = std::make_shared<const Model>(std::move(model));
  return other;
}

std::string what_differs(const Options& options) {
  if (options.tissue) return "tissue that yields";
  if (options.pictures) return "pictures of the volume";
  if (!options.task.empty()) return "the task " + options.task;
  if (options.downloading == 0) return "one more that reads nothing";
  return std::to_string(options.downloading) + " more that download";
}

int run(const Options& options) {
  const auto loaded = load_scene_or_data_set({options.scene});
  if (!loaded) fail(loaded.error().message());
  const LoadedScene quiet = options.tissue ? by_layers(*loaded) : *loaded;

  std::printf(
      "%d pairs of %g s of %s at %g Hz, %d viewers at %g Hz, with and without %s; order by seed %llu\n",
      options.pairs, options.seconds, options.scene.c_str(), Script{}.rate_hz, options.viewers, kPoses_hz,
      what_differs(options).c_str(), static_cast<unsigned long long>(options.seed));
  std::optional<VolumeRenderer> renderer;
  if (options.pictures) {
    auto made =
        VolumeRenderer::make(*loaded->model->labels, structure_appearances(*loaded->model), options.threads);
    if (!made) fail(made.error().message());
    renderer = std::move(*made);
  }
  std::mt19937_64 random(options.seed);
  std::vector<double> lateness_us, age_ms;
  auto pairs = nlohmann::json::array();
  for (int n = 0; n < options.pairs; ++n) {
    std::printf("pair %d of %d\n", n + 1, options.pairs);
    const bool troubled_first = random() & 1;
    std::array<Session, 2> sessions;  // [0] without, [1] with
    for (const bool troubled : {troubled_first, !troubled_first}) {
      sessions[troubled] =
          run_session(troubled ? *loaded : quiet, options, troubled, renderer ? &*renderer : nullptr);
      print(sessions[troubled]);
    }
    const auto& [without, with] = sessions;
    lateness_us.push_back(with.lateness.p99_us - without.lateness.p99_us);
    age_ms.push_back(with.viewers.age_p99_ms - without.viewers.age_p99_ms);
    pairs.push_back(
        {{"troubled_first", troubled_first}, {"without", json_of(without)}, {"with", json_of(with)}});
  }
  const Increase lateness = increase_of(lateness_us, options.seed), age = increase_of(age_ms, options.seed);
  std::printf("increase of p99 tick lateness: mean %.2f us, by bootstrap 5 %% %.2f us, 95 %% %.2f us\n",
              lateness.mean, lateness.least, lateness.bound);
  std::printf(
      "increase of the other viewers' p99 age: mean %.4f ms, by bootstrap 5 %% %.4f ms, 95 %% %.4f ms\n",
      age.mean, age.least, age.bound);
  return write_json(
      "slow_viewer_bench", options.json,
      {{"scene", options.scene},
       {"seconds", options.seconds},
       {"viewers", options.viewers},
       {"downloading", options.downloading},
       {"tissue", options.tissue},
       {"drawing", options.pictures},
       {"task", options.task},
       {"seed", options.seed},
       {"pairs", pairs},
       {"lateness_p99_increase_us",
        {{"mean", lateness.mean}, {"bound_5", lateness.least}, {"bound_95", lateness.bound}}},
       {"age_p99_increase_ms", {{"mean", age.mean}, {"bound_5", age.least}, {"bound_95", age.bound}}}});
}

}  // namespace
}  // namespace palpate::bench

int main(int argc, char** argv) {
  CLI::App app(
      "Tick lateness and other viewers, with and without a viewer that stops reading, some that download, "
      "tissue that yields, pictures of the volume that are drawn beside it, or a task that is measured");
  palpate::bench::Options options;
  app.add_option("scene", options.scene, "a data set or scene file")->capture_default_str();
  app.add_option("--pairs", options.pairs, "how many pairs")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  app.add_option("--seconds", options.seconds, "how long a session lasts")
      ->check(CLI::Range(1.0, 3600.0))
      ->capture_default_str();
  app.add_option("--viewers", options.viewers, "how many watch and read")
      ->check(CLI::Range(1, 62))
      ->capture_default_str();
  app.add_option("--downloading", options.downloading,
                 "how many load the volumes again and again, instead of one that stops reading")
      ->check(CLI::Range(0, 128))
      ->capture_default_str();
  app.add_flag("--tissue", options.tissue,
               "tissue that yields, as the scene says, and by layers, instead of viewers");
  app.add_flag("--pictures", options.pictures,
               "pictures of the volume, drawn one after another at the lowest priority, instead of viewers");
  app.add_option("--task", options.task,
                 "a task that is measured and told to the viewers, instead of viewers");
  app.add_option("--threads", options.threads, "of those pictures")
      ->check(CLI::Range(1, 64))
      ->capture_default_str();
  app.add_option("--seed", options.seed, "of the order within pairs, and of the bootstrap")
      ->capture_default_str();
  app.add_option("--json", options.json, "write the figures to this file");
  CLI11_PARSE(app, argc, argv);
  return palpate::bench::run(options);
}
