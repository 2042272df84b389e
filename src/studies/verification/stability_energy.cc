#include "verification/stability_energy.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <numeric>
#include <optional>
#include <random>

#include "palpate/device/workspace.h"
#include "palpate/model/changed_model.h"
#include "palpate/model/make_model.h"
#include "palpate/servo/servo.h"
#include "palpate/stability/stability.h"
#include "palpate/tissue/removal.h"
#include "palpate/tissue/soft_tissue_solver.h"
#include "verification/figure_names.h"
#include "verification/stability_wall.h"

namespace palpate {
namespace {

constexpr double kEnergyRate_hz = 1000;
constexpr double kWallSpacing_mm = 0.6, kUserLimit_N = 3;
// next target of the hand: range of heights above the surface, and maximum lateral angle from the previous
// one
constexpr double kDeepest_mm = -6, kHighest_mm = 5, kMaxLateral_rad = 0.6;
constexpr double kMinStroke_s = 0.12, kMaxStroke_s = 0.6;
// the hand waits until the force is ramped in
constexpr double kBegin_s = 0.6;
constexpr double kPressed_N = 1, kSwingMean_s = 0.04;
// interval at which tissue swept by a burr is removed
constexpr double kCutEvery_s = 0.02;
// maximum distance from the centre of the plane
constexpr double kMaxOnPlane_mm = 6;
// the object rotates to another random orientation ten times a second
constexpr double kTurning_s = 0.1;
constexpr double kMaxObjectTurn_rad = 0.03;
// fraction of the energy generated without the controller
constexpr double kMaxGenerated_percent = 5;
// random tick lengths, duration of that run, and the stiffest tissue of the presets
constexpr double kJitter = 0.5, kUnpunctual_s = 20, kTissue_N_per_mm = 1.5;

double between(std::mt19937_64& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}

Eigen::Vector3d any_direction(std::mt19937_64& random) {
  Eigen::Vector3d direction;
  do {
    for (int axis = 0; axis < 3; ++axis) direction[axis] = between(random, -1, 1);
  } while (direction.norm() > 1 || direction.norm() < 0.1);
  return direction.normalized();
}

// target of a hand that presses on the plane, which it approaches at constant speed
class PressingHand {
 public:
  explicit PressingHand(double depth_mm) : depth_mm_(depth_mm) {}
  Point<Patient> start() const { return Point<Patient>(kHighest_mm, 0, 0); }
  // presses deeper at the same speed
  void press_deeper(double by_mm) {
    from_mm_ = -depth_mm_;
    depth_mm_ += by_mm;
    begin_s_ = elapsed_s_;
  }
  Point<Patient> next(double dt_s) {
    constexpr double kDown_mm_s = 20;
    elapsed_s_ += dt_s;
    const double down_mm = kDown_mm_s * std::max(0.0, elapsed_s_ - begin_s_);
    return Point<Patient>(std::max(-depth_mm_, from_mm_ - down_mm), 0, 0);
  }

 private:
  double depth_mm_;
  double elapsed_s_ = 0, begin_s_ = kBegin_s, from_mm_ = kHighest_mm;
};

// random targets around the ball or on the plane, with a bell-shaped speed profile between them
class RandomHand {
 public:
  RandomHand(std::uint64_t seed, bool flat)
      : random_(seed),
        flat_(flat),
        from_(flat ? kHighest_mm : kBallRadius_mm + kHighest_mm, 0, 0),
        to_(from_) {}
  Point<Patient> start() const { return from_; }
  Point<Patient> next(double dt_s) {
    elapsed_s_ += dt_s;
    if (elapsed_s_ >= time_s_) choose();
    const double u = elapsed_s_ / time_s_;
    return from_ + (to_ - from_) * (u * u * u * (10 - 15 * u + 6 * u * u));
  }

