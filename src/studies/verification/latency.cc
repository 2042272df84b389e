#include "verification/latency.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <utility>

#include "palpate/direct/direct_methods.h"

namespace palpate {
namespace {

constexpr double kRates_hz[] = {1000, 2000, 4000, 8000, 10000};
constexpr double kDefaultSeconds = 3, kMinSeconds = 0.05, kMaxSeconds = 3600;
// short blocks, because the load on the machine varies less between adjacent blocks than from second to
// second
constexpr double kMaxBlock_s = 0.25;

constexpr double kMaxLatenessRatio = 1.2;
// with fewer ticks a p99 is based on fewer than ten samples
constexpr std::uint64_t kMinTicksForLimits = 1000;
// limit relative to the reference implementation of the founding force
constexpr double kMaxTickRatio = 15;

constexpr int kRounds = 9;
constexpr double kFoundingR4400_kHz = 4.8, kFoundingPentiumPro_kHz = 6.5;

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%g", value);
  return text;
}

void add_percentiles(std::vector<Figure>& figures, const std::string& path, const Percentiles& p,
                     std::uint64_t n) {
  figures.push_back({path + "/p50", p.p50_us, "us", n, {}});
  figures.push_back({path + "/p99", p.p99_us, "us", n, {}});
  figures.push_back({path + "/p99.9", p.p999_us, "us", n, {}});
  figures.push_back({path + "/max", p.max_us, "us", n, {}});
}

void add_ratio(std::vector<Figure>& figures, const std::string& name, const LatenessPair& pair,
               std::uint64_t n, std::optional<double> compute_us = {}) {
  if (pair.bare_us == 0) return;
  std::optional<double> limit;
  if (compute_us) limit = lateness_ratio_limit(pair.bare_us, *compute_us);
  figures.push_back({name, pair.servo_us / pair.bare_us, "ratio", n, limit});
}

// validated before the scene is loaded, although the servo loop rejects invalid values itself
std::optional<Error> out_of_range(const SuiteOptions& options) {
  const double seconds = options.seconds.value_or(kDefaultSeconds);
  if (seconds >= kMinSeconds && seconds <= kMaxSeconds) return std::nullopt;
  return Error{ErrorKind::kUsage, number(seconds) + " s of measuring", "",
               "choose from " + number(kMinSeconds) + " to " + number(kMaxSeconds)};
}

Result<PaceFigures> measure_pace(std::shared_ptr<const Model> model, const PalpationPath& path,
                                 const PaceSettings& settings, double seconds, const Progress& progress) {
  const auto meter = PaceMeter::create(std::move(model), path, settings);
  const int blocks = static_cast<int>(std::ceil(seconds / kMaxBlock_s));
  const std::string stage = number(settings.rate_hz / 1000) + " kHz beside a bare loop";
  for (int block = 0; block < blocks; ++block) {
    progress.report(stage, static_cast<double>(block) / blocks);
    // alternating order cancels linear drifts
    for (const bool servo : {block % 2 == 0, block % 2 != 0}) {
      const auto measured = servo ? meter->servo_block(seconds / blocks, progress)
                                  : meter->bare_block(seconds / blocks, progress);
      if (!measured) return measured.error();
    }
  }
  progress.report(stage, 1);
  return meter->figures();
}

// the field of the direct methods does not change when a burr removes tissue
bool is_rendered_by(ForceMethod method, const Model& model) {
  if (method == ForceMethod::kProxy) return true;
  return !model.has_burr() && check_force_field(model, method).ok();
}

// figures of the tick and of the whole update for each selectable method; one method is prepared at a time,
// in addition to the trilinear one, from whose field the bare force is computed
Result<std::vector<Figure>> free_running_figures(const LoadedScene& loaded, const PalpationPath& path,
                                                 const Progress& progress) {
  std::vector<Figure> figures;
  for (const ForceMethodInfo& info : kForceMethods) {
    if (!is_rendered_by(info.method, *loaded.model)) continue;
    const std::array methods{ForceMethod::kTrilinear, info.method};
    const auto model = prepared_with_cache(loaded.model, methods, progress);
    if (!model) return model.error();
    const std::string name(info.name);
    progress.report("as fast as it goes: " + name, 0);
    const TickCost cost = time_ticks_beside_bare(**model, path, info.method, kRounds);
    const auto updates = time_updates(*model, path, info.method, kRounds, progress);
    if (!updates) return updates.error();
    progress.report("as fast as it goes: " + name, 1);

    const double update_ns = median(*updates);
    const std::uint64_t n = kRounds * path.states.size();
    const std::string base = "free-running/" + name;
    const auto add = [&](const std::string& what, double of_tick, double of_update, const char* unit) {
      figures.push_back({base + what + "/tick", of_tick, unit, n, {}});
      figures.push_back({base + what + "/update", of_update, unit, n, {}});
    };
    const double tick_kHz = 1e6 / cost.tick_ns, update_kHz = 1e6 / update_ns;
    add("/time", cost.tick_ns, update_ns, "ns");
    figures.push_back({base + "/time/bare", cost.bare_ns, "ns", n, {}});
    figures.push_back({base + "/of-bare/tick", cost.ratio, "times", n,
                       info.method == ForceMethod::kTrilinear ? std::optional(kMaxTickRatio) : std::nullopt});
    add("/rate", tick_kHz, update_kHz, "kHz");
    add("/of-R4400", tick_kHz / kFoundingR4400_kHz, update_kHz / kFoundingR4400_kHz, "times");
    add("/of-Pentium-Pro", tick_kHz / kFoundingPentiumPro_kHz, update_kHz / kFoundingPentiumPro_kHz, "times");
  }
  return figures;
}

// groups the figures of all rates by kind, as required by the table
std::vector<Figure> sorted_by_kind(const std::vector<Figure>& figures) {
  const auto kind_of = [](const Figure& figure) {
    return figure.name.find("/share/") != std::string::npos   ? 1
           : figure.name.find("/ticks/") != std::string::npos ? 2
                                                              : 0;
  };
  std::vector<Figure> sorted = figures;
  std::stable_sort(sorted.begin(), sorted.end(),
                   [&](const Figure& a, const Figure& b) { return kind_of(a) < kind_of(b); });
  return sorted;
}

}  // namespace

