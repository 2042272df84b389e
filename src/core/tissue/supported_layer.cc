#include "tissue/supported_layer.h"

#include <array>
#include <cmath>

#include "palpate/tissue/carving.h"

namespace palpate {
namespace {

/// Largest ratio of Young's moduli in one layer.
constexpr double kSameModulus = 1.25;
/// Step along a ray, and distance above the surface at which it starts, in voxels.
constexpr double kStepVoxels = 0.125, kAboveVoxels = 1.5;
constexpr double kDiagonal = 0.70710678118654752;
constexpr std::array<std::array<double, 2>, 9> kRays{{{0, 0},
                                                      {1, 0},
                                                      {kDiagonal, kDiagonal},
                                                      {0, 1},
                                                      {-kDiagonal, kDiagonal},
                                                      {-1, 0},
                                                      {-kDiagonal, -kDiagonal},
                                                      {0, -1},
                                                      {kDiagonal, -kDiagonal}}};

/// A straight ray through the labels.
class LabelRay {
 public:
  LabelRay(const CarvedLabels& labels, std::span<const ElasticMaterial> by_label, const Point<Patient>& start,
           const Vector<Patient>& step_mm)
      : labels_(labels),
        by_label_(by_label),
        first_((labels.original->geometry().X_PatientVoxel().inverse() * start).eigen()),
        step_(labels.original->geometry().X_PatientVoxel().inverse().linear() * step_mm.eigen()) {}

  struct Sample {
    LabelId label = 0;
    ElasticMaterial material;
    double remaining_fraction = 1;  ///< Fraction of the voxel that has not been removed
  };
  /// Voxel in the middle of a step; air outside the volume.
  Sample at(int step) const {
    const Eigen::Vector3d position = first_ + (step + 0.5) * step_;
    std::array<int, 3> voxel;
    for (int axis = 0; axis < 3; ++axis)
      voxel[static_cast<std::size_t>(axis)] = static_cast<int>(std::floor(position[axis] + 0.5));
    Sample sample;
    sample.label = labels_.original->anywhere(voxel[0], voxel[1], voxel[2]);
    if (sample.label < by_label_.size()) sample.material = by_label_[sample.label];
    if (labels_.removed_fraction != nullptr)
      sample.remaining_fraction =
          1 - labels_.removed_fraction->anywhere(voxel[0], voxel[1], voxel[2]) / kFullyRemoved;
    return sample;
  }

 private:
  const CarvedLabels& labels_;
  std::span<const ElasticMaterial> by_label_;
  Eigen::Vector3d first_, step_;
};

bool same_material(const ElasticMaterial& one, const ElasticMaterial& other) {
  return one.youngs_modulus_kPa <= kSameModulus * other.youngs_modulus_kPa &&
         other.youngs_modulus_kPa <= kSameModulus * one.youngs_modulus_kPa;
}

}  // namespace

std::optional<SupportedLayer> supported_layer(const CarvedLabels& labels,
                                              std::span<const ElasticMaterial> by_label,
                                              const Point<Patient>& at, const Vector<Patient>& outward,
                                              double circle_mm, double max_mm) {
  const GridGeometry& grid = labels.original->geometry();
  const double step_mm = kStepVoxels * grid.min_spacing_mm(),
               above_mm = kAboveVoxels * grid.spacing_mm.maxCoeff();
  const Eigen::Vector3d across = outward.eigen().unitOrthogonal(), other = outward.eigen().cross(across);
  SupportedLayer layer;
  bool known = false;
  for (const auto& [x, y] : kRays) {
    const Point<Patient> start =
        at + outward * above_mm + Vector<Patient>(circle_mm * (x * across + y * other));
    const LabelRay ray(labels, by_label, start, outward * -step_mm);
    double thick_mm = 0;
    bool on_base = false;
    const int steps = static_cast<int>(std::ceil((max_mm + 2 * above_mm) / step_mm));
    for (int n = 0; n < steps && !on_base; ++n) {
      const auto [label, material, remaining_fraction] = ray.at(n);
      if (material.matter == Matter::kRigid && remaining_fraction > 0) {
        on_base = true;
      } else if (material.matter == Matter::kSoft && remaining_fraction > 0) {
        if (!known) {
          layer.label = label;
          layer.material = material;
          known = true;
        }
        if (!same_material(material, layer.material)) return std::nullopt;
        thick_mm += step_mm * remaining_fraction;
      } else if (thick_mm > 0) {
        return std::nullopt;
      }
    }
    if (!on_base || thick_mm > max_mm) return std::nullopt;
    layer.thickness_mm += thick_mm / kRays.size();
  }
  if (!(layer.thickness_mm > 0)) return std::nullopt;
  return layer;
}

double mean_inverse_base_depth_per_mm(const CarvedLabels& labels, std::span<const ElasticMaterial> by_label,
                                      const Point<Patient>& at, const Vector<Patient>& outward, double min_mm,
                                      double max_mm) {
  constexpr double kDeepStepVoxels = 0.5;
  const double step_mm = kDeepStepVoxels * labels.original->geometry().min_spacing_mm();
  const Eigen::Vector3d across = outward.eigen().unitOrthogonal(), other = outward.eigen().cross(across);
  double sum_per_mm = 0, beside_mm = 0;
  for (const auto& [x, y] : kRays) {
    const LabelRay ray(labels, by_label, at + Vector<Patient>(beside_mm * (x * across + y * other)),
                       outward * -step_mm);
    double base_mm = 0;
    bool entered = false;
    for (int n = 0; n * step_mm < max_mm && base_mm == 0; ++n) {
      const LabelRay::Sample sample = ray.at(n);
      const bool is_there = sample.remaining_fraction > 0 && sample.material.matter != Matter::kNone;
      if (is_there && sample.material.matter == Matter::kRigid) base_mm = (n + 0.5) * step_mm;
      if (entered && !is_there) break;
      entered = entered || is_there;
    }
    if (beside_mm == 0) beside_mm = 0.5 * base_mm;
    if (beside_mm == 0) return 0;
    if (base_mm > min_mm) sum_per_mm += 1 / (base_mm * kRays.size());
  }
  return sum_per_mm;
}

}  // namespace palpate
