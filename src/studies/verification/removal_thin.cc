#include "verification/removal_thin.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <numbers>
#include <random>
#include <string>
#include <utility>

#include "palpate/base/check.h"
#include "palpate/model/changed_model.h"
#include "palpate/model/make_model.h"
#include "palpate/tissue/removal.h"
#include "palpate/tissue/removed_volume.h"
#include "palpate/volume/volume.h"
#include "verification/removal_block.h"

namespace palpate {
namespace {

constexpr LabelId kThinBone = 1;
constexpr double kSampleHalf_mm = 5, kSampleDepth_mm = 4, kSampleEnergy_mJ_per_mm3 = 100;

/// Whether a point of a structure, in its own axes, is bone.
using IsBone = std::function<bool(const Eigen::Vector3d&)>;

struct ThinStructure {
  std::string name;
  IsBone is_bone;
};

// distance to the nearest multiple of a period
double off_lattice(double x, double period) {
  return std::abs(x - period * std::round(x / period));
}

ThinStructure walls(double thick_mm) {
  const double period_mm = thick_mm + 1.5;
  return {"walls-" + std::to_string(thick_mm).substr(0, 3),
          [=](const Eigen::Vector3d& p) { return off_lattice(p.x() - 0.37, period_mm) < 0.5 * thick_mm; }};
}
ThinStructure rods(double thick_mm) {
  const double period_mm = thick_mm + 1;
  return {"rods-" + std::to_string(thick_mm).substr(0, 3), [=](const Eigen::Vector3d& p) {
            return std::hypot(off_lattice(p.x() - 0.37, period_mm), off_lattice(p.y() - 0.21, period_mm)) <
                   0.5 * thick_mm;
          }};
}
// gyroid: its sheets between two labyrinths, or one of the labyrinths
double gyroid(const Eigen::Vector3d& p, double period_mm) {
  const Eigen::Array3d s = (p.array() * (2 * std::numbers::pi / period_mm)).sin(),
                       c = (p.array() * (2 * std::numbers::pi / period_mm)).cos();
  return s[0] * c[1] + s[1] * c[2] + s[2] * c[0];
}

ThinStructure cellular() {
  return {"cellular", [](const Eigen::Vector3d& p) { return std::abs(gyroid(p, 3)) < 0.35; }};
}

std::vector<ThinStructure> thin_structures() {
  return {walls(0.2),
          walls(0.4),
          walls(0.8),
          walls(2.0),
          rods(0.6),
          cellular(),
          {"trabecular", [](const Eigen::Vector3d& p) { return gyroid(p, 1.8) > 0.7; }},
          {"solid", [](const Eigen::Vector3d&) { return true; }}};
}

// the structure within a block below z = 0
Result<std::shared_ptr<const Model>> thin_model(const ThinStructure& structure, double voxel_mm,
                                                double turned_rad, const Progress& progress) {
  GridGeometry grid;
  const int half = static_cast<int>(std::ceil((kSampleHalf_mm + 1) / voxel_mm));
  const int below = static_cast<int>(std::ceil(kSampleDepth_mm / voxel_mm)) + 3;
  grid.dims = {2 * half, 2 * half, below + 4};
  grid.spacing_mm = Eigen::Vector3d::Constant(voxel_mm);
  grid.origin = Point<Patient>((0.5 - half) * voxel_mm, (0.5 - half) * voxel_mm, (0.5 - below) * voxel_mm);
  const Eigen::Matrix3d axes =
      Eigen::AngleAxisd(turned_rad, Eigen::Vector3d(1, 2, 0.5).normalized()).toRotationMatrix().transpose();
  Volume<LabelId> labels(grid);
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) {
        const Eigen::Vector3d p = (X_PatientVoxel * Point<Voxel>(i, j, k)).eigen();
        if (std::abs(p.x()) < kSampleHalf_mm && std::abs(p.y()) < kSampleHalf_mm && p.z() < 0 &&
            p.z() > -kSampleDepth_mm && structure.is_bone(axes * p))
          labels.at(i, j, k) = kThinBone;
      }
  ModelParts parts;
  parts.labels = label_bricks(labels);
  parts.segments = {{kThinBone, "bone", {}, 0, kThinBone}};
  Tissue bone;
  bone.name = "bone";
  bone.stiffness_N_per_mm = 2;
  bone.cutting_energy_mJ_per_mm3 = kSampleEnergy_mJ_per_mm3;
  parts.tissues = {bone};
  parts.tissue_of_label = {-1, 0};
  parts.tools[0].radius_mm = 2;
  parts.tools[0].burr = BurrSettings{};
  auto made = make_model(std::move(parts));
  if (!made) return made.error();
  constexpr ForceMethod kMethod = ForceMethod::kProxy;
  return prepared_for(*made, {&kMethod, 1}, {}, progress);
}

struct Account {
  double paid_mm3 =
      0;  ///< Volume whose cutting energy equals the motor's work, including its outstanding debt
  double lost_mm3 = 0;  ///< Volume of the removed voxels
};

/// A hand of 100 g with a damping of 10 N s/m that presses with 2 N and is moved sideways.
class ThinBoneHand {
 public:
  ThinBoneHand(std::shared_ptr<const Model> model, double rate_hz, double along_mm_s)
      : model_(std::move(model)), removed_(*model_), along_mm_s_(along_mm_s) {
    options_.dt_s = 1 / rate_hz;
    options_.friction = false;
    burr_.radius_mm = model_->tools[0].radius_mm;
    burr_.revolutions_per_s = 1000;
    burr_.axis = Vector<Patient>(1, 0, 0);
    burr_.max_press_N = 4;
    burr_.model = model_.get();
    tip_ = Point<Patient>(along_mm_s > 0 ? -2.5 : 0, 0, burr_.radius_mm + 0.3);
  }

