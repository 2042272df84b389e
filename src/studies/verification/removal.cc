#include "verification/removal.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "palpate/tissue/removal.h"
#include "verification/accuracy_random.h"
#include "verification/removal_block.h"
#include "verification/removal_plants.h"
#include "verification/removal_thin.h"
#include "verification/removal_volumes.h"

namespace palpate {
namespace {

constexpr std::uint64_t kRemovalSeed = 21;
constexpr double kBurrRadius_mm = 2, kBurrTurns_per_s = 1000, kBoneEnergy_mJ_per_mm3 = 100;
constexpr double kBoneStiffness_N_per_mm = 2;
constexpr double kCarvedEvery_s = 0.02;
// cell size of the Monte Carlo estimate of the swept volume, with one point per cell
constexpr double kCell_mm = 0.12;

/// Motion of a hand with a burr.
struct BurrStroke {
  double along_mm_s = 0;  ///< Prescribed speed along x, regardless of the force; 0: drilling
  double turns_per_s = kBurrTurns_per_s;
  double energy_mJ_per_mm3 = kBoneEnergy_mJ_per_mm3;
  double rate_hz = 1000;
};

struct Taken {
  double reckoned_mm3 = 0, work_mJ = 0;  ///< Volume and work predicted by the removal law
  double swept_mm3 = 0;                  ///< Volume of material in the union of all sweeps
  /// maximum change of the force at a new surface version, and in other ticks
  double edit_N = 0, tick_N = 0;
  bool is_coupled = true;  ///< Whether the proxy stayed coupled
};

/// A hand of 100 g with a damping of 10 N s/m that presses with 2 N and has no other support.
class BurrHand {
 public:
  BurrHand(std::shared_ptr<const Surface> block, const BurrStroke& stroke)
      : stroke_(stroke), carved_(std::move(block)) {
    options_.dt_s = 1 / stroke.rate_hz;
    options_.friction = false;
    touchable_.surface = carved_.surface();
    touchable_.stiffness_N_per_mm = kBoneStiffness_N_per_mm;
    touchable_.cutting_energy_mJ_per_mm3 = stroke.energy_mJ_per_mm3;
    burr_.radius_mm = kBurrRadius_mm;
    burr_.revolutions_per_s = stroke.turns_per_s;
    burr_.axis = Vector<Patient>(1, 0, 0);
    tip_ = Point<Patient>(stroke.along_mm_s > 0 ? -5 : 0, 0, kBurrRadius_mm + 0.5);
  }

  Taken run() {
    constexpr double kLeans_s = 0.2, kCuts_s = 0.6, kLean_N = 0.5, kPress_N = 2;
    run(kLeans_s, kLean_N, 0);
    run(kCuts_s, kPress_N, stroke_.along_mm_s);
    const std::span<const Sweep> pending = burr_state_.pending();
    sweeps_.insert(sweeps_.end(), pending.begin(), pending.end());
    taken_.reckoned_mm3 = burr_state_.removed_mm3;
    taken_.work_mJ = burr_state_.work_mJ;
    taken_.swept_mm3 = swept_mm3();
    return taken_;
  }

 private:
  void run(double seconds, double press_N, double along_mm_s) {
    const long ticks = std::lround(seconds * stroke_.rate_hz);
    const long every = std::lround(kCarvedEvery_s * stroke_.rate_hz);
    for (long n = 0; n < ticks; ++n) {
      const bool edited = n % every == 0 && carve();
      const ProxyResult result =
          advance_burr({&touchable_, 1}, burr_, ToolPose(tip_), proxy_, burr_state_, options_);
      double& change_N = edited ? taken_.edit_N : taken_.tick_N;
      change_N = std::max(change_N, (result.force_N - last_N_).norm());
      last_N_ = result.force_N;
      // implicit in the damping; a newton is 1000 kg mm / s2
      constexpr double kMass_kg = 0.1, kDamping_N_s_per_mm = 0.01;
      const double per_kg = 1000 * options_.dt_s / kMass_kg;
      const Vector<Patient> all_N = result.force_N + Vector<Patient>(0, 0, -press_N);
      velocity_ = (velocity_ + all_N * per_kg) / (1 + per_kg * kDamping_N_s_per_mm);
      if (along_mm_s > 0) velocity_ = Vector<Patient>(along_mm_s, velocity_.y(), velocity_.z());
      tip_ += velocity_ * options_.dt_s;
    }
  }

