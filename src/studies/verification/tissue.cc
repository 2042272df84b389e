#include "verification/tissue.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>
#include <span>

#include "palpate/stability/stability.h"
#include "verification/figure_names.h"
#include "verification/stability_energy.h"
#include "verification/tissue_cases.h"
#include "verification/tissue_frame.h"
#include "verification/tissue_removal.h"
#include "verification/tissue_tick.h"

namespace palpate {
namespace {

constexpr int kFrames = 41, kRippleSteps = 8, kNoduleSteps = 20;
constexpr double kLayerRoots[] = {0.3, 0.4};

/// Worst of several cases.
class WorstCase {
 public:
  void add(const TissueDeviation& one) {
    error_percent_ = std::max(error_percent_, std::abs(one.error_percent));
    ++count_;
  }
  Figure figure(std::string name, std::optional<double> limit) const {
    return {std::move(name), error_percent_, "percent", count_, limit};
  }

 private:
  double error_percent_ = 0;
  std::uint64_t count_ = 0;
};

struct NamedNormal {
  const char* name;
  Vector<Patient> outward;
};
const NamedNormal kNormals[] = {
    {"along", {0, 0, 1}}, {"45deg", {1, 0, 1}}, {"corner", {1, 1, 1}}, {"askew", {0.4, 0.3, 1}}};

std::string ratio_name(const char* prefix, double value) {
  char text[64];
  std::snprintf(text, sizeof text, "%s%.2f", prefix, value);
  return text;
}

// error of the tick, by speed
struct AtSpeed {
  double mm_s;
  std::optional<double> largest_percent, mean_percent;
};
constexpr AtSpeed kLinearSpeeds[] = {{20, 2, 0.5}, {50, 6, 1}, {100, 18, 3}};
constexpr AtSpeed kFiniteSpeeds[] = {{20, 10, {}}, {50, {}, {}}};

Result<void> tick_figures(TissueLaw law, std::span<const AtSpeed> speeds, const std::string& prefix,
                          const Progress& progress, std::vector<Figure>& figures) {
  const auto model = soft_block(true, law);
  if (!model) return model.error();
  for (const AtSpeed& speed : speeds) {
    char at[32];
    std::snprintf(at, sizeof at, "/%.0f-mm-s", speed.mm_s);
    const auto add = [&](const char* motion, const TickError& error) {
      const auto samples = static_cast<std::uint64_t>(error.samples);
      const std::string path = prefix + motion + at;
      figures.push_back(
          {path + "/largest", error.largest_percent, "percent", samples, speed.largest_percent});
      figures.push_back({path + "/mean", error.mean_percent, "percent", samples, speed.mean_percent});
    };
    if (progress.stopped()) return Progress::interrupted();
    add("pressed", press_tissue(*model, speed.mm_s, 12));
    add("pressed-on-nodule", press_tissue(*model, speed.mm_s, 0));
    add("slid-over-nodule", slide_on_tissue(*model, speed.mm_s));
  }
  figures.push_back({prefix + "at-rest/change", change_at_rest_N(*model), "N", 400, 0.02});
  figures.push_back(
      {prefix + "work-given-out", std::max(0.0, generated_work_percent(*model, 20)), "percent", 1, 2});
  const auto plain = soft_block(false, law);
  if (!plain) return plain.error();
  const OverNodule over = over_nodule(*model, *plain, 3);
  figures.push_back({prefix + "over-nodule/force", over.force_percent, "percent", 1, {}});
  figures.push_back({prefix + "over-nodule/stiffness", over.stiffness_percent, "percent", 1, {}});
  return {};
}

// tissue that is cut while it is pressed
Result<void> removal_figures(const Progress& progress, std::vector<Figure>& figures) {
  const auto model = soft_block(false);
  if (!model) return model.error();
  const auto add = [&](const char* path, double speed_mm_s, const CutTissue& cut,
                       std::optional<double> max_change) {
    char at[64];
    std::snprintf(at, sizeof at, "tissue/removal/%s/%.0f-mm-s/", path, speed_mm_s);
    figures.push_back({at + std::string("lag"), cut.lag_percent, "percent", cut.frames, 0.1});
    figures.push_back({at + std::string("behind"), cut.behind_percent, "percent", cut.frames, {}});
    figures.push_back({at + std::string("change"), cut.change_percent, "percent", cut.frames, max_change});
    figures.push_back({at + std::string("follow-time"), cut.update_ms, "ms", cut.frames, {}});
    figures.push_back({at + std::string("frame-time"), cut.frame_ms, "ms", cut.frames, {}});
  };
  for (const double speed : {10.0, 40.0}) {
    if (progress.stopped()) return Progress::interrupted();
    add("milled-beside", speed, mill_nearby(**model, speed), 1.5);
  }
  // at higher speeds the ripple of a surface that sinks through cells dominates (docs/results/tissue.md)
  for (const double speed : {2.0, 5.0}) {
    if (progress.stopped()) return Progress::interrupted();
    add("trimmed-under", speed, trim_under(**model, speed), speed < 3 ? std::optional(1.5) : std::nullopt);
  }
  const Recentring slid = slide_through_boxes(**model, 50);
  figures.push_back({"tissue/removal/box-laid-anew/change", slid.change_percent, "percent", slid.boxes, 2.5});
  return {};
}

// tissue that is pressed and held
Result<void> relaxation_figures(const Progress& progress, std::vector<Figure>& figures) {
  constexpr Relaxation kSeries{{{{0.35, 0.25}, {0.25, 1.5}}}};
  const auto elastic = soft_block(false), relaxing = soft_block(false, TissueLaw::kElastic, kSeries);
  const auto nodule = soft_block(true, TissueLaw::kElastic, kSeries);
  for (const auto* model : {&elastic, &relaxing, &nodule})
    if (!*model) return model->error();
  const RelaxationError pressed = press_relaxing(*relaxing, *elastic, kSeries, 6);
  const auto samples = static_cast<std::uint64_t>(pressed.samples);
  const std::string in = "tissue/relaxation/";
  figures.push_back({in + "pressed/off", pressed.pressed_percent, "percent", samples, 1});
  figures.push_back({in + "held/off", pressed.hold_percent, "percent", samples, 1});
  figures.push_back({in + "held/left", 100 * pressed.remaining_fraction, "percent", 1, {}});
  if (progress.stopped()) return Progress::interrupted();
  for (const OscillationError& swung : swing_relaxing(*relaxing, *elastic, kSeries)) {
    char at[32];
    std::snprintf(at, sizeof at, "swung/%.0f-Hz/", swung.hz);
    figures.push_back({in + at + "angle-off", swung.phase_error_percent, "percent", 1, 1});
    figures.push_back({in + at + "size-off", swung.magnitude_error_percent, "percent", 1, 1});
  }
  if (progress.stopped()) return Progress::interrupted();
  figures.push_back({in + "slid-over-nodule/work-given-out",
                     std::max(0.0, generated_work_percent(*nodule, 20)), "percent", 1, 2});
  return {};
}

// energy that simulated hands and devices gain
Result<void> energy_of_tissue(const Progress& progress, std::vector<Figure>& figures) {
  struct LoopCase {
    double rate_hz, delay_s;
  };
  constexpr LoopCase kLoops[] = {{1000, 0},    {4000, 0},    {1000, 1e-3}, {1000, 3e-3},
                                 {1000, 2e-3}, {2000, 0},    {2000, 1e-3}, {2000, 2e-3},
                                 {2000, 3e-3}, {4000, 1e-3}, {4000, 2e-3}, {4000, 3e-3}};
  struct BallCase {
    double kPa;
    const char* name;
    Relaxation relaxation;
    std::size_t loops, devices, hands;  // number of the first loops, devices and hands used
    TissueLaw law = TissueLaw::kElastic;
  };
  // a neo-Hookean frame costs three times as much: only the softest ball, which deforms most, and one device
  constexpr BallCase kBalls[] = {{10, "", {}, std::size(kLoops), 2, 4},
                                 {100, "", {}, 4, 2, 2},
                                 {1000, "", {}, 4, 2, 2},
                                 {100, "-that-relaxes", {{{{0.5, 0.3}, {}}}}, 1, 2, 2},
                                 {10, "-neo-hookean", {}, 4, 1, 2, TissueLaw::kNeoHookean}};
  constexpr const char* kDevices[] = {"premium-1.5", "touch"};
  // the documented hands, and one with less damping
  const std::vector<PlantHand> hands{*find_plant_hand("light-grip"),
                                     *find_plant_hand("firm-grip"),
                                     *find_plant_hand("whole-arm"),
                                     {"loose-grip", 0.15, 0.3, 80}};
  constexpr double kTime_s = 6;
  for (const BallCase& ball_case : kBalls) {
    const auto ball = soft_ball(ball_case.kPa, ball_case.law, progress, ball_case.relaxation);
    if (!ball) return ball.error();
    for (const LoopCase& loop : std::span(kLoops).first(ball_case.loops))
      for (const char* device : std::span(kDevices).first(ball_case.devices)) {
        Exploration exploration{*find_plant_device(device), {}};
        const auto stiffness =
            recommended_stiffness_N_per_mm(exploration.device, loop.rate_hz, loop.delay_s, progress);
        if (!stiffness) return stiffness.error();
        exploration.stiffness_N_per_mm = *stiffness;
        exploration.rate_hz = loop.rate_hz;
        exploration.delay_s = loop.delay_s;
        exploration.time_s = kTime_s;
        for (const PlantHand& hand : std::span(hands).first(ball_case.hands)) {
          if (progress.stopped()) return Progress::interrupted();
          exploration.hand = hand;
          const EnergyBalance energy = simulate_exploration(**ball, exploration);
          const double hidden_mJ = energy.largest_force_N * 2 * exploration.device.encoder_step_m * 1e3;
          char path[96];
          std::snprintf(path, sizeof path, "tissue/energy/%.0f-kPa%s/%s/%s/", ball_case.kPa, ball_case.name,
                        device, hand.name.c_str());
          figures.push_back({path + loop_name(loop.rate_hz, loop.delay_s) + "/given-out", 0 - energy.min_mJ,
                             "mJ", static_cast<std::uint64_t>(std::lround(kTime_s * loop.rate_hz)),
                             loop.delay_s == 0 ? std::optional(hidden_mJ) : std::nullopt});
        }
      }
  }
  return {};
}

}  // namespace

Result<SuiteReport> run_tissue(const Progress& progress) {
  SuiteReport report;
  std::vector<Figure>& figures = report.figures;
  const auto one = [&](const std::string& name, const TissueDeviation& found, std::optional<double> limit) {
    figures.push_back({"tissue/" + name, std::abs(found.error_percent), "percent", 1, limit});
  };
  const auto stopped = [&] { return progress.stopped(); };

  for (const double nu : {0.3, 0.49}) one("patch/" + ratio_name("nu-", nu), patch_case(16, nu), 1e-3);
  one("turned", turned_case(16), 1e-3);
  one("cantilever", cantilever_case(8), 3);
  one("cook", cook_case(96), 3);
  if (stopped()) return Progress::interrupted();
  WorstCase series;
  for (const double seam : {0.0, 0.25, 0.5, 0.7}) series.add(series_case(seam));
  figures.push_back(series.figure("tissue/layers-in-series", 2));
  for (const double nu : {0.3, 0.45, 0.49})
    one("boussinesq/" + ratio_name("nu-", nu), boussinesq_case(64, nu), 5);
  figures.push_back(
      {"tissue/convergence/short-of-2", std::max(0.0, 2 - convergence_order(8)), "order", 2, 0.3});
  if (stopped()) return Progress::interrupted();

  for (const auto& [name, outward] : kNormals) {
    // compressible tissue separately: its error is larger where the surface runs within cells along their
    // faces
    WorstCase off, compressible, ripple;
    for (const double radius : {1.0, 2.0, 4.0}) {
      HalfSpacePress press;
      press.cells = 40;
      press.outward = outward;
      press.radius_cells = radius;
      for (const double nu : {0.3, 0.45, 0.49}) {
        press.poissons_ratio = nu;
        for (const auto& offset : {Vector<Patient>(0.5, 0.5, 0.5), Vector<Patient>(0.2, 0.1, 0.3),
                                   Vector<Patient>(0.31, 0.77, 0.93)}) {
          if (stopped()) return Progress::interrupted();
          press.offset_cells = offset;
          (nu < 0.4 ? compressible : off).add(hertz_case(press));
        }
      }
      press.cells = 32;
      press.poissons_ratio = 0.45;
      if (radius < 4) ripple.add(ripple_case(press, kRippleSteps));
    }
    figures.push_back(off.figure(std::string("tissue/hertz/") + name + "/off", 7));
    figures.push_back(compressible.figure(std::string("tissue/hertz/") + name + "/off-at-nu-0.30", 10));
    figures.push_back(ripple.figure(std::string("tissue/hertz/") + name + "/ripple", 1.5));
  }
  one("flat-punch", punch_case(48, 8), 7);
  for (const double nu : {0.45, 0.49})
    for (const double root : kLayerRoots) {
      if (stopped()) return Progress::interrupted();
      one("bonded-layer/" + ratio_name("nu-", nu) + "/" + ratio_name("root-", root), layer_case(8, nu, root),
          5);
    }

  if (stopped()) return Progress::interrupted();
  const NoduleLoop loop = nodule_loop(32, kNoduleSteps);
  figures.push_back({"tissue/nodule/work-lost", std::abs(loop.error_percent), "percent", kNoduleSteps, 2});
  figures.push_back({"tissue/nodule/work-lost-without-force-aside",
                     std::abs(loop.error_without_tangential_percent),
                     "percent",
                     kNoduleSteps,
                     {}});
  figures.push_back({"tissue/nodule/stiffer", loop.stiffer_percent, "percent", 1, {}});

  WorstCase stretched;
  for (const double height_ratio : {0.6, 0.8, 1.3}) stretched.add(stretched_case(height_ratio));
  figures.push_back(stretched.figure("tissue/neo-hookean/stretched", 0.1));
  if (stopped()) return Progress::interrupted();
  const FiniteLayer finite = finite_layer({47, 32, 8}, 0.2);
  one("neo-hookean/linear-off", {finite.linear_error_percent, 0}, 5);
  figures.push_back(
      {"tissue/neo-hookean/most-squeezed", 100 * (1 - finite.min_volume), "percent", finite.cells, 90});
  figures.push_back({"tissue/neo-hookean/frame-off", finite.frame_error_percent, "percent", 1, {}});
  figures.push_back({"tissue/neo-hookean/frame-time", finite.frame_ms, "ms", finite.cells, {}});

  auto in_tick = tick_figures(TissueLaw::kElastic, kLinearSpeeds, "tissue/tick/", progress, figures);
  if (!in_tick) return in_tick.error();
  in_tick =
      tick_figures(TissueLaw::kNeoHookean, kFiniteSpeeds, "tissue/tick/neo-hookean/", progress, figures);
  if (!in_tick) return in_tick.error();
  if (auto relaxed = relaxation_figures(progress, figures); !relaxed) return relaxed.error();
  if (auto removed = removal_figures(progress, figures); !removed) return removed.error();
  if (auto energies = energy_of_tissue(progress, figures); !energies) return energies.error();
  const TissueFrame frame = measure_tissue_frame(kFrames);
  figures.push_back({"tissue/frame/time", frame.frame_ms, "ms", kFrames, {}});
  figures.push_back({"tissue/frame/compliance-off", frame.error_percent, "percent", kFrames, 2});
  figures.push_back({"tissue/kernel/time", frame.kernel_ns, "ns", frame.cells, {}});
  figures.push_back({"tissue/kernel/bandwidth-floor", frame.floor_ns, "ns", frame.cells, {}});
  figures.push_back(
      {"tissue/kernel/times-floor", frame.kernel_ns / frame.floor_ns, "times", frame.cells, {}});
  report.notes = {
      {"cases", "docs/results/tissue.md; a sphere's contact has the radius of 1, 2 and 4 cells"},
      {"frame",
       "two iterations from the last solution while a sphere slides at 20 mm/s, 60 frames a second, "
       "39 105 deformable cells; processor time of one thread"},
      {"kernel", "K u for a cell, compared with a plain loop over the same number of bytes"}};
  return report;
}

}  // namespace palpate