  Account run(double seconds) {
    const long ticks = std::lround(seconds / options_.dt_s);
    const long every = std::lround(kCarvedEvery_s / options_.dt_s);
    for (long n = 0; n < ticks; ++n) {
      if (n % every == 0) carve();
      const ProxyResult result =
          advance_burr(model_->surfaces, burr_, ToolPose(tip_), proxy_, state_, options_);
      constexpr double kMass_kg = 0.1, kDamping_N_s_per_mm = 0.01, kPress_N = 2;
      const double per_kg = 1000 * options_.dt_s / kMass_kg;
      const Vector<Patient> all_N = result.force_N + Vector<Patient>(0, 0, -kPress_N);
      velocity_ = (velocity_ + all_N * per_kg) / (1 + per_kg * kDamping_N_s_per_mm);
      velocity_ = Vector<Patient>(along_mm_s_, 0, velocity_.z());
      tip_ += velocity_ * options_.dt_s;
    }
    state_.sweep_closed = true;
    carve();
    const auto volumes = removed_.by_label_mm3();
    // a debt is paid before the next cut
    const double paid_mm3 = state_.removed_mm3 + state_.debt_mJ / kSampleEnergy_mJ_per_mm3;
    return {paid_mm3, volumes.empty() ? 0 : volumes.begin()->second};
  }