  // makes the next version of the surface, as a separate thread would; false if nothing was swept
  bool carve() {
    const std::uint64_t count = finished_sweeps(burr_state_);
    const std::span<const Sweep> pending = burr_state_.pending().first(count - burr_state_.first_sweep);
    if (pending.empty()) return false;
    sweeps_.insert(sweeps_.end(), pending.begin(), pending.end());
    carved_ = carved_.with(pending);
    touchable_.surface = carved_.surface();
    touchable_.original_surface = carved_.original();
    touchable_.clearance_error_mm = carved_.clearance_error_mm();
    rebase_burr({&touchable_, 1}, burr_, ToolPose(tip_), count, proxy_, burr_state_);
    const ToolPart head = burr_.head(burr_state_.inset_mm);
    const SurfaceCorrespondence before{0, false};
    transfer_proxy({&touchable_, 1}, {&head, 1}, ToolPose(tip_), {&before, 1}, proxy_);
    taken_.is_coupled = taken_.is_coupled && proxy_.coupled;
    return true;
  }

  double swept_mm3() const {
    if (sweeps_.empty()) return 0;
    Eigen::Array3d low = Eigen::Array3d::Constant(std::numeric_limits<double>::infinity()), high = -low;
    for (const Sweep& sweep : sweeps_) {
      low = low.min(sweep.from.eigen().array().min(sweep.to.eigen().array()) - sweep.radius_mm);
      high = high.max(sweep.from.eigen().array().max(sweep.to.eigen().array()) + sweep.radius_mm);
    }
    std::vector<SweptShape> shapes(sweeps_.begin(), sweeps_.end());
    // stratified sampling with a random point in each cell, so that no plane of the block coincides with a
    // plane of points
    const Eigen::Array3i cells = ((high - low) / kCell_mm).ceil().cast<int>();
    const Eigen::Array3d size_mm = (high - low) / cells.cast<double>();
    AccuracyRandom random(kRemovalSeed);
    long used = 0;
    for (int k = 0; k < cells[2]; ++k)
      for (int j = 0; j < cells[1]; ++j)
        for (int i = 0; i < cells[0]; ++i) {
          const double x = i + random.between(0, 1), y = j + random.between(0, 1),
                       z = k + random.between(0, 1);
          const Point<Patient> position(Eigen::Vector3d(low + Eigen::Array3d(x, y, z) * size_mm));
          // material by the contact surface, which differs from the labels at sharp edges
          if (carved_.original()->distance_mm(position) >= 0) continue;
          used += std::any_of(shapes.begin(), shapes.end(),
                              [&](const SweptShape& shape) { return shape.depth_mm(position) > 0; });
        }
    return size_mm.prod() * static_cast<double>(used);
  }

