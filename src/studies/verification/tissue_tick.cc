#include "verification/tissue_tick.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <vector>

#include "palpate/model/make_model.h"
#include "palpate/servo/servo.h"
#include "palpate/tissue/soft_tissue_solver.h"

namespace palpate {
namespace {

constexpr double kTickRate_hz = 1000, kTissueTool_mm = 3;
constexpr int kBlockHalf_mm = 36, kPlateDeep_mm = 24;
constexpr LabelId kSoftLabel = 1, kNoduleLabel = 2, kPlateLabel = 3;
// duration of the force ramp-in, and starting height above the surface
constexpr double kTissueWait_s = 0.6, kBeginAbove_mm = 4;

/// A tip moved along a path at 1 kHz, with tissue frames one frame late, as in a session.
class TissueTip {
 public:
  explicit TissueTip(std::shared_ptr<const Model> model) : model_(std::move(model)) {
    parameters_.method = ForceMethod::kProxy;
    parameters_.friction = parameters_.viscosity = false;
    parameters_.max_force_N = 20;
    parameters_.device[0].limits.peak_force_N = 20;
  }

  // @param observe  called with every tick
  void lead(const Eigen::Vector3d& to, double speed_mm_s,
            const std::function<void(const TickRecord&)>& observe = {}) {
    const double distance_mm = (to - at_).norm();
    const int ticks = std::max(1, static_cast<int>(std::lround(kTickRate_hz * distance_mm / speed_mm_s)));
    const Eigen::Vector3d from = at_;
    for (int n = 1; n <= ticks; ++n) {
      at_ = from + (to - from) * (static_cast<double>(n) / ticks);
      tick(observe);
    }
  }
  void go_to(const Eigen::Vector3d& to, const std::function<void(const TickRecord&)>& observe = {}) {
    at_ = to;
    tick(observe);
  }
  void wait(double time_s, const std::function<void(const TickRecord&)>& observe = {}) {
    for (int n = 0; n < kTickRate_hz * time_s; ++n) tick(observe);
  }
  void begin_at(const Eigen::Vector3d& at) {
    at_ = at;
    wait(kTissueWait_s);
  }

 private:
  void tick(const std::function<void(const TickRecord&)>& observe) {
    if (virtual_solver_.advance(*model_, state_.tick > 0 ? &record_ : nullptr))
      parameters_.compliance = virtual_solver_.frame();
    DeviceState device;
    device.tip = model_->X_WorldPatient * Point<Patient>(at_);
    Wrench wrench;
    palpate::tick(*model_, parameters_, {&device, 1}, 1 / kTickRate_hz, state_, {&wrench, 1}, record_);
    if (observe) observe(record_);
  }

  const std::shared_ptr<const Model> model_;
  Parameters parameters_;
  SessionState state_;
  TickRecord record_;
  VirtualClockSoftTissueSolver virtual_solver_{kTickRate_hz};
  Eigen::Vector3d at_ = {0, 0, kBeginAbove_mm};
};

/// Force of the converged solution at the position and depth of a tick.
class ConvergedForce {
 public:
  explicit ConvergedForce(std::shared_ptr<const Model> model) : model_(std::move(model)) {}

  double at(const TickRecord& tick) {
    constexpr int kSettling = 8;
    TickRecord still = tick;
    DeviceTick& device = still.device[0];
    device.velocity_patient_mm_s = {};
    double force_N = 0;
    for (int n = 0; n < kSettling; ++n) {
      const LocalCompliance& local = solver_.solve(*model_, still).local_compliance[0];
      if (!local.is_known()) return 0;
      force_N = soft_contact_force(contact_law_of(local), device.depth_mm, kTissueTool_mm).force_N;
      device.contact_N[0] = force_N;
    }
    return force_N;
  }

 private:
  const std::shared_ptr<const Model> model_;
  SoftTissueSolver solver_;
};

/// Compares at intervals of several ticks.
class TissueComparison {
 public:
  TissueComparison(std::shared_ptr<const Model> model, int every) : truth_(std::move(model)), every_(every) {}

