// The servo on a large and a small volume in one run, and for as long as one likes. See README.md.

#include <pthread.h>
#include <sched.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

#include "palpate/preparation.h"
#include "palpate/primitives.h"
#include "palpate/scene.h"
#include "palpate/servo_timing.h"
#include "palpate/volume_io.h"

namespace palpate::bench {

namespace {

constexpr double kRates_hz[] = {1000, 2000, 4000, 8000, 10000};
constexpr double kSmall_voxels = 8e6;
// of the generated knee, as many voxels as the real one has
constexpr double kGeneratedVoxel_mm = 0.36;
constexpr double kEnduranceBlock_s = 10;

struct Options {
  int rounds = 5;
  double block_s = 0.5, rate_hz = 0, spin_us = 0, endurance_s = 0;
  bool load = false;
  std::string labels, json;
};

struct Knee {
  std::string title;
  LoadedScene loaded;
};

// ---- the volumes

std::string title_of(const std::string& what, const GridGeometry& grid) {
  char text[160];
  std::snprintf(text, sizeof text, "%s, %dx%dx%d = %.1f M voxels", what.c_str(), grid.dims[0], grid.dims[1],
                grid.dims[2], static_cast<double>(grid.voxel_count()) / 1e6);
  return text;
}

// the file given, else the knee in PALPATE_DATA, else nothing
std::string labels_file(const Options& options) {
  if (!options.labels.empty()) return options.labels;
  const char* folders = std::getenv("PALPATE_DATA");
  std::istringstream list(folders != nullptr ? folders : "");
  for (std::string folder; std::getline(list, folder, ':');) {
    const auto file = std::filesystem::path(folder) / "knee_spl" / "seg.nrrd";
    if (!folder.empty() && std::filesystem::exists(file)) return file.string();
  }
  return "";
}

Result<LabelMap> large_labels(const Options& options, std::string& what) {
  const std::string file = labels_file(options);
  if (file.empty()) {
    what = "generated knee";
    auto phantom = make_knee_phantom(kGeneratedVoxel_mm, 1);
    if (!phantom) return phantom.error();
    return std::move(phantom->labels);
  }
  what = "segmented knee";
  auto read = read_labels(file);
  if (!read) return read.error();
  return std::move(read->labels);
}

// about that many voxels in the same box, about the same centre
GridGeometry coarser(const GridGeometry& grid, double voxels) {
  const double part = std::cbrt(voxels / static_cast<double>(grid.voxel_count()));
  GridGeometry coarse = grid;
  coarse.spacing_mm /= part;
  for (int& count : coarse.dims) count = std::max(1, static_cast<int>(std::lround(count * part)));
  const Point<Voxel> middle(0.5 * (coarse.dims[0] - 1), 0.5 * (coarse.dims[1] - 1),
                            0.5 * (coarse.dims[2] - 1));
  coarse.origin += grid.centre() - coarse.X_PatientVoxel() * middle;
  return coarse;
}

Result<Knee> knee_of(const std::string& what, const LabelMap& labels) {
  auto scene = parse_scene(*embedded_scene("knee"), "embedded scene");
  if (!scene) return scene.error();
  auto model = build_model(*scene, &labels, nullptr);
  if (!model) return model.error();
  return Knee{title_of(what, labels.geometry()), {*std::move(scene), *std::move(model), ""}};
}

// ---- one volume beside the other

double ratio_of(double large, double small) {
  return small > 0 ? large / small : 0;
}

nlohmann::json to_json(const Percentiles& p) {
  return {{"p50_us", p.p50_us}, {"p99_us", p.p99_us}, {"p99.9_us", p.p999_us}, {"max_us", p.max_us}};
}

nlohmann::json to_json(const PaceFigures& pace) {
  return {{"compute", to_json(pace.compute)},
          {"lateness", to_json(pace.lateness)},
          {"bare_lateness", to_json(pace.bare_lateness)},
          {"ticks", pace.ticks},
          {"skipped", pace.skipped},
          {"dropped", pace.dropped},
          {"bare_ticks", pace.bare_ticks},
          {"bare_skipped", pace.bare_skipped},
          {"on_time", pace.on_time},
          {"in_contact", pace.in_contact},
          {"scheduler", pace.scheduling.scheduler},
          {"memory", pace.scheduling.memory},
          {"late",
           {{"steal", pace.late.steal},
            {"page_fault", pace.late.page_fault},
            {"preemption", pace.late.preemption},
            {"run_queue", pace.late.run_queue},
            {"unknown", pace.late.unknown}}}};
}

Result<nlohmann::json> compare_pace(const Knee& large, const Knee& small, const PalpationPath& path,
                                    const Options& options) {
  nlohmann::json rows = nlohmann::json::array();
  std::printf("\nat a pace: compute and lateness in us, %d rounds of %g s of each in turn\n", options.rounds,
              options.block_s);
  std::printf("%7s %10s %10s %7s %10s %10s %10s %10s %10s %10s\n", "Hz", "large p50", "small p50", "ratio",
              "large p99", "small p99", "late p50", "bare p50", "late p99", "bare p99");
  for (const double rate_hz : kRates_hz) {
    if (options.rate_hz > 0 && options.rate_hz != rate_hz) continue;
    const PaceSettings settings{.rate_hz = rate_hz, .spin_s = options.spin_us * 1e-6};
    const auto of_large = PaceMeter::create(large.loaded.model, path, settings);
    const auto of_small = PaceMeter::create(small.loaded.model, path, settings);
    for (int round = 0; round < options.rounds; ++round) {
      for (PaceMeter* meter : {of_large.get(), of_small.get()})
        if (auto measured = meter->servo_block(options.block_s); !measured) return measured.error();
      if (auto measured = of_large->bare_block(options.block_s); !measured) return measured.error();
    }
    const PaceFigures l = of_large->figures(), s = of_small->figures();
    std::printf("%7.0f %10.3f %10.3f %7.3f %10.3f %10.3f %10.2f %10.2f %10.2f %10.2f\n", rate_hz,
                l.compute.p50_us, s.compute.p50_us, ratio_of(l.compute.p50_us, s.compute.p50_us),
                l.compute.p99_us, s.compute.p99_us, l.lateness.p50_us, l.bare_lateness.p50_us,
                l.lateness.p99_us, l.bare_lateness.p99_us);
    rows.push_back({{"rate_hz", rate_hz},
                    {"large", to_json(l)},
                    {"small", to_json(s)},
                    {"median_ratio", ratio_of(l.compute.p50_us, s.compute.p50_us)}});
  }
  return rows;
}

// the rounds of the two in turn; time of every kind in ns
Result<nlohmann::json> compare_free_running(const Knee& large, const Knee& small, const PalpationPath& path,
                                            const Options& options) {
  nlohmann::json rows = nlohmann::json::array();
  std::printf("\nas fast as it goes: ns, medians of %d rounds along %zu ticks, %.0f %% of them in contact\n",
              options.rounds, path.states.size(), 100 * path.in_contact);
  std::printf("%-24s %10s %10s %7s\n", "", "large", "small", "ratio");
  for (const ForceMethodInfo& method : kForceMethods) {
    std::vector<double> tick_ns[2], update_ns[2];
    const Knee* knees[2] = {&large, &small};
    for (int round = 0; round < options.rounds; ++round) {
      for (int k = 0; k < 2; ++k) {
        const auto& model = knees[k]->loaded.model;
        tick_ns[k].push_back(time_ticks(*model, path, method.method, 1).front());
        const auto updates = time_updates(model, path, method.method, 1);
        if (!updates) return updates.error();
        update_ns[k].push_back(updates->front());
      }
    }
    const std::pair<const char*, std::vector<double>*> kinds[] = {{"tick", tick_ns}, {"update", update_ns}};
    for (const auto& [kind, ns] : kinds) {
      const double l = median(ns[0]), s = median(ns[1]);
      std::printf("%-24s %10.0f %10.0f %7.3f\n", (method.name + ", " + kind).c_str(), l, s, ratio_of(l, s));
      rows.push_back({{"method", method.name},
                      {"what", kind},
                      {"large_ns", l},
                      {"small_ns", s},
                      {"ratio", ratio_of(l, s)}});
    }
  }
  return rows;
}

// ---- for a long time

/// Keeps every CPU but one busy while it lives, arithmetic and memory.
class Load {
 public:
  explicit Load(int spared) {
    const int cpus = static_cast<int>(std::thread::hardware_concurrency());
    for (int cpu = 0; cpu < cpus; ++cpu)
      if (cpu != spared) threads_.emplace_back([this, cpu] { work(cpu); });
  }
  ~Load() {
    stop_ = true;
    for (std::thread& thread : threads_) thread.join();
  }
  Load(const Load&) = delete;
  Load& operator=(const Load&) = delete;

