// The servo with volumes of 8, 31 and 134 million voxels in one run, optionally of 1000 million, and
// endurance runs of any duration. See README.md.

#include <pthread.h>
#include <sched.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numeric>
#include <thread>
#include <unordered_set>

#include "json_file.h"
#include "large_knee.h"
#include "palpate/base/clock.h"
#include "palpate/base/reading.h"
#include "palpate/phantoms/primitives.h"
#include "palpate/preparation/preparation.h"
#include "palpate/scene/scene.h"
#include "palpate/verification/servo_timing.h"
#include "palpate/volume/resample.h"
#include "palpate/volume_io/volume_io.h"

namespace palpate::bench {

namespace {

constexpr double kRates_hz[] = {1000, 2000, 4000, 8000, 10000};
// in addition to the original knee
constexpr double kSmall_voxels = 8e6, kHuge_voxels = 134e6, kVast_voxels = 1e9;
constexpr double kEnduranceBlock_s = 10;
constexpr std::size_t kLine_bytes = 64, kWindow_ticks = 1000;

struct Options {
  int rounds = 5;
  double block_s = 0.5, rate_hz = 0, spin_us = 0, endurance_s = 0, largest = kHuge_voxels;
  double radius_mm = 0;
  bool load = false;
  std::string method{name_of(ForceMethod::kTrilinear)}, labels, json;

  ForceMethod force_method() const { return *find_force_method(method); }
};

struct Knee {
  std::string title;
  LoadedScene loaded;

  const Model& model() const { return *loaded.model; }
};

// ---- volumes

std::string title_of(const std::string& what, const GridGeometry& grid) {
  char text[160];
  std::snprintf(text, sizeof text, "%s, %dx%dx%d = %.1f M voxels", what.c_str(), grid.dims[0], grid.dims[1],
                grid.dims[2], static_cast<double>(grid.voxel_count()) / 1e6);
  return text;
}

// grid with about that number of voxels, for the same box and centre
GridGeometry resized(const GridGeometry& grid, double voxels) {
  const double part = std::cbrt(voxels / static_cast<double>(grid.voxel_count()));
  GridGeometry result = grid;
  result.spacing_mm /= part;
  for (int& count : result.dims) count = std::max(1, static_cast<int>(std::lround(count * part)));
  result.origin += grid.centre() - result.centre();
  return result;
}

Result<Knee> knee_of(const std::string& what, LabelMap labels, ForceMethod method, double radius_mm) {
  auto scene = parse_scene(*embedded_scene("knee"), "embedded scene");
  if (!scene) return scene.error();
  scene->tools[0].radius_mm = radius_mm;
  const std::string title = title_of(what, labels.geometry());
  auto model = build_model(*scene, {std::move(labels), nullptr, true});
  if (!model) return model.error();
  // the footprint is counted in the field, whatever the method
  const std::array methods{method, ForceMethod::kTrilinear};
  auto ready = prepared_with_cache(*std::move(model), methods);
  if (!ready) return ready.error();
  return Knee{title, {*std::move(scene), *std::move(ready), ""}};
}

// ---- memory footprint of a tick

/// Search depth of ticks along the path, and number of cache lines that 1000 consecutive ticks read.
struct Footprint {
  double steps = 0;  ///< Half voxels from the tip to the surface, mean over ticks with a known depth
  double field_lines = 0, label_lines = 0;  ///< Distinct lines in 1000 ticks, mean over such windows
};

/// Set of cache lines, by address.
class Lines {
 public:
  void add(const void* first, std::size_t bytes) {
    const auto begin = reinterpret_cast<std::uintptr_t>(first);
    for (auto line = begin / kLine_bytes; line <= (begin + bytes - 1) / kLine_bytes; ++line)
      lines_.insert(line);
  }
  // returns their number, and clears the set
  double take() {
    const auto count = static_cast<double>(lines_.size());
    lines_.clear();
    return count;
  }

