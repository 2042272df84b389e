#include "verification/stability_buzz.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "palpate/scene.h"
#include "palpate/servo.h"
#include "palpate/session.h"
#include "palpate/stability.h"
#include "palpate/workspace.h"

namespace palpate {
namespace {

constexpr double kDt_s = 1e-3;
constexpr int kSecond = 1000;  // ticks
constexpr int kDelay = 1;      // ticks
constexpr double kGap_mm = 3, kPlate_mm = 15, kSpacing_mm = 0.6;
constexpr double kHold_N = 1, kInside_mm = 5;
// in the middle between the plates no method pushes to either side; what the hand begins before the wall with
constexpr double kOffMiddle_mm = 0.2, kBeforeWall_mm = 3;
constexpr double kLowest_Hz = 20, kUserLimit_N = 3;
// less power is rounding
constexpr double kLeastPower_mm2 = 1e-12;

// the power of each whole frequency up to half the ticks, of one axis, without its mean; a Hann window keeps
// what drifts out of the higher frequencies
std::vector<double> power_mm2(std::span<const Eigen::Vector3d> tip_mm, int axis) {
  const int n = static_cast<int>(tip_mm.size());
  const double turn = 2 * std::numbers::pi / n;
  double mean = 0;
  for (const Eigen::Vector3d& tip : tip_mm) mean += tip[axis] / n;
  std::vector<std::complex<double>> wheel(n);
  for (int i = 0; i < n; ++i) wheel[i] = std::polar(1.0, -turn * i);

  std::vector<double> power(n / 2 + 1, 0.0);
  for (int k = 1; k <= n / 2; ++k) {
    std::complex<double> sum = 0;
    for (int i = 0; i < n; ++i) {
      const double hann = 0.5 * (1 - wheel[i].real());
      sum += hann * (tip_mm[i][axis] - mean) * wheel[static_cast<long>(k) * i % n];
    }
    // both signs of the frequency; the window takes 5/8 of the power
    const double sides = 2 * k == n ? 1 : 2;
    power[k] = sides * std::norm(sum) / (static_cast<double>(n) * n) * (8.0 / 3);
  }
  return power;
}

// free space before the plate's outer face, as far as where the method pushes with kHold_N
double held_depth_x_mm(const Model& model, ForceMethod method) {
  const double face_mm = kGap_mm / 2 + kPlate_mm;
  constexpr double kStep_mm = 0.01;
  double x_mm = face_mm + kInside_mm;
  while (x_mm > face_mm - kInside_mm) {
    const ForceField& field = model.force_field(method);
    const Vector<Patient> force =
        normal_force(field.sample(Point<Patient>(x_mm, 0, 0)), field.full_force_N());
    if (force.x() >= kHold_N) break;
    x_mm -= kStep_mm;
  }
  return x_mm;
}

struct NamedPlace {
  const char* name;
  HeldPlace place;
};

std::vector<NamedPlace> places(const Model& model, ForceMethod method, const PlantHand& hand) {
  const double face_mm = kGap_mm / 2 + kPlate_mm;
  const double spring_mm = kHold_N / (hand.stiffness_N_per_m * 1e-3);
  const Point<Patient> gap(kOffMiddle_mm, 0, 0), before(face_mm + kBeforeWall_mm, 0, 0),
      pressed(held_depth_x_mm(model, method) - spring_mm, 0, 0), inside(face_mm - kInside_mm, 0, 0);
  return {{"gap", {gap, gap}}, {"wall", {before, pressed}}, {"inside", {inside, inside}}};
}

}  // namespace

Buzz buzz_of(std::span<const Eigen::Vector3d> tip_mm, std::span<const Eigen::Vector3d> force_N) {
  PALPATE_CHECK(tip_mm.size() >= 2 && force_N.size() + 1 == tip_mm.size());
  Buzz buzz;
  // positions at the beginning of each tick make whole frequencies of a second
  const auto ticks = tip_mm.first(force_N.size());
  std::vector<double> power(ticks.size() / 2 + 1, 0.0);
  for (int axis = 0; axis < 3; ++axis) {
    const auto by_axis = [axis](const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
      return a[axis] < b[axis];
    };
    const auto [low, high] = std::minmax_element(tip_mm.begin(), tip_mm.end(), by_axis);
    buzz.peak_to_peak_um = std::max(buzz.peak_to_peak_um, 1e3 * ((*high)[axis] - (*low)[axis]));
    const auto of_axis = power_mm2(ticks, axis);
    for (std::size_t k = 0; k < power.size(); ++k) power[k] += of_axis[k];
  }

  const double step_Hz = 1 / (kDt_s * static_cast<double>(ticks.size()));
  double above = 0, most = kLeastPower_mm2;
  for (std::size_t k = 1; k < power.size(); ++k) {
    const double frequency_Hz = static_cast<double>(k) * step_Hz;
    if (frequency_Hz >= kLowest_Hz) above += power[k];
    if (power[k] > most) {
      most = power[k];
      buzz.dominant_Hz = frequency_Hz;
    }
  }
  buzz.rms_um = 1e3 * std::sqrt(above);
  for (std::size_t i = 0; i < force_N.size(); ++i) {
    buzz.energy_mJ += force_N[i].dot(tip_mm[i + 1] - tip_mm[i]);
    buzz.force_N += force_N[i].norm() / static_cast<double>(force_N.size());
  }
  return buzz;
}

Result<std::shared_ptr<const Model>> two_plates(double stiffness_N_per_mm, const Progress& progress) {
  // faces lie between voxels; the plates go on as far as no method looks for their ends
  GridGeometry grid;
  grid.dims = {79, 41, 41};
  grid.spacing_mm = Eigen::Vector3d::Constant(kSpacing_mm);
  grid.origin = Point<Patient>(-39 * kSpacing_mm, -20 * kSpacing_mm, -20 * kSpacing_mm);
  LabelMap labels;
  labels.layers.emplace_back(grid);
  labels.segments = {{1, "plates", {}, 0, 1}};
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) {
        const double x_mm = std::abs(grid.origin.x() + i * kSpacing_mm);
        const bool bone = x_mm > kGap_mm / 2 && x_mm < kGap_mm / 2 + kPlate_mm;
        labels.layers[0].at(i, j, k) = bone ? LabelId{1} : LabelId{0};
      }