double lateness_ratio_limit(double bare_us, double compute_us) {
  return std::max(kMaxLatenessRatio, 1 + compute_us / bare_us);
}

std::vector<Figure> pace_figures(double rate_hz, const PaceFigures& pace) {
  const std::string base = number(rate_hz / 1000) + "-kHz";
  const bool limited = std::min(pace.ticks, pace.bare_ticks) >= kMinTicksForLimits;
  // the lateness of a thread without real-time priority depends on other load
  const bool lateness_limited = limited && pace.scheduling.realtime;
  std::vector<Figure> figures;

  add_percentiles(figures, base + "/compute", pace.compute, pace.ticks);
  add_percentiles(figures, base + "/lateness/servo", pace.lateness, pace.ticks);
  add_percentiles(figures, base + "/lateness/bare", pace.bare_lateness, pace.bare_ticks);
  const std::uint64_t both = std::min(pace.ticks, pace.bare_ticks);
  add_ratio(figures, base + "/lateness/ratio/p50", pace.typical_p50, both);
  add_ratio(figures, base + "/lateness/ratio/p99", pace.typical_p99, both);
  std::optional<double> compute_us;
  if (lateness_limited) compute_us = pace.compute.p50_us;
  add_ratio(figures, base + "/lateness/least-ratio/p50", pace.min_p50, both, compute_us);
  add_ratio(figures, base + "/lateness/least-ratio/p99", pace.min_p99, both, compute_us);

  figures.push_back({base + "/share/on-time", 100 * pace.on_time, "percent", pace.ticks, {}});
  figures.push_back({base + "/share/contact", 100 * pace.in_contact, "percent", pace.ticks, {}});

  const auto count = [&](const char* name, std::uint64_t value, std::optional<double> limit = {}) {
    figures.push_back({base + "/ticks/" + name, static_cast<double>(value), "ticks", pace.ticks, limit});
  };
  count("dropped", pace.dropped, 0.0);
  count("skipped", pace.skipped);
  count("bare-skipped", pace.bare_skipped);
  count("late", pace.late.total());
  count("steal", pace.late.steal);
  count("page-fault", pace.late.page_fault);
  count("pre-emption", pace.late.preemption);
  count("run-queue", pace.late.run_queue);
  count("unknown", pace.late.unknown);
  return figures;
}

Result<SuiteReport> run_latency(const SuiteOptions& options, const Progress& progress, const Warn& warn) {
  if (auto error = out_of_range(options)) return *error;
  const auto loaded = load_scene_or_data_set({options.scene.value_or("knee-phantom")}, progress, warn);
  if (!loaded) return loaded.error();
  if (auto touchable = require_touchable_tissue(*loaded); !touchable) return touchable.error();
  return measure_latency(*loaded, options, progress);
}

Result<SuiteReport> measure_latency(const LoadedScene& loaded, const SuiteOptions& options,
                                    const Progress& progress) {
  if (auto error = out_of_range(options)) return *error;
  const double seconds = options.seconds.value_or(kDefaultSeconds);
  const double spin_us = options.spin_us.value_or(0);
  std::vector<double> rates_hz(std::begin(kRates_hz), std::end(kRates_hz));
  if (options.rate_hz) rates_hz = {*options.rate_hz};
  const auto path = palpate_once(loaded, progress);
  if (!path) return path.error();
  // by the trilinear method, whatever the scene's: the loop renders the only one that is prepared
  constexpr ForceMethod kPaced[] = {ForceMethod::kTrilinear};
  const auto paced = prepared_with_cache(loaded.model, kPaced, progress);
  if (!paced) return paced.error();

  SuiteReport report;
  Scheduling scheduling;
  for (const double rate_hz : rates_hz) {
    const PaceSettings settings{.rate_hz = rate_hz, .spin_s = spin_us * 1e-6};
    const auto pace = measure_pace(*paced, *path, settings, seconds, progress);
    if (!pace) return pace.error();
    scheduling = pace->scheduling;
    const auto figures = pace_figures(rate_hz, *pace);
    report.figures.insert(report.figures.end(), figures.begin(), figures.end());
  }
  report.figures = sorted_by_kind(report.figures);
  const auto free_running = free_running_figures(loaded, *path, progress);
  if (!free_running) return free_running.error();
  report.figures.insert(report.figures.end(), free_running->begin(), free_running->end());

  const Model& model = *loaded.model;
  const auto& dims = model.labels->geometry().dims;
  report.notes = {
      {"scheduler", scheduling.scheduler},
      {"memory", scheduling.memory},
      {"scene", model.title + ", " + std::to_string(dims[0]) + "x" + std::to_string(dims[1]) + "x" +
                    std::to_string(dims[2]) + " voxels"},
      {"pace", number(seconds) + " s of each loop at each rate, in turn; spin " + number(spin_us) + " us"},
      {"founding", "4800 ticks/s on an R4400 at 250 MHz, 6500 on a Pentium Pro at 200 MHz"}};
  return report;
}

}  // namespace palpate