 private:
  void choose() {
    elapsed_s_ = 0;
    from_ = to_;
    time_s_ = between(random_, kMinStroke_s, kMaxStroke_s);
    if (flat_) {
      const double x = between(random_, kDeepest_mm, kHighest_mm);
      const double y = between(random_, -kMaxOnPlane_mm, kMaxOnPlane_mm);
      to_ = Point<Patient>(x, y, between(random_, -kMaxOnPlane_mm, kMaxOnPlane_mm));
      return;
    }
    const Eigen::AngleAxisd lateral(between(random_, 0, kMaxLateral_rad), any_direction(random_));
    direction_ = lateral * direction_;
    to_ = Point<Patient>(direction_ * (kBallRadius_mm + between(random_, kDeepest_mm, kHighest_mm)));
  }

  std::mt19937_64 random_;
  const bool flat_;
  Eigen::Vector3d direction_ = Eigen::Vector3d::UnitX();
  Point<Patient> from_, to_;
  double time_s_ = kBegin_s, elapsed_s_ = 0;
};

// mean over the second half of the run
double second_half(const std::vector<double>& values) {
  const auto half = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  return std::accumulate(half, values.end(), 0.0) / static_cast<double>(values.end() - half);
}

// peak-to-peak deviation from the running mean, from the middle of the run on
double swing_of(const std::vector<double>& positions_mm, double rate_hz) {
  const auto half = static_cast<std::ptrdiff_t>(std::lround(0.5 * kSwingMean_s * rate_hz));
  const auto count = static_cast<std::ptrdiff_t>(positions_mm.size());
  double low_mm = 0, high_mm = 0;
  for (std::ptrdiff_t n = std::max(count / 2, half); n + half < count; ++n) {
    const auto middle = positions_mm.begin() + n;
    const double mean_mm =
        std::accumulate(middle - half, middle + half + 1, 0.0) / static_cast<double>(2 * half + 1);
    low_mm = std::min(low_mm, *middle - mean_mm);
    high_mm = std::max(high_mm, *middle - mean_mm);
  }
  return high_mm - low_mm;
}

Transform<Patient, World> pose_of(const Model& model, const Eigen::Quaterniond& rotation) {
  return rotated_object_pose(model.X_WorldPatient, rotation).inverse();
}

Parameters exploration_parameters(const Exploration& exploration, bool is_deformable, const DeviceInfo& info,
                                  const WorkspaceSettings& workspace) {
  Parameters parameters;
  parameters.method = exploration.method;
  parameters.friction = parameters.viscosity = false;
  parameters.passivity = exploration.controller;
  parameters.max_force_N = std::min(exploration.device.continuous_force_N, kUserLimit_N);
  parameters.device[0] = device_parameters(info, workspace);
  parameters.device[0].delay_s = exploration.reported_s.value_or(exploration.delay_s);
  if (is_deformable) parameters.device[0].max_stiffness_N_per_mm = exploration.stiffness_N_per_mm;
  parameters.motor = exploration.cuts;
  parameters.vibration = exploration.vibrates;
  return parameters;
}

}  // namespace

Result<std::shared_ptr<const Model>> exploration_ball(const Progress& progress) {
  GridGeometry grid;
  grid.dims = {65, 65, 65};
  grid.spacing_mm = Eigen::Vector3d::Constant(kWallSpacing_mm);
  grid.origin = Point<Patient>(-32 * kWallSpacing_mm, -32 * kWallSpacing_mm, -32 * kWallSpacing_mm);
  LabelMap labels;
  labels.layers.emplace_back(grid);
  labels.segments = {{1, "ball", {}, 0, 1}};
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i)
        labels.layers[0].at(i, j, k) =
            (X_PatientVoxel * Point<Voxel>(i, j, k)).eigen().norm() < kBallRadius_mm ? 1 : 0;

  return one_bone(labels, {ForceMethod::kTrilinear, ForceMethod::kProxy}, progress);
}