 private:
  void work(int cpu) {
    cpu_set_t only;
    CPU_ZERO(&only);
    CPU_SET(cpu, &only);
    ::pthread_setaffinity_np(::pthread_self(), sizeof only, &only);
    std::vector<double> values(std::size_t{1} << 19, 1.0);
    while (!stop_)
      for (double& value : values) value = std::sqrt(value + 1);
  }

  std::atomic<bool> stop_{false};
  std::vector<std::thread> threads_;
};

void print_percentiles(const char* name, const Percentiles& p) {
  std::printf("%-16s %10.2f %10.2f %10.2f %10.2f\n", name, p.p50_us, p.p99_us, p.p999_us, p.max_us);
}

void print_endurance(const PaceFigures& pace) {
  std::printf("%-16s %10s %10s %10s %10s   us\n", "", "p50", "p99", "p99.9", "max");
  print_percentiles("compute", pace.compute);
  print_percentiles("servo lateness", pace.lateness);
  print_percentiles("bare lateness", pace.bare_lateness);
  std::printf("%-16s %10.3f %10.3f\n", "servo / bare",
              ratio_of(pace.lateness.p50_us, pace.bare_lateness.p50_us),
              ratio_of(pace.lateness.p99_us, pace.bare_lateness.p99_us));
  std::printf("servo: %llu ticks, %.4f %% on time, %llu skipped, %llu dropped, %.1f %% in contact\n",
              static_cast<unsigned long long>(pace.ticks), 100 * pace.on_time,
              static_cast<unsigned long long>(pace.skipped), static_cast<unsigned long long>(pace.dropped),
              100 * pace.in_contact);
  std::printf("late: %llu steal, %llu page fault, %llu pre-emption, %llu run queue, %llu unknown\n",
              static_cast<unsigned long long>(pace.late.steal),
              static_cast<unsigned long long>(pace.late.page_fault),
              static_cast<unsigned long long>(pace.late.preemption),
              static_cast<unsigned long long>(pace.late.run_queue),
              static_cast<unsigned long long>(pace.late.unknown));
  std::printf("bare: %llu ticks, %llu skipped\n", static_cast<unsigned long long>(pace.bare_ticks),
              static_cast<unsigned long long>(pace.bare_skipped));
}

Result<nlohmann::json> endure(const Knee& knee, const PalpationPath& path, const Options& options) {
  PaceSettings settings{.rate_hz = options.rate_hz > 0 ? options.rate_hz : 1000,
                        .spin_s = options.spin_us * 1e-6};
  settings.cpu = static_cast<int>(std::thread::hardware_concurrency()) - 1;
  std::optional<Load> load;
  if (options.load) load.emplace(settings.cpu);

  const auto meter = PaceMeter::create(knee.loaded.model, path, settings);
  const int blocks = std::max(1, static_cast<int>(std::ceil(options.endurance_s / kEnduranceBlock_s)));
  const double block_s = options.endurance_s / blocks;
  for (int block = 0; block < blocks; ++block) {
    if (auto measured = meter->servo_block(block_s); !measured) return measured.error();
    if (auto measured = meter->bare_block(block_s); !measured) return measured.error();
  }
  const PaceFigures pace = meter->figures();
  std::printf("\n%g s of each loop at %g Hz in blocks of %g s, spin %g us, on CPU %d, others %s\n",
              options.endurance_s, settings.rate_hz, block_s, options.spin_us, settings.cpu,
              options.load ? "busy" : "as they are");
  std::printf("%s, memory %s\n", pace.scheduling.scheduler.c_str(), pace.scheduling.memory.c_str());
  print_endurance(pace);
  nlohmann::json json = to_json(pace);
  json.update({{"rate_hz", settings.rate_hz}, {"seconds", options.endurance_s}, {"load", options.load}});
  return json;
}

// ----

Result<nlohmann::json> measured(const Options& options) {
  std::string what;
  const auto labels = large_labels(options, what);
  if (!labels) return labels.error();
  const auto large = knee_of(what, *labels);
  if (!large) return large.error();
  const auto path = palpate_once(large->loaded);
  if (!path) return path.error();
  std::printf("large: %s\n", large->title.c_str());
  nlohmann::json json = {{"large", large->title}, {"spin_us", options.spin_us}};

  if (options.endurance_s > 0) {
    auto endurance = endure(*large, *path, options);
    if (!endurance) return endurance.error();
    json["endurance"] = *std::move(endurance);
    return json;
  }

  const auto coarse = resample_nearest(*labels, coarser(labels->geometry(), kSmall_voxels));
  if (!coarse) return coarse.error();
  const auto small = knee_of("the same, resampled", *coarse);
  if (!small) return small.error();
  std::printf("small: %s\n", small->title.c_str());
  json.update({{"small", small->title}, {"rounds", options.rounds}});
  auto pace = compare_pace(*large, *small, *path, options);
  if (!pace) return pace.error();
  json["pace"] = *std::move(pace);
  auto free_running = compare_free_running(*large, *small, *path, options);
  if (!free_running) return free_running.error();
  json["free_running"] = *std::move(free_running);
  return json;
}

int run(const Options& options) {
  const auto json = measured(options);
  if (!json) {
    std::fprintf(stderr, "servo_bench: %s\n", json.error().message().c_str());
    return 1;
  }
  if (options.json.empty()) return 0;
  std::ofstream file(options.json);
  file << json->dump(2) << '\n';
  file.close();
  if (file) return 0;
  std::fprintf(stderr, "servo_bench: %s could not be written\n", options.json.c_str());
  return 4;
}

}  // namespace

}  // namespace palpate::bench