  double longest_rest_s(double seconds, std::mt19937& random) {
    constexpr double kAtRest_mm = 0.05, kPressed_N = 1, kPress_N = 1.5, kReached_mm = 0.3, kFastest_mm = 0.02;
    std::uniform_real_distribution<double> across(-3.5, 3.5), deep(-3.5, 0);
    const long every = std::lround(kCarvedEvery_s / options_.dt_s);
    Point<Patient> target, rested_at;
    double target_s = 0, rest_s = 0, longest_s = 0;
    for (long n = 0; n < std::lround(seconds / options_.dt_s); ++n) {
      if (n % every == 0) carve();
      const ProxyResult result =
          advance_burr(model_->surfaces, burr_, ToolPose(tip_), proxy_, state_, options_);
      const Point<Patient> at = proxy_.position;
      target_s -= options_.dt_s;
      if (target_s <= 0 || (target - at).norm() < kReached_mm) {
        target = Point<Patient>(across(random), across(random), deep(random));
        target_s = 0.4;
      }
      const double stretched_mm = kPress_N / model_->surfaces[0].stiffness_N_per_mm;
      const Vector<Patient> step = at + (target - at).normalized() * stretched_mm - tip_;
      tip_ += step * std::min(1.0, kFastest_mm / std::max(step.norm(), kFastest_mm));
      if ((at - rested_at).norm() > kAtRest_mm) {
        rested_at = at;
        rest_s = 0;
      } else if (result.force_N.norm() > kPressed_N) {
        rest_s += options_.dt_s;
      }
      longest_s = std::max(longest_s, rest_s);
    }
    return longest_s;
  }

 private:
  void carve() {
    const std::vector<Cut> cuts = finished_cuts(state_, 0);
    if (cuts.empty()) return;
    removed_.add(cuts);
    const auto carving = carved_by(*model_, cuts);
    model_ = carving->applied_to(*model_);
    settle_burr(carving->carved(0), state_);
    burr_.model = model_.get();
    rebase_burr(model_->surfaces, burr_, ToolPose(tip_), carving->sweeps(0), proxy_, state_);
    const ToolPart head = burr_.head(state_.inset_mm);
    const SurfaceCorrespondence before{0, false};
    transfer_proxy(model_->surfaces, {&head, 1}, ToolPose(tip_), {&before, 1}, proxy_);
  }

  std::shared_ptr<const Model> model_;
  RemovedVolume removed_;
  const double along_mm_s_;
  Burr burr_;
  BurrState state_;
  ProxyState proxy_;
  ProxyOptions options_;
  Point<Patient> tip_;
  Vector<Patient> velocity_;
};

}  // namespace

Result<double> longest_rest_s(double voxel_mm, unsigned seed, double seconds) {
  std::mt19937 random(seed);
  auto model = thin_model(cellular(), voxel_mm, 0.6, {});
  if (!model) return model.error();
  return ThinBoneHand(*model, 1000, 0).longest_rest_s(seconds, random);
}

Result<std::vector<Figure>> thin_bone_figures(const ThinBoneOptions& options, const Progress& progress) {
  std::vector<Figure> figures;
  for (const ThinStructure& structure : thin_structures()) {
    double error_percent = 0;
    std::uint64_t runs = 0;
    for (const double voxel_mm : {0.2, 0.3, 0.4})
      for (const double turned_rad : {0.0, 0.6}) {
        if (!options.all && (structure.name != "walls-0.4" && structure.name != "trabecular")) continue;
        if (!options.all && (voxel_mm != 0.3 || turned_rad == 0)) continue;
        auto model = thin_model(structure, voxel_mm, turned_rad, progress);
        if (!model) return model.error();
        for (const double rate_hz : {250.0, 1000.0, 10000.0})
          for (const double along_mm_s : {0.0, 5.0}) {
            if (progress.stopped()) return Progress::interrupted();
            if (!options.all && (rate_hz != 1000 || along_mm_s == 0)) continue;
            if (rate_hz != 1000 && voxel_mm != 0.3) continue;
            const Account account = ThinBoneHand(*model, rate_hz, along_mm_s).run(options.cut_s);
            // if no voxel was removed, the burr rested on the structure without cutting it: counts as an
            // error of 100 %
            const double off = account.lost_mm3 > 0 ? account.paid_mm3 / account.lost_mm3 - 1 : 1;
            error_percent = std::max(error_percent, 100 * std::abs(off));
            ++runs;
          }
      }
    if (runs == 0) continue;
    figures.push_back({"removal/thin/" + structure.name + "/off-account", error_percent, "percent", runs, 5});
  }
  return figures;
}

}  // namespace palpate