  void observe(const TickRecord& tick) {
    if (ticks_++ % every_ != 0 || tick.device[0].contact_label[0] == 0) return;
    const double truth_N = truth_.at(tick);
    // normal component, as in the converged solution
    const double error_N = std::abs(-tick.device[0].contact_N[0] + truth_N);
    error_.peak_N = std::max(error_.peak_N, truth_N);
    largest_N_ = std::max(largest_N_, error_N);
    sum_N_ += error_N;
    ++error_.samples;
  }
  TickError error() const {
    TickError error = error_;
    if (error.samples == 0) return error;
    error.largest_percent = 100 * largest_N_ / error.peak_N;
    error.mean_percent = 100 * sum_N_ / error.samples / error.peak_N;
    return error;
  }

 private:
  ConvergedForce truth_;
  const int every_;
  int ticks_ = 0;
  double largest_N_ = 0, sum_N_ = 0;
  TickError error_;
};

// interval that gives some twenty comparisons along a path
int ticks_between_comparisons(double distance_mm, double speed_mm_s) {
  return std::max(1, static_cast<int>(kTickRate_hz * distance_mm / speed_mm_s / 20));
}

// fraction of a stress that remains after a time
double remaining_fraction(const Relaxation& relaxation, double time_s) {
  double remaining = 1;
  for (const RelaxationTerm& term : relaxation.term)
    if (term.fraction > 0) remaining += term.fraction * std::expm1(-time_s / term.time_s);
  return remaining;
}

}  // namespace

Result<std::shared_ptr<const Model>> soft_block(bool nodule, TissueLaw law, const Relaxation& relaxation) {
  GridGeometry grid;
  grid.dims = {2 * kBlockHalf_mm, 2 * kBlockHalf_mm, kPlateDeep_mm + 9};
  grid.spacing_mm = Eigen::Vector3d::Ones();
  // the surface is between two voxels
  grid.origin = Point<Patient>(-kBlockHalf_mm + 0.5, -kBlockHalf_mm + 0.5, -kPlateDeep_mm - 2.5);
  Volume<LabelId> labels(grid);
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 1; j + 1 < grid.dims[1]; ++j)
      for (int i = 1; i + 1 < grid.dims[0]; ++i) {
        const Eigen::Vector3d p = (X_PatientVoxel * Point<Voxel>(i, j, k)).eigen();
        const bool hard = nodule && (p - Eigen::Vector3d(0, 0, -9)).norm() < 4;
        labels.at(i, j, k) = p.z() > 0                ? LabelId{0}
                             : p.z() < -kPlateDeep_mm ? kPlateLabel
                             : hard                   ? kNoduleLabel
                                                      : kSoftLabel;
      }
  ModelParts parts;
  parts.labels = label_bricks(labels);
  for (const auto& [label, name] :
       {std::pair(kSoftLabel, "soft tissue"), {kNoduleLabel, "nodule"}, {kPlateLabel, "plate"}})
    parts.segments.push_back({label, name, {}, 0, label});
  Tissue soft, hard, plate;
  soft.name = "soft tissue";
  soft.stiffness_N_per_mm = 0.3;
  soft.elastic = ElasticConstants{10, 0.45};
  hard.name = "nodule";
  hard.stiffness_N_per_mm = 0.6;
  hard.elastic = ElasticConstants{100, 0.45};
  soft.relaxation = hard.relaxation = relaxation;
  plate.name = "plate";
  plate.stiffness_N_per_mm = 2;
  parts.tissues = {soft, hard, plate};
  parts.tissue_of_label = {-1, 0, 1, 2};
  parts.tissue_law = law;
  parts.tissue_cell_mm = 1;
  Tool tool;
  tool.radius_mm = kTissueTool_mm;
  parts.tools = {tool};
  auto made = make_model(std::move(parts));
  if (!made) return made.error();
  const ForceMethod proxy = ForceMethod::kProxy;
  return prepared_for(*made, {&proxy, 1});
}

TickError press_tissue(const std::shared_ptr<const Model>& model, double speed_mm_s, double x_mm) {
  constexpr double kDepth_mm = 4;
  TissueTip tip(model);
  TissueComparison comparison(model, ticks_between_comparisons(kDepth_mm, speed_mm_s));
  tip.begin_at({x_mm, 0, kTissueTool_mm + kBeginAbove_mm});
  tip.lead({x_mm, 0, kTissueTool_mm - kDepth_mm}, speed_mm_s,
           [&](const TickRecord& tick) { comparison.observe(tick); });
  return comparison.error();
}

