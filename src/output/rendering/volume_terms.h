#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "palpate/rendering/volume_renderer.h"
#include "palpate/volume/gaussian_kernel.h"

/// Optical model of volume pictures, shared by the renderer and the reference ray caster that it is tested
/// against. h is the grid's shortest spacing.
///
///    coverage    o_s   of each structure s at a voxel: its label indicator, smoothed [1 2 1] / 4 per axis
///    extinction  e     1/mm: opaque structures together have kSolidDepth / h * solidity(); a translucent
///                      one has a surface with an optical depth of surface_depth() in all, larger for oblique
///                      rays, and haze_per_mm() inside; the scan has scan_per_mm() where structures cover at
///                      most a half
///    colour      c     mean of the structures' colours and the scan's grey, weighted by extinction
///    normal      m     gradient of the smoothed opacity divided by its length or by kFaintGradient of an
///                      opaque surface's gradient, whichever is larger, times sidedness(): length at most 1;
///                      0 where structures have no extinction
///    radiance    l     of a voxel: c (ambient + diffuse f + key g) + specular f^20 with
///                      f = abs(m . into) + 1 - norm(m) and
///                      g = max(0, m . from_key) + max(0, into . from_key) (1 - norm(m)):
///                      a voxel without a normal faces the viewer
///
/// Between voxels e and e l are interpolated trilinearly, towards 0 beyond the grid. A ray accumulates
/// integral T e l dt with the transmittance T = exp(-integral e dt).
namespace palpate::internal::volume_picture {

/// Optical depth of an opaque voxel: with less, surfaces look translucent; with more, the voxel steps become
/// visible.
inline constexpr double kSolidDepth = 5;
/// Share of kSolidDepth for a voxel with this coverage by opaque structures. Zero below 0.4, so that a ray
/// that grazes a surface is not terminated before it; at least one half if the voxel itself is opaque, so
/// that a sheet or thread one voxel thick is visible.
inline double solidity(double coverage, bool is_solid) {
  return std::max((coverage - 0.4) / 0.6, is_solid ? 0.5 : 0.0);
}
inline constexpr double kFaintGradient = 0.05;
inline constexpr int kShininess = 20;
/// Weight of the normal as a function of the smoothed opacity: none deep inside opaque structures, so that a
/// clipped surface is shaded flat.
inline double sidedness(double smoothed_opacity) {
  return std::clamp((0.95 - smoothed_opacity) / 0.15, 0.0, 1.0);
}

/// Unit direction towards the key light.
inline Vector<Patient> direction_to_key(const VolumeCamera& camera, const VolumeLight& light) {
  const auto& [right, up, towards] = light.key_direction;
  return (camera.right * right - camera.down * up - camera.into() * towards).normalized();
}

/// Optical depth of a translucent structure's surface, and extinction inside it per mm; the same constants as
/// in web/src/volume/volume_caster.ts.
inline double surface_depth(double opacity) {
  return -std::log(1 - 0.6 * opacity);
}
inline double haze_per_mm(double opacity) {
  return 0.006 * opacity;
}

/// Extinction of the scan per mm, and its grey level, 0 ... 255; the same constants as in
/// web/src/volume/volume_caster.ts.
/// @param value  0 ... 1 in the display window
inline double scan_per_mm(double value, double covered, double opacity) {
  return 0.03 * std::clamp((36 * value * opacity - 3) / 33, 0.0, 1.0) *
         (1 - std::clamp(2 * covered, 0.0, 1.0));
}
inline double scan_grey(double value) {
  return 0.8 * 255 * value;
}
/// Position of a scan value in its window, 0 ... 1; 0 for NaN.
inline double value_in_window(float scanned, const std::array<double, 2>& window) {
  const double value = (static_cast<double>(scanned) - window[0]) / (window[1] - window[0]);
  return value > 0 ? std::min(value, 1.0) : 0;
}

/// Width of the Gaussian for the normals, since binary voxels contain little information about a surface's
/// slope. 2.5 times the longest spacing, unless that exceeds 2.5 mm and slices are thick, whose steps are
/// then visible.
inline double normal_sigma_mm(const GridGeometry& grid) {
  const double largest = std::max(2.5, 2.5 * grid.min_spacing_mm());
  return std::min({internal::kMaxSigma_mm, largest, 2.5 * grid.spacing_mm.maxCoeff()});
}
/// Weights along an axis, truncated at 3 standard deviations: a longer reach means more recomputation around
/// a change.
inline internal::AxisKernel sample_normal_kernel(double sigma_voxels) {
  return internal::sample_gaussian(sigma_voxels, static_cast<int>(std::ceil(3 * sigma_voxels)));
}
/// Gradient per mm of an opaque flat surface under that Gaussian.
inline double surface_gradient_per_mm(const GridGeometry& grid) {
  return 1 / (std::sqrt(2 * std::numbers::pi) * normal_sigma_mm(grid));
}

}  // namespace palpate::internal::volume_picture