Result<std::shared_ptr<const Model>> soft_ball(double youngs_modulus_kPa, TissueLaw law,
                                               const Progress& progress, const Relaxation& relaxation) {
  constexpr double kSpacing_mm = 1, kCore_mm = 5;
  GridGeometry grid;
  grid.dims = {41, 41, 41};
  grid.spacing_mm = Eigen::Vector3d::Constant(kSpacing_mm);
  grid.origin = Point<Patient>(-20 * kSpacing_mm, -20 * kSpacing_mm, -20 * kSpacing_mm);
  Volume<LabelId> labels(grid);
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) {
        const double r = (X_PatientVoxel * Point<Voxel>(i, j, k)).eigen().norm();
        labels.at(i, j, k) = static_cast<LabelId>(r < kCore_mm ? 2 : r < kBallRadius_mm ? 1 : 0);
      }
  ModelParts parts;
  parts.labels = label_bricks(labels);
  parts.segments = {{1, "ball", {}, 0, 1}, {2, "core", {}, 0, 2}};
  Tissue soft, bone;
  soft.name = "soft tissue";
  soft.stiffness_N_per_mm = 0.3;
  soft.elastic = ElasticConstants{youngs_modulus_kPa, 0.45};
  soft.relaxation = relaxation;
  bone.name = "bone";
  bone.stiffness_N_per_mm = 1.5;
  parts.tissues = {soft, bone};
  parts.tissue_of_label = {-1, 0, 1};
  parts.tissue_law = law;
  Tool tool;
  tool.radius_mm = 3;
  parts.tools = {tool};
  auto made = make_model(std::move(parts));
  if (!made) return made.error();
  const ForceMethod proxy = ForceMethod::kProxy;
  return prepared_for(*made, {&proxy, 1}, {}, progress);
}

