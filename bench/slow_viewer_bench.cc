// Effect of a viewer that stops reading, viewers that download, subscribers of a published session,
// deformable tissue, pictures of the volume, or an evaluated task on the servo and the other viewers:
// alternating pairs of sessions on the real clock, with and without them. See README.md.

#include <sys/resource.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <optional>
#include <random>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "json_file.h"
#include "palpate/openigtlink_server/openigtlink_server.h"
#include "palpate/rendering/volume_picture.h"
#include "palpate/ros2/ros2_publisher.h"
#include "palpate/server/viewer_server.h"
#include "palpate/session/explore.h"
#include "subscribers.h"
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
// subscribers of a published session: nodes of ROS 2, clients of OpenIGTLink, viewers that receive every tick
constexpr int kNodes = 3, kOpenIgtLinkClients = 3, kTickViewers = 2;
constexpr double kTickViewers_hz = 60;

struct Options {
  int pairs = 10, viewers = 8, downloading = 0;  // 0: one viewer that stops reading
  int threads = 2;                               // number of drawing threads
  double seconds = 60;
  std::uint64_t seed = 1;
  bool tissue = false;     // whether tissue deforms; the viewers are the same
  bool pictures = false;   // whether pictures of the volume are drawn continuously; the viewers are the same
  bool published = false;  // whether the session is published to subscribers by every protocol
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
  // subscribers of a published session
  std::uint64_t ros2_messages = 0, openigtlink_poses = 0, ticks = 0, lost_ticks = 0;
  double ros2_age_p99_ms = 0, openigtlink_age_p99_ms = 0;
};

// Processor time of the threads that publish a session; s
struct PublishingCost {
  double viewers_s = 0, openigtlink_s = 0, ros2_s = 0;
};

// Ports of the servers, sent to the viewers' process when they have started.
struct Ports {
  int viewers = 0, openigtlink = 0, ros2_domain = 0;
};

struct Session {
  bool troubled = false;
  Percentiles lateness;
  std::uint64_t skipped = 0;
  ViewersReport viewers;
  std::uint64_t pictures = 0;
  PublishingCost cost;
};

[[noreturn]] void fail(const std::string& what) {
  std::fprintf(stderr, "slow_viewer_bench: %s\n", what.c_str());
  std::exit(1);
}

// ---- viewers' process

