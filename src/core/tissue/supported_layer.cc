#include "tissue/supported_layer.h"

#include <array>
#include <cmath>

namespace palpate {
namespace {

/// Largest ratio of Young's moduli in one layer.
constexpr double kSameModulus = 1.25;
/// Step along a ray, and distance above the surface at which it starts, in voxels.
constexpr double kStepVoxels = 0.125, kAboveVoxels = 1.5;
/// Value of a voxel that is completely removed.
constexpr double kWhollyTaken = 255;
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

bool same_material(const ElasticMaterial& one, const ElasticMaterial& other) {
  return one.youngs_modulus_kPa <= kSameModulus * other.youngs_modulus_kPa &&
         other.youngs_modulus_kPa <= kSameModulus * one.youngs_modulus_kPa;
}

}  // namespace

std::optional<SupportedLayer> supported_layer(const CarvedLabels& labels,
                                              std::span<const ElasticMaterial> by_label,
                                              const Point<Patient>& at, const Vector<Patient>& outward,
                                              double circle_mm, double max_mm) {
  const GridGeometry& grid = labels.made->geometry();
  const Transform<Voxel, Patient> X_VoxelPatient = grid.X_PatientVoxel().inverse();
  const double step_mm = kStepVoxels * grid.min_spacing_mm(),
               above_mm = kAboveVoxels * grid.spacing_mm.maxCoeff();
  const Eigen::Vector3d across = outward.eigen().unitOrthogonal(), other = outward.eigen().cross(across);
  SupportedLayer layer;
  bool known = false;
  for (const auto& [x, y] : kRays) {
    const Point<Patient> start =
        at + outward * above_mm + Vector<Patient>(circle_mm * (x * across + y * other));
    const Eigen::Vector3d first = (X_VoxelPatient * start).eigen();
    const Eigen::Vector3d displacement = X_VoxelPatient.linear() * (-step_mm * outward.eigen());
    double thick_mm = 0;
    bool on_base = false;
    const int steps = static_cast<int>(std::ceil((max_mm + 2 * above_mm) / step_mm));
    for (int n = 0; n < steps && !on_base; ++n) {
      const Eigen::Vector3d position = first + (n + 0.5) * displacement;
      std::array<int, 3> voxel;
      for (int axis = 0; axis < 3; ++axis)
        voxel[static_cast<std::size_t>(axis)] = static_cast<int>(std::floor(position[axis] + 0.5));
      const LabelId label = labels.made->anywhere(voxel[0], voxel[1], voxel[2]);
      const ElasticMaterial material = label < by_label.size() ? by_label[label] : ElasticMaterial{};
      const double left = labels.taken != nullptr
                              ? 1 - labels.taken->anywhere(voxel[0], voxel[1], voxel[2]) / kWhollyTaken
                              : 1;
      if (material.matter == Matter::kRigid && left > 0) {
        on_base = true;
      } else if (material.matter == Matter::kSoft && left > 0) {
        if (!known) {
          layer.label = label;
          layer.material = material;
          known = true;
        }
        if (!same_material(material, layer.material)) return std::nullopt;
        thick_mm += step_mm * left;
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

}  // namespace palpate