int main(int argc, char** argv) {
  palpate::bench::Options options;
  CLI::App app("The servo's tick on 31 and on 8 million voxels in one run, or the servo for a long time");
  app.add_option("--rounds", options.rounds, "interleaved rounds")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  app.add_option("--block", options.block_s, "seconds of each loop in a round")
      ->check(CLI::Range(0.05, 60.0))
      ->capture_default_str();
  app.add_option("--rate", options.rate_hz, "this rate only (endurance: 1000 unless given)")
      ->check(CLI::Range(250.0, 10000.0));
  app.add_option("--spin", options.spin_us, "wait awake for the last microseconds before every tick")
      ->check(CLI::Range(0.0, 1000.0))
      ->capture_default_str();
  app.add_option("--endurance", options.endurance_s,
                 "instead: servo and bare loop in turn, this many seconds of each, on one CPU")
      ->check(CLI::Range(1.0, 86400.0));
  app.add_flag("--load", options.load, "endurance: keep the other CPUs busy");
  app.add_option("--labels", options.labels,
                 "label map of a knee; default: knee_spl in PALPATE_DATA, else a "
                 "generated one");
  app.add_option("--json", options.json, "write the figures to this file");
  CLI11_PARSE(app, argc, argv);
  return palpate::bench::run(options);
}
