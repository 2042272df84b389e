#include "verification/stability_buzz.h"

#include <cmath>

#include "palpate/direct/direct_methods.h"
#include "palpate/loading/loading.h"
#include "palpate/stability/stability.h"

namespace palpate {
namespace {

constexpr double kBuzzRate_hz = 1000, kDelay_s = 1e-3;
constexpr double kGap_mm = 3, kPlate_mm = 15, kSpacing_mm = 0.6;
constexpr double kHold_N = 1, kInside_mm = 5;
// offset from the middle of the gap, where the methods push to neither side, and starting distance from the
// wall
constexpr double kOffMiddle_mm = 0.2, kBeforeWall_mm = 3;

// x position relative to the plate's outer face at which the method generates kHold_N
double hold_depth_x_mm(const Model& model, ForceMethod method) {
  const double face_mm = kGap_mm / 2 + kPlate_mm;
  if (method == ForceMethod::kProxy) return face_mm - kHold_N / model.max_stiffness_N_per_mm();
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

/// Figures grouped by unit.
class BuzzFigures {
 public:
  void add(const std::string& path, const Buzz& buzz) {
    const auto figure = [&](const char* what, double value, const char* unit) {
      return Figure{path + "/" + what, value, unit, static_cast<std::uint64_t>(kBuzzRate_hz), {}};
    };
    lengths_.push_back(figure("peak-to-peak", buzz.peak_to_peak_um, "um"));
    lengths_.push_back(figure("rms", buzz.rms_um, "um"));
    frequencies_.push_back(figure("dominant", buzz.dominant_Hz, "Hz"));
    forces_.push_back(figure("force", buzz.force_N, "N"));
    energies_.push_back(figure("energy-out", buzz.energy_mJ, "mJ"));
  }
  std::vector<Figure> all() const {
    std::vector<Figure> figures;
    for (const auto* of_unit : {&lengths_, &frequencies_, &forces_, &energies_})
      figures.insert(figures.end(), of_unit->begin(), of_unit->end());
    return figures;
  }

 private:
  std::vector<Figure> lengths_, frequencies_, forces_, energies_;
};

}  // namespace

std::vector<ForceMethodInfo> methods_on(PreparationMethod preparation) {
  std::vector<ForceMethodInfo> methods;
  for (const ForceMethodInfo& info : kForceMethods) {
    const bool reads_field = info.method == ForceMethod::kTrilinear || info.method == ForceMethod::kSpline ||
                             info.method == ForceMethod::kStoredNormals;
    if (reads_field || preparation == PreparationMethod::kUnionGaussian) methods.push_back(info);
  }
  return methods;
}

Result<std::shared_ptr<const Model>> two_plates(double stiffness_N_per_mm, PreparationMethod preparation,
                                                const Progress& progress) {
  // faces are between voxels; the plates extend beyond the range of every method
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
  scene.preparation.method = preparation;
  scene.preparation.sigma_mm = 1.5;
  auto model = build_model(scene, &labels, nullptr, progress);
  if (!model) return model;
  std::vector<ForceMethod> methods;
  for (const ForceMethodInfo& info : methods_on(preparation)) methods.push_back(info.method);
  return prepared_with_cache(*model, methods, progress);
}

std::vector<HoldPosition> hold_positions(const Model& model, ForceMethod method, const PlantHand& hand) {
  const double face_mm = kGap_mm / 2 + kPlate_mm;
  const double spring_mm = kHold_N / (hand.stiffness_N_per_m * 1e-3);
  const Point<Patient> gap(kOffMiddle_mm, 0, 0), before(face_mm + kBeforeWall_mm, 0, 0),
      pressed(hold_depth_x_mm(model, method) - spring_mm, 0, 0), inside(face_mm - kInside_mm, 0, 0);
  return {{"gap", gap, gap}, {"wall", before, pressed}, {"inside", inside, inside}};
}

namespace {

// every method with one preparation, at all positions with both grips
Result<void> add_holds(const PlantDevice& device, PreparationMethod preparation, const Progress& progress,
                       BuzzFigures& figures) {
  const auto stiffness = recommended_stiffness_N_per_mm(device, kBuzzRate_hz, kDelay_s, progress);
  if (!stiffness) return stiffness.error();
  const auto model = two_plates(*stiffness, preparation, progress);
  if (!model) return model.error();
  for (const ForceMethodInfo& info : methods_on(preparation)) {
    std::string method(info.name);
    if (preparation == PreparationMethod::kInwardRamp) method += "-on-ramps";
    progress.report("holding still: " + method + ", " + device.name,
                    static_cast<double>(index_of(info.method)) / kForceMethods.size());
    for (const char* grip : {"light-grip", "firm-grip"}) {
      const PlantHand hand = *find_plant_hand(grip);
      for (const HoldPosition& hold_position : hold_positions(**model, info.method, hand)) {
        const auto result = hold_tip(
            **model,
            {device, hand, info.method, kBuzzRate_hz, kDelay_s, 1, hold_position.from, hold_position.at},
            progress);
        if (!result) return result.error();
        figures.add("stability/buzz/" + device.name + "/" + method + "/" + hold_position.name + "/" + grip,
                    result->buzz);
      }
    }
  }
  return {};
}

}  // namespace

Result<std::vector<Figure>> buzz_figures(const Progress& progress) {
  // grouped by unit, as required by the table
  BuzzFigures figures;
  for (const char* name : {"premium-1.5", "touch"})
    for (const PreparationMethod preparation :
         {PreparationMethod::kUnionGaussian, PreparationMethod::kInwardRamp}) {
      const auto added = add_holds(*find_plant_device(name), preparation, progress, figures);
      if (!added) return added.error();
    }
  return figures.all();
}

}  // namespace palpate