  const BurrStroke stroke_;
  CarvedSurface carved_;
  ContactSurface touchable_;
  Burr burr_;
  BurrState burr_state_;
  ProxyState proxy_;
  ProxyOptions options_;
  Point<Patient> tip_;
  Vector<Patient> velocity_, last_N_;
  std::vector<Sweep> sweeps_;
  Taken taken_;
};

}  // namespace

Result<std::vector<Figure>> removal_figures(const Progress& progress) {
  std::vector<std::shared_ptr<const Surface>> blocks;
  for (const BlockGrid& grid : kBlockGrids) {
    auto block = bone_block(grid, progress);
    if (!block) return block.error();
    blocks.push_back(*std::move(block));
  }

  std::vector<Figure> figures;
  double beyond_N = 0, error_percent = 0, beyond_work_percent = 0;
  std::uint64_t strokes = 0, let_go = 0;
  const auto take = [&](std::size_t block, const BurrStroke& stroke) {
    const Taken used = BurrHand(blocks[block], stroke).run();
    ++strokes;
    let_go += used.is_coupled ? 0 : 1;
    beyond_N = std::max(beyond_N, used.edit_N - used.tick_N);
    error_percent = std::max(error_percent, 100 * std::abs(used.reckoned_mm3 / used.swept_mm3 - 1));
    const double used_mJ = used.reckoned_mm3 * stroke.energy_mJ_per_mm3;
    beyond_work_percent = std::max(beyond_work_percent, 100 * (used_mJ / used.work_mJ - 1));
    return used.swept_mm3;
  };
  for (const auto& [name, along_mm_s] : {std::pair("drilling", 0.0), std::pair("milling", 12.0)}) {
    RelativeRange rates, grids;
    for (const double rate_hz : kTickRates_Hz) {
      if (progress.stopped()) return Progress::interrupted();
      rates.add(take(0, {.along_mm_s = along_mm_s, .rate_hz = rate_hz}));
    }
    for (std::size_t block = 0; block < blocks.size(); ++block) {
      if (progress.stopped()) return Progress::interrupted();
      grids.add(take(block, {.along_mm_s = along_mm_s}));
    }
    const std::string prefix = std::string("removal/") + name;
    figures.push_back({prefix + "/between-rates", rates.percent(), "percent", rates.count(), 4});
    figures.push_back({prefix + "/between-grids", grids.percent(), "percent", grids.count(), 5});
  }
  figures.push_back({"removal/volume/beside-its-sweeps", error_percent, "percent", strokes, 3});
  figures.push_back({"removal/energy/beyond-work", beyond_work_percent, "percent", strokes, 0.01});
  figures.push_back({"removal/new-version/step-beyond-ticks", std::max(0.0, beyond_N), "N", strokes, 0.01});
  figures.push_back({"removal/new-version/let-go", static_cast<double>(let_go), "strokes", strokes, 0});

  const double still_mm3 = BurrHand(blocks[0], {.turns_per_s = 0}).run().swept_mm3;
  const double hard_mm3 =
      BurrHand(blocks[0], {.energy_mJ_per_mm3 = std::numeric_limits<double>::infinity()}).run().swept_mm3;
  figures.push_back({"removal/nothing/motor-off", still_mm3, "mm3", 1, 0});
  figures.push_back({"removal/nothing/cannot-be-cut", hard_mm3, "mm3", 1, 0});
  return figures;
}

Result<SuiteReport> run_removal(const Progress& progress) {
  auto figures = removal_figures(progress);
  if (!figures) return figures.error();
  const auto volumes = path_volume_figures({}, progress);
  if (!volumes) return volumes.error();
  const auto thin = thin_bone_figures({}, progress);
  if (!thin) return thin.error();
  const auto plants = cutting_plants_figures({}, progress);
  if (!plants) return plants.error();
  SuiteReport report;
  report.figures = *std::move(figures);
  report.figures.insert(report.figures.end(), volumes->begin(), volumes->end());
  report.figures.insert(report.figures.end(), thin->begin(), thin->end());
  report.figures.insert(report.figures.end(), plants->begin(), plants->end());
  report.notes = {
      {"burr", "a ball of 4 mm at 60 000 revolutions a minute, on bone of 100 mJ/mm3 and 2 N/mm"},
      {"hand", "100 g with 10 N s/m that presses with 2 N for 0.6 s, milling at 12 mm/s"},
      {"plants",
       "simulated hands on their devices at 1 kHz, which explore a plane of bone at random "
       "for 20 s with the motor on, and press on it with 1 N for 4 s"},
      {"led",
       "burrs whose tips are led at 10 mm/s through bone of 2 mJ/mm3: balls of 4 mm, cylinders of "
       "3 mm and 8 mm long, cones of 1.8 to 3.5 mm and 7.65 mm long; volumes compared with the analytical "
       "values"},
      {"thin bone",
       "walls, rods, a cellular and a trabecular pattern in a block of 10 by 10 by 4 mm, upright and turned "
       "by 34 "
       "degrees, on grids of 0.2, 0.3 and 0.4 mm at 1 kHz and of 0.3 mm at 250 Hz and 10 kHz; volume paid "
       "for "
       "compared with that of the removed voxels"},
      {"surfaces", "from labels as a scene is prepared, carved every 20 ms"},
      {"rates", "500 Hz to 10 kHz; grids of 0.3 and 0.6 mm, along the block and turned"}};
  return report;
}

}  // namespace palpate