TickError slide_on_tissue(const std::shared_ptr<const Model>& model, double speed_mm_s) {
  constexpr double kDepth_mm = 3, kFar_mm = 18;
  TissueTip tip(model);
  TissueComparison comparison(model, ticks_between_comparisons(2 * kFar_mm, speed_mm_s));
  tip.begin_at({-kFar_mm, 0, kTissueTool_mm + kBeginAbove_mm});
  tip.lead({-kFar_mm, 0, kTissueTool_mm - kDepth_mm}, 20);
  tip.wait(0.1);
  tip.lead({kFar_mm, 0, kTissueTool_mm - kDepth_mm}, speed_mm_s,
           [&](const TickRecord& tick) { comparison.observe(tick); });
  return comparison.error();
}

double change_at_rest_N(const std::shared_ptr<const Model>& model) {
  TissueTip tip(model);
  tip.begin_at({3, 1, kTissueTool_mm + kBeginAbove_mm});
  tip.lead({3, 1, kTissueTool_mm - 4}, 50);
  tip.wait(0.1);
  double before_N = -1, max_N = 0;
  tip.wait(0.4, [&](const TickRecord& tick) {
    const double now_N = tick.device[0].unclamped_force_N;
    if (before_N >= 0) max_N = std::max(max_N, std::abs(now_N - before_N));
    before_N = now_N;
  });
  return max_N;
}

double generated_work_percent(const std::shared_ptr<const Model>& model, double speed_mm_s) {
  constexpr double kFar_mm = 10, kUnder_mm = kTissueTool_mm - 3, kOver_mm = kTissueTool_mm + 1;
  TissueTip tip(model);
  double work_mJ = 0, max_mJ = 0;
  Eigen::Vector3d before = Eigen::Vector3d::Zero(), force_before = Eigen::Vector3d::Zero();
  bool any = false;
  const auto observe = [&](const TickRecord& tick) {
    const DeviceTick& device = tick.device[0];
    const Eigen::Vector3d at(device.tip_world_mm[0], device.tip_world_mm[1], device.tip_world_mm[2]),
        force(device.force_N[0], device.force_N[1], device.force_N[2]);
    // trapezoidal rule: energy generated by the sample-and-hold is not attributed to the tissue
    if (any) work_mJ -= 0.5 * (force + force_before).dot(at - before);
    max_mJ = std::max(max_mJ, work_mJ);
    before = at;
    force_before = force;
    any = true;
  };
  tip.begin_at({-kFar_mm, 0.5, kOver_mm});
  tip.lead({-kFar_mm, 0.5, kUnder_mm}, speed_mm_s, observe);
  tip.lead({kFar_mm, 0.5, kUnder_mm}, speed_mm_s, observe);
  tip.lead({kFar_mm, 0.5, kOver_mm}, speed_mm_s, observe);
  return -100 * work_mJ / max_mJ;
}

OverNodule over_nodule(const std::shared_ptr<const Model>& nodule, const std::shared_ptr<const Model>& plain,
                       double depth_mm) {
  constexpr double kSpeed_mm_s = 20, kSettles_s = 0.2, kStep_mm = 1;
  const auto force_N = [&](const std::shared_ptr<const Model>& model, double deep_mm) {
    TissueTip tip(model);
    tip.begin_at({0, 0, kTissueTool_mm + kBeginAbove_mm});
    tip.lead({0, 0, kTissueTool_mm - deep_mm}, kSpeed_mm_s);
    double rendered_N = 0;
    tip.wait(kSettles_s, [&](const TickRecord& tick) { rendered_N = tick.device[0].unclamped_force_N; });
    return rendered_N;
  };
  const double over_N = force_N(nodule, depth_mm), plain_N = force_N(plain, depth_mm);
  const double over_before_N = force_N(nodule, depth_mm - kStep_mm),
               plain_before_N = force_N(plain, depth_mm - kStep_mm);
  return {100 * (over_N / plain_N - 1), 100 * ((over_N - over_before_N) / (plain_N - plain_before_N) - 1)};
}

