#include "verification/stability_no_go.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "palpate/device/workspace.h"
#include "palpate/loading/loading.h"
#include "palpate/servo/servo.h"
#include "palpate/stability/stability.h"
#include "verification/figure_names.h"
#include "verification/stability_wall.h"

namespace palpate {
namespace {

constexpr NoGoKind kNoGoKinds[] = {NoGoKind::kPlane, NoGoKind::kStructure, NoGoKind::kTouchable};
// the force is ramped in while the hand rests before the boundary; final rest of the tip
constexpr double kStandOff_mm = 10, kInFirst_s = 0.6, kLeant_s = 1, kAlongFor_s = 0.8, kAtRest_s = 2,
                 kAlongBorder_mm = 8;
constexpr double kMaxPast_mm = 0.5;
// fraction of the highest stiffness that a hand holds (no_go_force)
constexpr double kFractionOfLimit = 0.9;

}  // namespace

const char* name_of(NoGoKind kind) {
  return kind == NoGoKind::kPlane ? "plane" : kind == NoGoKind::kStructure ? "structure" : "felt-wall";
}

Result<std::shared_ptr<const Model>> no_go_wall(NoGoKind kind, double stiffness_N_per_mm,
                                                const LabelMap& labels, const Progress& progress) {
  Scene scene;
  scene.title = "what is kept away from";
  TissueSettings bone;
  bone.name = "bone";
  bone.labels = {LabelReference{1}};
  bone.label_lines = {0};
  bone.stiffness_N_per_mm = 1;
  bone.touchable = kind == NoGoKind::kTouchable;
  scene.tissues = {bone};
  NoGoSettings region;
  region.name = name_of(kind);
  region.keep_away_mm = 0;
  region.stiffness_N_per_mm = stiffness_N_per_mm;
  if (kind == NoGoKind::kPlane) {
    region.shape = NoGoPlane{{}, {1, 0, 0}};
  } else {
    region.structures = {LabelReference{1}};
    region.structure_lines = {0};
  }
  scene.no_go = {region};
  const auto model = build_model(scene, &labels, nullptr, progress);
  if (!model) return model;
  const ForceMethod method = bone.touchable ? ForceMethod::kProxy : ForceMethod::kTrilinear;
  return prepared_with_cache(*model, {&method, 1}, progress);
}

NoGoResult run_no_go_approach(const Model& model, const NoGoApproach& approach, double stiffness_N_per_mm) {
  SimulatedDevice plant(approach.device, approach.hand, approach.delay_s);
  const WorkspaceSettings workspace;
  WorkspaceMapping mapping(plant.info(), workspace);
  Parameters parameters;
  parameters.method = model.has(ForceMethod::kProxy) ? ForceMethod::kProxy : ForceMethod::kTrilinear;
  parameters.device[0] = device_parameters(plant.info(), workspace);
  parameters.device[0].max_stiffness_N_per_mm = approach.stiffness_N_per_mm;
  parameters.device[0].delay_s = approach.delay_s;
  parameters.max_force_N = approach.device.peak_force_N;
  // the surface of the labels is between two voxels
  const auto& tracked = model.distance_trees.structures();
  const double border_mm = tracked.empty() ? 0 : -tracked[0].tree->nearest({})->distance_mm;

  // to the equilibrium of the region's and the hand's springs at this force
  const double hand_N_per_mm = approach.hand.stiffness_N_per_m * 1e-3;
  const double depth_mm =
      approach.press_N / stiffness_N_per_mm + (approach.press_N + approach.device.coulomb_N) / hand_N_per_mm;
  const auto on_device = [&](double x_mm, double y_mm) {
    return mapping.to_device(model.X_WorldPatient * Point<Patient>(x_mm, y_mm, 0));
  };
  const Vector<Device> out = on_device(1, 0) - on_device(0, 0);
  const auto height_mm = [&] { return out.dot(plant.true_tip() - on_device(0, 0)); };
  plant.reset(on_device(kStandOff_mm, 0));

  const double dt_s = 1 / approach.rate_hz;
  const double path_s = (kStandOff_mm + depth_mm) / approach.speed_mm_s;
  const double slides_at_s = kInFirst_s + path_s + kLeant_s,
               settles_at_s = slides_at_s + (approach.slides ? kAlongFor_s : 0);
  const auto ticks = std::lround((settles_at_s + kAtRest_s) * approach.rate_hz);
  const auto last = ticks - std::lround(approach.rate_hz);
  SessionState state;
  TickRecord record;
  Wrench sent;
  NoGoResult result;
  double deepest_mm = 0;
  Eigen::Array3d low = Eigen::Array3d::Constant(std::numeric_limits<double>::infinity()), high = -low;
  for (long n = 0; n < ticks; ++n) {
    const double time_s = dt_s * static_cast<double>(n + 1);
    const DeviceState sensed = mapping.to_world(plant.read(), 0);
    tick(model, parameters, {&sensed, 1}, dt_s, state, {&sent, 1}, record);
    const double advanced_mm =
        std::clamp((time_s - kInFirst_s) * approach.speed_mm_s, 0.0, kStandOff_mm + depth_mm);
    const double slid = approach.slides ? std::clamp((time_s - slides_at_s) / kAlongFor_s, 0.0, 1.0) : 0;
    plant.intend(on_device(kStandOff_mm - advanced_mm, slid * kAlongBorder_mm));
    plant.advance(mapping.to_device(sent), dt_s);
    deepest_mm = std::max(deepest_mm, border_mm - height_mm());
    result.clamped = result.clamped || (record.device[0].flags & kFlagClamped) != 0;
    result.force_N = std::max(result.force_N, sent.force_N.norm());
    if (n < last) continue;
    const Eigen::Array3d tip = plant.true_tip().eigen().array();
    low = low.min(tip);
    high = high.max(tip);
  }
  result.past_mm = deepest_mm - result.force_N / stiffness_N_per_mm;
  result.swing_mm = (high - low).maxCoeff();
  return result;
}

Result<std::vector<Figure>> no_go_figures(const Progress& progress) {
  // stiffer than any hand holds, so that the device's limit applies
  std::vector<std::pair<NoGoKind, std::shared_ptr<const Model>>> walls;
  for (const NoGoKind kind : kNoGoKinds) {
    const auto model = no_go_wall(kind, kNoGoStiffness_N_per_mm.max, thick_wall_labels(), progress);
    if (!model) return model.error();
    walls.emplace_back(kind, *model);
  }
  // grouped by unit, as required by the table
  std::vector<Figure> past, swings;
  for (const PlantDevice& device : known_plant_devices())
    for (const double rate_hz : {250.0, 1000.0, 4000.0}) {
      const double delay_s = 1 / rate_hz;
      progress.report(
          "against no-go regions: " + device.name + " at " + short_number(rate_hz / 1000) + " kHz", 0);
      const auto limit = recommended_stiffness_N_per_mm(device, rate_hz, delay_s, progress);
      if (!limit) return limit.error();
      for (const auto& [kind, model] : walls) {
        for (const PlantHand& hand : known_plant_hands()) {
          if (progress.stopped()) return Progress::interrupted();
          const double stiffness_N_per_mm = std::min(kNoGoStiffness_N_per_mm.max, kFractionOfLimit * *limit);
          const NoGoResult result = run_no_go_approach(
              *model, {device, hand, rate_hz, delay_s, *limit, 100, 1, kind == NoGoKind::kTouchable},
              stiffness_N_per_mm);
          const std::string path = std::string("stability/no-go/") + name_of(kind) + "/" + device.name + "/" +
                                   hand.name + "/" + loop_name(rate_hz, delay_s);
          // no limit if the device's maximum force is insufficient
          const auto limit_mm = result.clamped ? std::optional<double>() : kMaxPast_mm;
          past.push_back({path + "/past", result.past_mm, "mm", 1, limit_mm});
          swings.push_back({path + "/swing", 1e3 * result.swing_mm, "um", 1, 2e6 * device.encoder_step_m});
        }
      }
    }
  past.insert(past.end(), swings.begin(), swings.end());
  return past;
}

}  // namespace palpate