ViewersReport watch(const Options& options, const Ports& ports, bool troubled) {
  const int port = ports.viewers;
  const std::int64_t until_ns = steady_ns() + static_cast<std::int64_t>(options.seconds * 1e9);
  std::vector<std::unique_ptr<ViewerClient>> clients;
  for (int n = 0; n < options.viewers; ++n)
    clients.push_back(std::make_unique<ViewerClient>(
        port, kPoses_hz, 0, troubled && !options.task.empty() ? Requested::kTask : Requested::kPoses));
  std::vector<std::unique_ptr<ViewerClient>> tick_viewers;
  for (int n = 0; troubled && options.published && n < kTickViewers; ++n)
    tick_viewers.push_back(std::make_unique<ViewerClient>(port, kTickViewers_hz, 0, Requested::kTicks));
  std::vector<std::thread> threads;
  for (const auto* const group : {&clients, &tick_viewers})
    for (const auto& client : *group)
      threads.emplace_back([&client, until_ns] { client->read_until(until_ns); });

  std::array<Received, kNodes> nodes;
  std::array<Received, kOpenIgtLinkClients> openigtlink_clients;
  if (troubled && options.published) {
    for (Received& one : nodes)
      threads.emplace_back([&] { one = receive_ros2_until(ports.ros2_domain, until_ns); });
    for (Received& one : openigtlink_clients)
      threads.emplace_back([&] { one = receive_openigtlink_until(ports.openigtlink, until_ns); });
  }

  // viewers that download volumes, repeatedly
  const bool others = troubled && !options.tissue && !options.pictures && !options.published &&
                      options.task.empty(),
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
  for (const auto& viewer : tick_viewers) {
    report.ticks += viewer->received().ticks;
    report.lost_ticks += viewer->received().lost_ticks;
  }
  Received by_ros2, by_openigtlink;
  for (const Received& one : nodes) by_ros2.add(one);
  for (const Received& one : openigtlink_clients) by_openigtlink.add(one);
  report.ros2_messages = by_ros2.messages;
  report.openigtlink_poses = by_openigtlink.messages;
  report.ros2_age_p99_ms = quantile(by_ros2.ages_ms, 0.99);
  report.openigtlink_age_p99_ms = quantile(by_openigtlink.ages_ms, 0.99);
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
    Ports open;
    if (::read(ports[0], &open, sizeof open) != sizeof open) ::_exit(1);
    const ViewersReport report = watch(options, open, troubled);
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

// ---- threads that publish

using Threads = std::set<pid_t>;
Threads threads_of_process() {
  Threads threads;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/task"))
    threads.insert(std::stoi(entry.path().filename()));
  return threads;
}

// Processor time of a thread of this process; s. Its clock's number is that of the kernel (CPUCLOCK_PERTHREAD
// and CPUCLOCK_SCHED), which pthread_getcpuclockid() computes for threads whose handle is known.
double processor_s(pid_t thread) {
  constexpr unsigned kThreadClock = 6;
  timespec time{};
  if (::clock_gettime(static_cast<clockid_t>(~static_cast<unsigned>(thread) << 3 | kThreadClock), &time) != 0)
    return 0;
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

// Servers of a session. At its end, the processor time of their threads is stored.
class Servers {
 public:
  explicit Servers(PublishingCost& cost) : cost_(cost) {}
  ~Servers() { cost_ = {total_s(of_viewers_), total_s(of_openigtlink_), total_s(of_ros2_)}; }
  Servers(const Servers&) = delete;
  Servers& operator=(const Servers&) = delete;

  // Starts the server for viewers, and with `published` every other publisher.
  Result<Ports> start(LiveHost& host, bool published) {
    Ports ports;
    const Threads before = threads_of_process();
    ViewerServerOptions viewer_options;
    viewer_options.port = 0;
    auto viewers = ViewerServer::start(host, viewer_options);
    if (!viewers) return viewers.error();
    viewers_ = *std::move(viewers);
    ports.viewers = viewers_->port();
    of_viewers_ = new_since(before);
    if (!published) return ports;

    const Threads before_openigtlink = threads_of_process();
    OpenIgtLinkOptions openigtlink_options;
    openigtlink_options.port = 0;
    auto openigtlink = OpenIgtLinkServer::start(host, openigtlink_options);
    if (!openigtlink) return openigtlink.error();
    openigtlink_ = *std::move(openigtlink);
    ports.openigtlink = openigtlink_->port();
    of_openigtlink_ = new_since(before_openigtlink);

    const Threads before_ros2 = threads_of_process();
    Ros2Options ros2_options;
    ports.ros2_domain = ros2_options.domain = 1 + ::getpid() % 100;
    auto ros2 = Ros2Publisher::start(host, ros2_options);
    if (!ros2) return ros2.error();
    ros2_ = *std::move(ros2);
    of_ros2_ = new_since(before_ros2);
    return ports;
  }

 private:
  static Threads new_since(const Threads& before) {
    Threads threads = threads_of_process();
    for (const pid_t thread : before) threads.erase(thread);
    return threads;
  }
  static double total_s(const Threads& threads) {
    double total = 0;
    for (const pid_t thread : threads) total += processor_s(thread);
    return total;
  }

  PublishingCost& cost_;
  Threads of_viewers_, of_openigtlink_, of_ros2_;
  std::unique_ptr<ViewerServer> viewers_;
  std::unique_ptr<OpenIgtLinkServer> openigtlink_;
  std::unique_ptr<Ros2Publisher> ros2_;
};

// ---- session

Session run_session(const LoadedScene& loaded, const Options& options, bool troubled,
                    VolumeRenderer* renderer) {
  const ViewersProcess viewers = start_viewers(options, troubled);
  ExploreOptions explore_options;
  explore_options.repeat = true;
  // viewers connect shortly before the loop starts, and the session ends when they have left
  explore_options.seconds = options.seconds;
  PublishingCost cost;
  explore_options.viewers = [&](LiveHost& host) -> Result<std::shared_ptr<void>> {
    auto servers = std::make_shared<Servers>(cost);
    const auto ports = servers->start(host, troubled && options.published);
    if (!ports) return ports.error();
    if (::write(viewers.port_to, &*ports, sizeof *ports) != sizeof *ports) fail("the viewers are gone");
    return std::shared_ptr<void>(std::move(servers));
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

  Session session{troubled, result->health.lateness, result->health.skipped, {}, 0, cost};
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

// Median of the differences within pairs, and its 95 % interval by bootstrap over the pairs.
struct MedianIncrease {
  double median = 0, lower = 0, upper = 0;
};
MedianIncrease median_increase_of(std::vector<double> differences, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::uniform_int_distribution<std::size_t> any(0, differences.size() - 1);
  const auto median_of = [](std::vector<double> values) {
    std::ranges::sort(values);
    const std::size_t half = values.size() / 2;
    return values.size() % 2 == 1 ? values[half] : 0.5 * (values[half - 1] + values[half]);
  };
  std::vector<double> medians;
  for (int n = 0; n < kResamples; ++n) {
    std::vector<double> drawn(differences.size());
    for (double& value : drawn) value = differences[any(random)];
    medians.push_back(median_of(std::move(drawn)));
  }
  return {median_of(std::move(differences)), quantile(medians, 0.025), quantile(medians, 0.975)};
}

// Processor time for each message that a subscriber received; us
double each_us(double total_s, std::uint64_t messages) {
  return messages > 0 ? 1e6 * total_s / static_cast<double>(messages) : 0;
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
  if (const ViewersReport& report = session.viewers; report.ticks > 0) {
    std::printf(
        "\n          ROS 2: %llu messages, %.1f us each, age p99 %.2f ms; OpenIGTLink: %llu frames, %.1f us "
        "each, age p99 %.2f ms; bundles: %llu ticks, %.1f us each, %llu lost",
        static_cast<unsigned long long>(report.ros2_messages),
        each_us(session.cost.ros2_s, report.ros2_messages), report.ros2_age_p99_ms,
        static_cast<unsigned long long>(report.openigtlink_poses),
        each_us(session.cost.openigtlink_s, report.openigtlink_poses), report.openigtlink_age_p99_ms,
        static_cast<unsigned long long>(report.ticks), each_us(session.cost.viewers_s, report.ticks),
        static_cast<unsigned long long>(report.lost_ticks));
  }
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
          {"ros2_messages", session.viewers.ros2_messages},
          {"ros2_age_p99_ms", session.viewers.ros2_age_p99_ms},
          {"ros2_processor_s", session.cost.ros2_s},
          {"openigtlink_frames", session.viewers.openigtlink_poses},
          {"openigtlink_age_p99_ms", session.viewers.openigtlink_age_p99_ms},
          {"openigtlink_processor_s", session.cost.openigtlink_s},
          {"ticks", session.viewers.ticks},
          {"lost_ticks", session.viewers.lost_ticks},
          {"viewers_processor_s", session.cost.viewers_s},
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
  if (options.published)
    return std::to_string(kNodes) + " nodes of ROS 2, " + std::to_string(kOpenIgtLinkClients) +
           " clients of OpenIGTLink and " + std::to_string(kTickViewers) + " viewers of every tick";
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
  const MedianIncrease median = median_increase_of(lateness_us, options.seed);
  std::printf("increase of p99 tick lateness: mean %.2f us, by bootstrap 5 %% %.2f us, 95 %% %.2f us\n",
              lateness.mean, lateness.least, lateness.bound);
  std::printf("  median %.2f us, 95 %% interval %.2f to %.2f us\n", median.median, median.lower,
              median.upper);
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
       {"published", options.published},
       {"task", options.task},
       {"seed", options.seed},
       {"pairs", pairs},
       {"lateness_p99_increase_us",
        {{"mean", lateness.mean},
         {"bound_5", lateness.least},
         {"bound_95", lateness.bound},
         {"median", median.median},
         {"median_lower_95", median.lower},
         {"median_upper_95", median.upper}}},
       {"age_p99_increase_ms", {{"mean", age.mean}, {"bound_5", age.least}, {"bound_95", age.bound}}}});
}

}  // namespace
}  // namespace palpate::bench

int main(int argc, char** argv) {
  CLI::App app(
      "Tick lateness and other viewers, with and without a viewer that stops reading, some that download, "
      "subscribers by every protocol, tissue that yields, pictures of the volume that are drawn beside it, "
      "or a "
      "task that is measured");
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
  app.add_flag("--published", options.published,
               "subscribers by ROS 2, OpenIGTLink and bundles of ticks, instead of viewers");
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