EnergyBalance simulate_exploration(const Model& object, const Exploration& exploration) {
  PALPATE_CHECK(exploration.jitter == 0 || exploration.delay_s == 0);
  SimulatedDevice plant(exploration.device, exploration.hand, exploration.delay_s);
  const bool is_deformable = is_elastic(object.tissue_law);
  WorkspaceSettings workspace;
  // the gain scales an object of 1 N/mm; deformable tissue has its own stiffness
  workspace.force_gain = is_deformable ? 1 : exploration.stiffness_N_per_mm;
  WorkspaceMapping mapping(plant.info(), workspace);
  Parameters parameters = exploration_parameters(exploration, is_deformable, plant.info(), workspace);
  RandomHand random_hand(exploration.seed, exploration.flat);
  PressingHand pressing_hand(
      kPressed_N * (1 / exploration.stiffness_N_per_mm + 1e3 / exploration.hand.stiffness_N_per_m) -
      object.tools[0].radius_mm);
  std::mt19937_64 unpunctual(exploration.seed + 2);
  std::mt19937_64 random(exploration.seed + 1);
  const auto on_device = [&](const Point<Patient>& at) {
    return mapping.to_device(object.X_WorldPatient * at);
  };
  plant.reset(on_device(exploration.presses ? pressing_hand.start() : random_hand.start()));

  // commands act after a delay of this number of ticks
  const int delay = static_cast<int>(std::lround(exploration.delay_s * exploration.rate_hz));
  std::deque<Vector<World>> line(static_cast<std::size_t>(delay));
  SessionState state;
  TickRecord record;
  Wrench sent;
  EnergyBalance result;
  std::shared_ptr<const Model> model = std::make_shared<const Model>(object);
  VirtualClockSoftTissueSolver virtual_solver(exploration.rate_hz);
  const long ticks_per_cut = std::lround(kCutEvery_s * exploration.rate_hz);
  std::vector<double> positions_mm, forces_N;  // normal to the plane
  double energy_mJ = 0;
  long touching = 0, damped = 0;
  bool touched = false;
  Transform<Patient, World> X_PatientWorld = pose_of(object, state.rotation_applied);
  Vector<World> acted;
  const long ticks = std::lround(exploration.time_s * exploration.rate_hz);
  const long ticks_to_stop = std::lround(exploration.motor_stops_s * exploration.rate_hz);
  const long ticks_per_rotation = std::lround(kTurning_s * exploration.rate_hz);
  double dt_s = 1 / exploration.rate_hz;
  for (long n = 0; n < ticks; ++n) {
    if (exploration.turning && n % ticks_per_rotation == 0)
      parameters.rotation_target = Eigen::Quaterniond(Eigen::AngleAxisd(
                                       between(random, 0, kMaxObjectTurn_rad), any_direction(random))) *
                                   parameters.rotation_target;
    if (n == ticks_to_stop) {
      parameters.motor = false;
      pressing_hand.press_deeper(object.tools[0].radius_mm - state.device[0].proxy.position.x());
    }
    if (exploration.cuts && n % ticks_per_cut == 0)
      if (const auto cuts = finished_cuts(state.device[0].burr, 0); !cuts.empty())
        model = carved_by(*model, cuts)->applied_to(*model);
    if (is_deformable && virtual_solver.advance(*model, n > 0 ? &record : nullptr))
      parameters.compliance = virtual_solver.frame();
    const DeviceState sensed = mapping.to_world(plant.read(), 0);
    tick(*model, parameters, {&sensed, 1}, dt_s, state, {&sent, 1}, record);

    // the object rotates at the end of the tick, under the force that acts then
    const Point<World> tip_in_world(plant.true_tip().eigen());
    const Transform<Patient, World> X_PatientWorld_turned = pose_of(object, state.rotation_applied);
    const Point<Patient> now = X_PatientWorld_turned * tip_in_world;
    energy_mJ -= (X_PatientWorld * acted).dot(now - X_PatientWorld * tip_in_world);
    X_PatientWorld = X_PatientWorld_turned;
    if (exploration.presses) positions_mm.push_back(now.x());
    result.min_mJ = std::min(result.min_mJ, energy_mJ);
    const double depth_mm = exploration.flat ? -now.x() : kBallRadius_mm - now.eigen().norm();
    result.deepest_mm = std::max(result.deepest_mm, depth_mm);

    line.push_back(sent.force_N);
    acted = line.front();
    line.pop_front();
    if (exploration.jitter > 0)
      dt_s = (1 + between(unpunctual, -exploration.jitter, exploration.jitter)) / exploration.rate_hz;
    plant.intend(on_device(exploration.presses ? pressing_hand.next(dt_s) : random_hand.next(dt_s)));
    plant.advance(mapping.to_device(sent), dt_s);
    energy_mJ -= plant.work_mJ();

    const bool touches = acted.norm() > 0;
    const bool controlled = (record.device[0].flags & kFlagPassivity) != 0;
    // the controller may reduce a force to zero
    touching += touches || controlled;
    damped += controlled;
    result.contacts += touches && !touched;
    touched = touches;
    result.largest_force_N = std::max(result.largest_force_N, acted.norm());
    if (exploration.presses) forces_N.push_back(acted.norm());
  }
  result.last_mJ = energy_mJ;
  if (exploration.presses) {
    result.swing_mm = swing_of(positions_mm, exploration.rate_hz);
    result.pressed_N = second_half(forces_N);
  }
  result.damped = touching > 0 ? static_cast<double>(damped) / static_cast<double>(touching) : 0;
  return result;
}