RelaxationError press_relaxing(const std::shared_ptr<const Model>& relaxing,
                               const std::shared_ptr<const Model>& elastic, const Relaxation& relaxation,
                               double held_s) {
  constexpr double kDepth_mm = 3;
  constexpr int kEvery = 10, kOfPress = 1000;
  const auto forces_N = [&](const std::shared_ptr<const Model>& model) {
    TissueTip tip(model);
    std::vector<double> forces;
    const auto observe = [&](const TickRecord& tick) { forces.push_back(tick.device[0].unclamped_force_N); };
    tip.begin_at({12, 0, kTissueTool_mm + 0.5});
    tip.lead({12, 0, kTissueTool_mm - kDepth_mm}, 100, observe);
    tip.wait(held_s, observe);
    return forces;
  };
  const std::vector<double> rendered_N = forces_N(relaxing), elastic_N = forces_N(elastic);
  RelaxationError error;
  for (std::size_t n = kEvery; n < rendered_N.size(); n += kEvery) {
    // the change of the force is assumed to be uniform within its tick, i.e. at its middle
    double truth_N = 0;
    for (std::size_t m = 1; m <= n; ++m)
      truth_N += (elastic_N[m] - elastic_N[m - 1]) *
                 remaining_fraction(relaxation, (static_cast<double>(n - m) + 0.5) / kTickRate_hz);
    if (!(truth_N > 0)) continue;
    const double percent = 100 * std::abs(rendered_N[n] / truth_N - 1);
    double& largest = n < kOfPress ? error.pressed_percent : error.hold_percent;
    largest = std::max(largest, percent);
    error.remaining_fraction = rendered_N[n] / elastic_N[n];
    ++error.samples;
  }
  return error;
}

std::vector<OscillationError> swing_relaxing(const std::shared_ptr<const Model>& relaxing,
                                             const std::shared_ptr<const Model>& elastic,
                                             const Relaxation& relaxation) {
  constexpr double kHz[] = {1, 3, 10}, kSwing_mm = 0.1;
  constexpr int kSettle = 4000, kObserved = 4000;
  // Fourier coefficients at each frequency over whole periods of all of them, with a Hann window that
  // suppresses the remaining initial transient
  const auto waves = [&](const std::shared_ptr<const Model>& model) {
    TissueTip tip(model);
    std::vector<Eigen::Vector2d> sums(std::size(kHz), Eigen::Vector2d::Zero());
    tip.begin_at({12, 0, kTissueTool_mm + 0.5});
    tip.lead({12, 0, kTissueTool_mm - 3}, 20);
    for (int n = 0; n < kSettle + kObserved; ++n) {
      const auto phase = [&](double hz) { return 2 * std::numbers::pi * hz * n / kTickRate_hz; };
      double z_mm = kTissueTool_mm - 3;
      for (const double hz : kHz) z_mm -= kSwing_mm * std::sin(phase(hz));
      tip.go_to({12, 0, z_mm}, [&](const TickRecord& tick) {
        if (n < kSettle) return;
        const double weight = 1 - std::cos(2 * std::numbers::pi * (n - kSettle + 0.5) / kObserved);
        for (std::size_t f = 0; f < std::size(kHz); ++f)
          sums[f] += weight * tick.device[0].unclamped_force_N *
                     Eigen::Vector2d(std::cos(phase(kHz[f])), std::sin(phase(kHz[f])));
      });
    }
    return sums;
  };
  const std::vector<Eigen::Vector2d> samples = waves(relaxing), elastic_samples = waves(elastic);
  std::vector<OscillationError> all;
  for (std::size_t f = 0; f < std::size(kHz); ++f) {
    double storage = 1, loss = 0;  // moduli relative to the instantaneous one
    for (const RelaxationTerm& term : relaxation.term) {
      const double x = 2 * std::numbers::pi * kHz[f] * term.time_s;
      storage -= term.fraction / (1 + x * x);
      loss += term.fraction * x / (1 + x * x);
    }
    const auto angle = [](const Eigen::Vector2d& wave) { return std::atan2(wave.x(), wave.y()); };
    const double ahead = angle(samples[f]) - angle(elastic_samples[f]), truth = std::atan2(loss, storage);
    const double size = samples[f].norm() / elastic_samples[f].norm(), true_size = std::hypot(storage, loss);
    all.push_back({kHz[f], 100 * std::abs(ahead / truth - 1), 100 * std::abs(size / true_size - 1),
                   ahead * 180 / std::numbers::pi});
  }
  return all;
}

}  // namespace palpate