 private:
  std::unordered_set<std::uintptr_t> lines_;
};

// voxels that a sample reads: rows j and k from the cell, voxels from i on
template <class T>
void add_rows(const Bricks<T>& volume, const Point<Voxel>& x, int before, int after, Lines& lines) {
  const auto [i, j, k] = std::array{static_cast<int>(std::floor(x.x())), static_cast<int>(std::floor(x.y())),
                                    static_cast<int>(std::floor(x.z()))};
  for (int dk = -before; dk <= after; ++dk)
    for (int dj = -before; dj <= after; ++dj)
      lines.add(volume.view().cell(i, j, k) - before + dj * BrickLayout::kRow + dk * BrickLayout::kSlice,
                sizeof(T) * static_cast<std::size_t>(1 + before + after));
}

/// Footprint of trilinear interpolation with central differences, and of the ray from the tip to the surface,
/// along which every method determines structure and depth.
Footprint footprint_of(const Model& model, const PalpationPath& path) {
  const Bricks<LabelId>& labels = *model.labels;
  const double step_mm = 0.5 * labels.geometry().min_spacing_mm();
  Lines field, label;
  double steps = 0, deep = 0, field_lines = 0, label_lines = 0;
  SessionState state;
  Wrench wrench;
  TickRecord record;
  std::size_t windows = 0;
  for (std::size_t n = 0; n < path.states.size(); ++n) {
    tick(model, path.parameters, {&path.states[n], 1}, 1 / path.rate_hz, state, {&wrench, 1}, record);
    const DeviceTick& device = record.device[0];
    const Point<Patient> tip(device.tip_patient_mm[0], device.tip_patient_mm[1], device.tip_patient_mm[2]);
    const Vector<Patient> outward(device.normal_patient[0], device.normal_patient[1],
                                  device.normal_patient[2]);
    const bool known = device.field > 0 && std::isfinite(device.depth_mm);
    const int count = known ? static_cast<int>(std::ceil(std::abs(device.depth_mm) / step_mm)) : 0;
    steps += count;
    deep += known ? 1 : 0;
    std::visit(
        [&](const auto& volume) {
          for (int direction = 0; direction <= count; ++direction) {
            const auto to_surface = outward * (std::copysign(step_mm, device.depth_mm) * direction);
            const Point<Voxel> x = labels.X_VoxelPatient() * (tip + (known ? to_surface : Vector<Patient>()));
            bool inside = true;
            for (int axis = 0; axis < 3; ++axis)
              inside = inside && x[axis] >= 0 && x[axis] < labels.geometry().dims[axis] - 1;
            if (!inside) continue;
            direction == 0 ? add_rows(volume, x, 1, 2, field) : add_rows(volume, x, 0, 1, field);
            if (known)
              label.add(labels.view().cell(static_cast<int>(x.x() + 0.5), static_cast<int>(x.y() + 0.5),
                                           static_cast<int>(x.z() + 0.5)),
                        sizeof(LabelId));
          }
        },
        model.field->bricks());
    if ((n + 1) % kWindow_ticks != 0) continue;
    field_lines += field.take();
    label_lines += label.take();
    ++windows;
  }
  const double per_window = 1 / static_cast<double>(std::max<std::size_t>(windows, 1));
  return {deep > 0 ? steps / deep : 0, field_lines * per_window, label_lines * per_window};
}

nlohmann::json describe(const std::vector<Knee>& knees, const PalpationPath& path) {
  nlohmann::json all = nlohmann::json::array();
  std::printf("\n%-52s %9s %9s %8s %12s %12s\n", "", "field MB", "label MB", "steps", "field lines",
              "label lines");
  for (const Knee& knee : knees) {
    const Model& model = knee.model();
    const double voxels = static_cast<double>(model.labels->geometry().voxel_count());
    const double field_MB =
        1e-6 * std::visit([](const auto& bricks) { return static_cast<double>(bricks.bytes()); },
                          model.field->bricks());
    const double label_MB = 1e-6 * static_cast<double>(model.labels->bytes());
    const Footprint footprint = footprint_of(model, path);
    std::printf("%-52s %9.0f %9.0f %8.2f %12.0f %12.0f\n", knee.title.c_str(), field_MB, label_MB,
                footprint.steps, footprint.field_lines, footprint.label_lines);
    all.push_back({{"title", knee.title},
                   {"voxels", voxels},
                   {"least_spacing_mm", model.labels->geometry().min_spacing_mm()},
                   {"field_MB", field_MB},
                   {"label_MB", label_MB},
                   {"steps_to_surface", footprint.steps},
                   {"field_lines_in_1000_ticks", footprint.field_lines},
                   {"label_lines_in_1000_ticks", footprint.label_lines}});
  }
  std::printf("steps: half voxels from tip to surface; lines: of 64 bytes, distinct ones in 1000 ticks\n");
  return all;
}

// ---- comparison of volumes

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

double ratio_of(double a, double b) {
  return b > 0 ? a / b : 0;
}

Result<nlohmann::json> compare_pace(const std::vector<Knee>& knees, const PalpationPath& path,
                                    const Options& options) {
  nlohmann::json rows = nlohmann::json::array();
  std::printf(
      "\nat a pace: us, %d rounds of %g s of each in turn; compute and ratio to the smallest; lateness\n",
      options.rounds, options.block_s);
  std::printf("%7s %-52s %8s %8s %7s %9s %9s\n", "Hz", "", "p50", "p99", "ratio", "late p50", "late p99");
  for (const double rate_hz : kRates_hz) {
    if (options.rate_hz > 0 && options.rate_hz != rate_hz) continue;
    const PaceSettings settings{.rate_hz = rate_hz, .spin_s = options.spin_us * 1e-6};
    std::vector<std::unique_ptr<PaceMeter>> meters;
    for (const Knee& knee : knees) meters.push_back(PaceMeter::create(knee.loaded.model, path, settings));
    for (int round = 0; round < options.rounds; ++round) {
      for (const auto& meter : meters)
        if (auto measured = meter->servo_block(options.block_s); !measured) return measured.error();
      if (auto measured = meters.front()->bare_block(options.block_s); !measured) return measured.error();
    }
    nlohmann::json row = {{"rate_hz", rate_hz}, {"volumes", nlohmann::json::array()}};
    const PaceFigures smallest = meters.front()->figures();
    for (std::size_t k = 0; k < knees.size(); ++k) {
      const PaceFigures pace = meters[k]->figures();
      const double ratio = ratio_of(pace.compute.p50_us, smallest.compute.p50_us);
      std::printf("%7.0f %-52s %8.3f %8.3f %7.3f %9.2f %9.2f\n", rate_hz, knees[k].title.c_str(),
                  pace.compute.p50_us, pace.compute.p99_us, ratio, pace.lateness.p50_us,
                  pace.lateness.p99_us);
      row["volumes"].push_back(to_json(pace));
      row["volumes"].back()["median_ratio"] = ratio;
    }
    std::printf("%7.0f %-52s %8s %8s %7s %9.2f %9.2f\n", rate_hz, "bare loop", "-", "-", "-",
                smallest.bare_lateness.p50_us, smallest.bare_lateness.p99_us);
    rows.push_back(std::move(row));
  }
  return rows;
}

// Durations of ticks in contact, each the minimum over repetitions of one path, which are identical bit for
// bit: other load on the machine is excluded. Sorted; us.
std::vector<double> min_in_contact_us(const Model& model, const PalpationPath& path) {
  constexpr int kRepeats = 20;
  std::vector<double> min_us(path.states.size(), std::numeric_limits<double>::infinity());
  std::vector<bool> touches(path.states.size());
  for (int repeat = 0; repeat < kRepeats; ++repeat) {
    SessionState state;
    Wrench wrench;
    TickRecord record;
    for (std::size_t n = 0; n < path.states.size(); ++n) {
      const std::int64_t started_ns = monotonic_ns();
      tick(model, path.parameters, {&path.states[n], 1}, 1 / path.rate_hz, state, {&wrench, 1}, record);
      const std::int64_t ended_ns = monotonic_ns();
      min_us[n] = std::min(min_us[n], 1e-3 * static_cast<double>(ended_ns - started_ns));
      touches[n] = record.device[0].label != 0;
    }
  }
  std::vector<double> in_contact_us;
  for (std::size_t n = 0; n < min_us.size(); ++n)
    if (touches[n]) in_contact_us.push_back(min_us[n]);
  std::sort(in_contact_us.begin(), in_contact_us.end());
  return in_contact_us;
}

nlohmann::json compare_least(const std::vector<Knee>& knees, const PalpationPath& path) {
  nlohmann::json rows = nlohmann::json::array();
  std::printf("\nticks in contact, of each the least of 20 repeats: us\n%-52s %8s %8s %8s %8s\n", "", "mean",
              "p50", "p99", "max");
  for (const Knee& knee : knees) {
    const std::vector<double> us = min_in_contact_us(knee.model(), path);
    if (us.empty()) continue;
    const auto at = [&](double part) {
      return us[static_cast<std::size_t>(part * static_cast<double>(us.size() - 1))];
    };
    const double mean = std::accumulate(us.begin(), us.end(), 0.0) / static_cast<double>(us.size());
    std::printf("%-52s %8.2f %8.2f %8.2f %8.2f\n", knee.title.c_str(), mean, at(0.5), at(0.99), at(1));
    rows.push_back({{"mean_us", mean}, {"p50_us", at(0.5)}, {"p99_us", at(0.99)}, {"max_us", at(1)}});
  }
  return rows;
}

// interleaves the rounds of all of them
Result<nlohmann::json> compare_free_running(const std::vector<Knee>& knees, const PalpationPath& path,
                                            const Options& options) {
  std::printf("\nas fast as it goes: ns, medians of %d rounds along %zu ticks, %.0f %% of them in contact\n",
              options.rounds, path.states.size(), 100 * path.in_contact);
  std::printf("%-52s %8s %8s %8s %14s %8s\n", "", "tick", "update", "ratio", "in contact p50", "p99");
  std::vector<std::vector<double>> tick_ns(knees.size()), update_ns(knees.size()), p50_ns(knees.size()),
      p99_ns(knees.size());
  for (int round = 0; round < options.rounds; ++round) {
    for (std::size_t k = 0; k < knees.size(); ++k) {
      const auto& model = knees[k].loaded.model;
      tick_ns[k].push_back(time_ticks(*model, path, path.parameters.method, 1).front());
      const auto updates = time_updates(model, path, path.parameters.method, 1);
      if (!updates) return updates.error();
      update_ns[k].push_back(updates->front());
      const Percentiles contact = time_ticks_in_contact(*model, path, path.parameters.method);
      p50_ns[k].push_back(1e3 * contact.p50_us);
      p99_ns[k].push_back(1e3 * contact.p99_us);
    }
  }
  nlohmann::json rows = nlohmann::json::array();
  for (std::size_t k = 0; k < knees.size(); ++k) {
    const double ratio = ratio_of(median(tick_ns[k]), median(tick_ns[0]));
    std::printf("%-52s %8.0f %8.0f %8.3f %14.0f %8.0f\n", knees[k].title.c_str(), median(tick_ns[k]),
                median(update_ns[k]), ratio, median(p50_ns[k]), median(p99_ns[k]));
    rows.push_back({{"tick_ns", median(tick_ns[k])},
                    {"update_ns", median(update_ns[k])},
                    {"tick_ratio", ratio},
                    {"contact_p50_ns", median(p50_ns[k])},
                    {"contact_p99_ns", median(p99_ns[k])}});
  }
  return rows;
}

// ---- endurance

/// Keeps every CPU but one busy during its lifetime, with arithmetic and memory accesses.
class Load {
 public:
  explicit Load(int protected_structures) {
    const int cpus = static_cast<int>(std::thread::hardware_concurrency());
    for (int cpu = 0; cpu < cpus; ++cpu)
      if (cpu != protected_structures) threads_.emplace_back([this, cpu] { work(cpu); });
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

// ---- main

Result<nlohmann::json> measured(const Options& options) {
  // no limit for its own volumes
  set_reading_limits({.max_memory_bytes = std::uint64_t{1} << 40});
  std::string what;
  const auto labels = large_knee(options.labels, what);
  if (!labels) return labels.error();
  auto as_it_is = knee_of(what, *labels, options.force_method(), options.radius_mm);
  if (!as_it_is) return as_it_is.error();
  auto path = palpate_once(as_it_is->loaded);
  if (!path) return path.error();
  path->parameters.method = options.force_method();
  std::printf("%s; %s\n", as_it_is->title.c_str(), options.method.c_str());
  nlohmann::json json = {{"method", options.method}, {"spin_us", options.spin_us}};

  if (options.endurance_s > 0) {
    auto endurance = endure(*as_it_is, *path, options);
    if (!endurance) return endurance.error();
    json["volume"] = as_it_is->title;
    json["endurance"] = *std::move(endurance);
    return json;
  }

  // from the smallest to the largest
  std::vector<Knee> knees;
  for (const double voxels : {kSmall_voxels, 0.0, kHuge_voxels, kVast_voxels}) {
    if (voxels == 0) {
      knees.push_back(*std::move(as_it_is));
    } else if (voxels <= options.largest) {
      auto resampled = resample_nearest(*labels, resized(labels->geometry(), voxels));
      if (!resampled) return resampled.error();
      auto knee =
          knee_of("the same, resampled", *std::move(resampled), options.force_method(), options.radius_mm);
      if (!knee) return knee.error();
      knees.push_back(*std::move(knee));
    }
  }
  json["rounds"] = options.rounds;
  json["volumes"] = describe(knees, *path);
  auto pace = compare_pace(knees, *path, options);
  if (!pace) return pace.error();
  json["pace"] = *std::move(pace);
  auto free_running = compare_free_running(knees, *path, options);
  if (!free_running) return free_running.error();
  json["free_running"] = *std::move(free_running);
  json["min_in_contact"] = compare_least(knees, *path);
  return json;
}

int run(const Options& options) {
  const auto json = measured(options);
  if (json) return write_json("servo_bench", options.json, *json);
  std::fprintf(stderr, "servo_bench: %s\n", json.error().message().c_str());
  return 1;
}

}  // namespace

}  // namespace palpate::bench

int main(int argc, char** argv) {
  palpate::bench::Options options;
  CLI::App app("The servo's tick on 8, 31 and 134 million voxels in one run, or the servo for a long time");
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
  app.add_option("--largest", options.largest,
                 "no resampled volume of more voxels; 1e9 for one of 1000 million")
      ->check(CLI::Range(1e6, 1e9))
      ->capture_default_str();
  std::vector<std::string> methods;
  for (const palpate::ForceMethodInfo& info : palpate::kForceMethods) methods.emplace_back(info.name);
  app.add_option("--method", options.method, "force method")
      ->check(CLI::IsMember(methods))
      ->capture_default_str();
  app.add_option("--radius", options.radius_mm, "of the tool's sphere in mm, felt by the proxy")
      ->check(CLI::Range(0.0, 3.0))
      ->capture_default_str();
  app.add_option("--labels", options.labels,
                 "label map of a knee; default: knee_spl in PALPATE_DATA, else a "
                 "generated one");
  app.add_option("--json", options.json, "write the figures to this file");
  CLI11_PARSE(app, argc, argv);
  return palpate::bench::run(options);
}