Result<std::vector<Figure>> energy_figures(const Progress& progress) {
  const auto ball = exploration_ball(progress), wall = flat_wall(progress);
  if (!ball) return ball.error();
  if (!wall) return wall.error();

  // grouped by unit, as required by the table
  std::vector<Figure> energies, parts, depths;
  const auto add = [&](const Exploration& exploration, const std::string& path, bool bound, bool limited) {
    Exploration free = exploration;
    free.controller = false;
    const Model& model = exploration.flat ? **wall : **ball;
    const EnergyBalance with = simulate_exploration(model, exploration),
                        without = simulate_exploration(model, free);
    const auto n = static_cast<std::uint64_t>(std::lround(exploration.time_s * exploration.rate_hz));
    // energy within one encoder step, which cannot be observed
    const double hidden_mJ = with.largest_force_N * 2 * exploration.device.encoder_step_m * 1e3;
    const auto limit = [](bool holds, double largest) {
      return holds ? std::optional(largest) : std::nullopt;
    };
    energies.push_back({path + "/given-out/without", 0 - without.min_mJ, "mJ", n, {}});
    energies.push_back({path + "/given-out/with", 0 - with.min_mJ, "mJ", n, limit(bound, hidden_mJ)});
    energies.push_back({path + "/given-out/hidden", hidden_mJ, "mJ", n, {}});
    const double part = with.min_mJ < 0 ? 100 * with.min_mJ / without.min_mJ : 0;
    parts.push_back({path + "/part-given-out", part, "percent", n, limit(limited, kMaxGenerated_percent)});
    parts.push_back({path + "/damped-of-contact", 100 * with.damped, "percent", n, {}});
    depths.push_back({path + "/deepest/without", without.deepest_mm, "mm", n, {}});
    depths.push_back({path + "/deepest/with", with.deepest_mm, "mm", n, {}});
  };
  for (const char* device : {"premium-1.5", "touch"})
    for (const double delay_s : {0.0, 1e-3, 3e-3}) {
      progress.report(std::string("exploring: ") + device, delay_s / 4e-3);
      Exploration exploration{*find_plant_device(device), {}};
      const auto stiffness =
          recommended_stiffness_N_per_mm(exploration.device, kEnergyRate_hz, delay_s, progress);
      if (!stiffness) return stiffness.error();
      exploration.stiffness_N_per_mm = *stiffness;
      exploration.delay_s = delay_s;
      for (const char* grip : {"light-grip", "firm-grip"})
        for (const ForceMethod method : {ForceMethod::kProxy, ForceMethod::kTrilinear}) {
          if (progress.stopped()) return Progress::interrupted();
          exploration.hand = *find_plant_hand(grip);
          exploration.method = method;
          const std::string path = "stability/energy/" + std::string(name_of(method)) + "/" + device + "/" +
                                   grip + "/" + loop_name(kEnergyRate_hz, delay_s);
          add(exploration, path, delay_s == 0, delay_s == 0);
          if (method != ForceMethod::kProxy) continue;
          Exploration other = exploration;
          if (delay_s > 0) {
            other.reported_s = 0;
            add(other, path + "/not-told", false, false);
            continue;
          }
          other.turning = true;
          add(other, path + "/turning", true, true);
          other = exploration;
          other.stiffness_N_per_mm = 2 * *stiffness;
          add(other, path + "/twice-as-stiff", false, false);
          for (const bool flat : {false, true}) {
            other = exploration;
            other.flat = flat;
            other.jitter = kJitter;
            other.time_s = kUnpunctual_s;
            add(other, path + (flat ? "/unpunctual/flat" : "/unpunctual"), true, false);
          }
        }
    }
  // at tissue stiffness, where the device holds it; a shorter run at higher rates
  for (const char* device : {"premium-1.5", "touch"})
    for (const double rate_hz : {250.0, 10000.0}) {
      progress.report(std::string("exploring at other rates: ") + device, rate_hz / 20000);
      const auto stiffness = recommended_stiffness_N_per_mm(*find_plant_device(device), rate_hz, 0, progress);
      if (!stiffness) return stiffness.error();
      for (const char* grip : {"light-grip", "firm-grip"})
        for (const bool flat : {false, true}) {
          if (progress.stopped()) return Progress::interrupted();
          Exploration other{*find_plant_device(device), *find_plant_hand(grip)};
          other.stiffness_N_per_mm = std::min(*stiffness, kTissue_N_per_mm);
          other.rate_hz = rate_hz;
          other.jitter = kJitter;
          other.time_s = rate_hz > kEnergyRate_hz ? kUnpunctual_s / 4 : kUnpunctual_s;
          other.flat = flat;
          add(other,
              std::string("stability/energy/proxy/") + device + "/" + grip + "/" + loop_name(rate_hz, 0) +
                  (flat ? "/unpunctual/flat" : "/unpunctual"),
              true, false);
        }
    }
  energies.insert(energies.end(), parts.begin(), parts.end());
  energies.insert(energies.end(), depths.begin(), depths.end());
  return energies;
}

}  // namespace palpate