  Scene scene;
  scene.title = "two plates";
  TissueSettings bone;
  bone.name = "bone";
  bone.labels = {LabelReference{1}};
  bone.label_lines = {0};
  bone.stiffness_N_per_mm = stiffness_N_per_mm;
  scene.tissues = {bone};
  scene.preparation.sigma_mm = 1.5;
  auto model = build_model(scene, &labels, nullptr, progress);
  if (!model) return model;
  std::vector<ForceMethod> methods;
  for (const ForceMethodInfo& info : kForceMethods) methods.push_back(info.method);
  return ready_for(*model, methods, progress);
}

Buzz hold_still(const Model& model, ForceMethod method, const PlantDevice& device, const PlantHand& hand,
                const HeldPlace& place) {
  SimulatedDevice plant(device, hand, kDelay * kDt_s);
  const WorkspaceSettings workspace;
  WorkspaceMapping mapping(plant.info(), workspace);
  Parameters parameters;
  parameters.method = method;
  parameters.max_force_N = std::min(device.continuous_force_N, kUserLimit_N);
  parameters.device[0] = device_parameters(plant.info(), workspace);
  const auto on_device = [&](double way) {
    const Point<Patient> wanted = place.from + way * (place.intended - place.from);
    return mapping.to_device(model.X_WorldPatient * wanted);
  };
  plant.reset(on_device(0));

  SessionState state;
  TickRecord record;
  Wrench sent;
  std::vector<Eigen::Vector3d> tip_mm{plant.true_tip().eigen()}, sent_N;
  for (int n = 0; n < 3 * kSecond; ++n) {
    const DeviceState sensed = mapping.to_world(plant.read(), 0);
    tick(model, parameters, {&sensed, 1}, kDt_s, state, {&sent, 1}, record);
    const DeviceCommand command = mapping.to_device(sent);
    plant.intend(on_device(std::min(1.0, static_cast<double>(n + 1) / kSecond)));
    plant.advance(command, kDt_s);
    tip_mm.push_back(plant.true_tip().eigen());
    sent_N.push_back(command.force_N.eigen());
  }
  return buzz_of(std::span(tip_mm).last(kSecond + 1),
                 std::span(sent_N).subspan(2 * kSecond - kDelay, kSecond));
}

Result<std::vector<Figure>> buzz_figures(const Progress& progress) {
  const PlantDevice device = *find_plant_device("premium-1.5");
  const auto stiffness = recommended_stiffness_N_per_mm(device, 1 / kDt_s, kDelay * kDt_s, progress);
  if (!stiffness) return stiffness.error();
  const auto model = two_plates(*stiffness, progress);
  if (!model) return model.error();

  // one unit after the other, as tables want them
  std::vector<Figure> lengths, frequencies, forces, energies;
  const auto add = [](std::vector<Figure>& figures, const std::string& name, double value, const char* unit) {
    figures.push_back({name, value, unit, kSecond, {}});
  };
  for (const ForceMethodInfo& info : kForceMethods) {
    progress.report("holding still: " + std::string(info.name),
                    static_cast<double>(index_of(info.method)) / kForceMethods.size());
    for (const char* grip : {"light-grip", "firm-grip"}) {
      if (progress.stopped()) return Progress::interrupted();
      const PlantHand hand = *find_plant_hand(grip);
      for (const NamedPlace& at : places(**model, info.method, hand)) {
        const Buzz buzz = hold_still(**model, info.method, device, hand, at.place);
        const std::string path = "stability/buzz/" + std::string(info.name) + "/" + at.name + "/" + grip;
        add(lengths, path + "/peak-to-peak", buzz.peak_to_peak_um, "um");
        add(lengths, path + "/rms", buzz.rms_um, "um");
        add(frequencies, path + "/dominant", buzz.dominant_Hz, "Hz");
        add(forces, path + "/force", buzz.force_N, "N");
        add(energies, path + "/energy-out", buzz.energy_mJ, "mJ");
      }
    }
  }
  std::vector<Figure> figures;
  for (const auto* of_unit : {&lengths, &frequencies, &forces, &energies})
    figures.insert(figures.end(), of_unit->begin(), of_unit->end());
  return figures;
}

}  // namespace palpate
