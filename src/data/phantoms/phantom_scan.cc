#include "phantoms/phantom_scan.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "palpate/base/hash.h"

namespace palpate {
namespace {

constexpr double kCortex_mm = 1.2;
constexpr double kRicianSigma = 14;
constexpr double kCtSigma_HU = 20;

struct Intensity {
  double deep, rim;  ///< Marrow and cortex of a bone; equal for other materials.
};

// proton density weighted, without fat suppression; arbitrary units as stored by scanners
Intensity proton_density(PhantomMaterial material) {
  using enum PhantomMaterial;
  const auto even = [](double value) { return Intensity{value, value}; };
  switch (material) {
    case kFat:
      return even(720);
    case kMuscle:
      return even(330);
    case kFluid:
      return even(860);
    case kBone:
      return {600, 60};
    case kCartilage:
      return even(500);
    case kMeniscus:
      return even(90);
    case kLigament:
      return even(110);
    case kVessel:
      return even(60);
    case kLesion:
      return even(780);
    case kGland:
      return even(560);
    case kSkin:
      return even(330);
    case kBrain:
      return even(540);
    case kPlastic:
      return even(20);
    case kInvisible:
      break;
  }
  return {};
}

// typical values of clinical CT; HU
Intensity hounsfield(PhantomMaterial material) {
  using enum PhantomMaterial;
  const auto even = [](double value) { return Intensity{value, value}; };
  switch (material) {
    case kFat:
      return even(-100);
    case kMuscle:
      return even(55);
    case kFluid:
      return even(10);
    case kBone:
      return {500, 1300};
    case kCartilage:
    case kMeniscus:
    case kLigament:
      return even(90);
    case kVessel:
      return even(45);
    case kLesion:
    case kGland:
      return even(40);
    case kSkin:
      return even(60);
    case kBrain:
      return even(35);
    case kPlastic:
      return even(120);
    case kInvisible:
      break;
  }
  return {};
}

double coverage(double distance_mm, double voxel_mm) {
  return std::clamp(0.5 - distance_mm / voxel_mm, 0.0, 1.0);
}

double mix(double below, double above, double fraction) {
  return below + fraction * (above - below);
}

// (0, 1], so that the logarithm is finite
double uniform(std::mt19937_64& random) {
  return (static_cast<double>(random() >> 11) + 1) * 0x1.0p-53;
}

std::mt19937_64 random_of_slice(std::uint64_t seed, int slice) {
  std::uint64_t state = kHashSeed;
  hash_word(state, seed);
  hash_word(state, static_cast<std::uint64_t>(slice));
  return std::mt19937_64(hash_finish(state));
}

// two independent Gaussian numbers by the Box-Muller method
Eigen::Vector2d gaussian_pair(std::mt19937_64& random, double sigma) {
  const double radius = sigma * std::sqrt(-2 * std::log(uniform(random)));
  const double angle = 2 * std::numbers::pi * uniform(random);
  return {radius * std::cos(angle), radius * std::sin(angle)};
}

}  // namespace

double background(PhantomImaging imaging) {
  return imaging == PhantomImaging::kCt ? -1000 : 12;
}

double material_depth_mm(PhantomMaterial material) {
  return material == PhantomMaterial::kBone ? kCortex_mm : 0;
}

double paint(PhantomMaterial material, PhantomImaging imaging, double below, double distance_mm,
             double voxel_mm) {
  if (material == PhantomMaterial::kInvisible) return below;
  const Intensity intensity =
      imaging == PhantomImaging::kCt ? hounsfield(material) : proton_density(material);
  const double fraction = coverage(distance_mm, voxel_mm);
  if (material != PhantomMaterial::kBone) return mix(below, intensity.deep, fraction);
  return mix(mix(below, intensity.rim, fraction), intensity.deep,
             coverage(distance_mm + kCortex_mm, voxel_mm));
}

double shading(PhantomImaging imaging, const Eigen::Vector3d& p_mm) {
  if (imaging == PhantomImaging::kCt) return 1;
  // brighter towards the anterior coil, decreasing along the leg
  return 1 - 0.0012 * p_mm.y() - 2.2e-5 * p_mm.z() * p_mm.z() + 4e-4 * p_mm.x();
}

void add_rician_noise(float* voxels, std::size_t count, double sigma, std::uint64_t seed, int slice) {
  std::mt19937_64 random = random_of_slice(seed, slice);
  for (std::size_t i = 0; i < count; ++i) {
    // one pair is the noise of both channels
    const Eigen::Vector2d noise = gaussian_pair(random, sigma);
    const double real = voxels[i] + noise[0];
    const double imaginary = noise[1];
    voxels[i] = static_cast<float>(std::sqrt(real * real + imaginary * imaginary));
  }
}

void add_gaussian_noise(float* voxels, std::size_t count, double sigma, std::uint64_t seed, int slice) {
  std::mt19937_64 random = random_of_slice(seed, slice);
  for (std::size_t i = 0; i < count; ++i) voxels[i] += static_cast<float>(gaussian_pair(random, sigma)[0]);
}

void add_noise(PhantomImaging imaging, float* voxels, std::size_t count, std::uint64_t seed, int slice) {
  if (imaging == PhantomImaging::kCt) return add_gaussian_noise(voxels, count, kCtSigma_HU, seed, slice);
  add_rician_noise(voxels, count, kRicianSigma, seed, slice);
}

}  // namespace palpate
