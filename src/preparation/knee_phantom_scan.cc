#include "preparation/knee_phantom_scan.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "base/hash.h"

namespace palpate {
namespace {

constexpr double kCortex_mm = 1.2;

// Proton density weighted, no fat suppression; arbitrary units as scanners store them.
double intensity(PhantomMaterial material) {
  using enum PhantomMaterial;
  switch (material) {
    case kFat:
      return 720;
    case kMuscle:
      return 330;
    case kFluid:
      return 860;
    case kBone:
      return 600;
    case kCartilage:
      return 500;
    case kMeniscus:
      return 90;
    case kLigament:
      return 110;
    case kVessel:
      return 60;
  }
  return 0;
}
constexpr double kCortexIntensity = 60;

double coverage(double distance_mm, double voxel_mm) {
  return std::clamp(0.5 - distance_mm / voxel_mm, 0.0, 1.0);
}

double mix(double below, double above, double share) {
  return below + share * (above - below);
}

// (0, 1]: its logarithm is finite
double uniform(std::mt19937_64& random) {
  return (static_cast<double>(random() >> 11) + 1) * 0x1.0p-53;
}

}  // namespace

double material_depth_mm(PhantomMaterial material) {
  return material == PhantomMaterial::kBone ? kCortex_mm : 0;
}

double paint(PhantomMaterial material, double below, double distance_mm, double voxel_mm) {
  const double share = coverage(distance_mm, voxel_mm);
  if (material != PhantomMaterial::kBone) return mix(below, intensity(material), share);
  return mix(mix(below, kCortexIntensity, share), intensity(material),
             coverage(distance_mm + kCortex_mm, voxel_mm));
}

double coil_sensitivity(const Eigen::Vector3d& p_mm) {
  // brighter towards the coil in front, falling off along the leg
  return 1 - 0.0012 * p_mm.y() - 2.2e-5 * p_mm.z() * p_mm.z() + 4e-4 * p_mm.x();
}

void add_rician_noise(float* voxels, std::size_t count, double sigma, std::uint64_t seed, int slice) {
  std::uint64_t state = kHashSeed;
  hash_word(state, seed);
  hash_word(state, static_cast<std::uint64_t>(slice));
  std::mt19937_64 random(hash_finish(state));
  for (std::size_t i = 0; i < count; ++i) {
    // Box-Muller: one pair is the noise of both channels
    const double radius = sigma * std::sqrt(-2 * std::log(uniform(random)));
    const double angle = 2 * std::numbers::pi * uniform(random);
    const double real = voxels[i] + radius * std::cos(angle);
    const double imaginary = radius * std::sin(angle);
    voxels[i] = static_cast<float>(std::sqrt(real * real + imaginary * imaginary));
  }
}

}  // namespace palpate
