#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "palpate/rendering/volume_renderer.h"
#include "palpate/volume/gaussian_kernel.h"

/// What a picture of a volume is a picture of: the renderer and the ray caster that it is compared with
/// compute the same from these. h is the grid's shortest spacing.
///
///     coverage    o_s   of each structure s at a voxel: its labels, smoothed [1 2 1] / 4 along each axis
///     extinction  e     1/mm: solid ones together have kSolidDepth / h * solidity(); of what one sees
///     through
///                       the surface has surface_depth() in all, the more the more slanting the ray, and its
///                       inside haze_per_mm(); of the scan, where nothing covers more than a half,
///                       scan_per_mm()
///     colour      c     the mean of the structures' and the scan's grey, each counting as its extinction
///                       does
///     normal      m     gradient of the smoothed opacity, over its length or kFaintGradient of a solid's
///                       surface, whichever is more, times sidedness(): at most 1 long; 0 where structures
///                       have no extinction
///     light       l     of a voxel: c (ambient + diffuse f) + specular f^20 with
///                       f = |m . into| + 1 - |m|: what has no side faces the light
///
/// Between the voxels e and e l are interpolated, trilinearly, towards 0 beyond the grid. A ray gathers
/// integral T e l dt, where T = exp(-integral e dt) is how much it still sees of what lies behind.
namespace palpate::internal::volume_picture {

/// Optical depth of a solid's voxel: less, and one looks into it; more, and the voxels' steps are seen.
inline constexpr double kSolidDepth = 5;
/// How much of that a voxel has which solid structures cover by so much. Nothing below 0.4, so that a ray
/// which grazes a surface does not end before it; half of it at least where the voxel itself is solid, so
/// that a sheet or a thread of one voxel is seen.
inline double solidity(double coverage, bool is_solid) {
  return std::max((coverage - 0.4) / 0.6, is_solid ? 0.5 : 0.0);
}
inline constexpr double kFaintGradient = 0.05;
inline constexpr int kShininess = 20;
/// How much of a side there is where opacity, smoothed for the normals, is so much: none deep in what is
/// solid, so that it is flat where it is cut open.
inline double sidedness(double smoothed_opacity) {
  return std::clamp((0.95 - smoothed_opacity) / 0.15, 0.0, 1.0);
}

/// Both as the viewer's page has them (web/src/volume_caster.ts).
inline double surface_depth(double opacity) {
  return -std::log(1 - 0.6 * opacity);
}
inline double haze_per_mm(double opacity) {
  return 0.006 * opacity;
}

/// Both of the scan, as the viewer's page has them. @param value  0 ... 1 of the window
inline double scan_per_mm(double value, double covered, double opacity) {
  return 0.03 * std::clamp((36 * value * opacity - 3) / 33, 0.0, 1.0) *
         (1 - std::clamp(2 * covered, 0.0, 1.0));
}
inline double scan_grey(double value) {
  return 0.8 * 255 * value;
}
/// Where in its window a scan's value is; 0 where that is no number.
inline double value_in_window(float scanned, const std::array<double, 2>& window) {
  const double value = (static_cast<double>(scanned) - window[0]) / (window[1] - window[0]);
  return value > 0 ? std::min(value, 1.0) : 0;
}

/// Width of the Gaussian under the normals: voxels of one bit say little of a surface's slope. 2.5 of the
/// longest spacing, unless that is more than 2.5 mm and slices are thick: then they are seen as what they
/// are.
inline double normal_sigma_mm(const GridGeometry& grid) {
  const double most = std::max(2.5, 2.5 * grid.min_spacing_mm());
  return std::min({internal::kMaxSigma_mm, most, 2.5 * grid.spacing_mm.maxCoeff()});
}
/// Its weights along an axis, to 3 standard deviations: the farther they reach, the more is made anew around
/// what changed.
inline internal::AxisKernel sample_normal_kernel(double sigma_voxels) {
  return internal::sample_gaussian(sigma_voxels, static_cast<int>(std::ceil(3 * sigma_voxels)));
}
/// Gradient by mm of a solid's flat surface under that Gaussian.
inline double surface_gradient_per_mm(const GridGeometry& grid) {
  return 1 / (std::sqrt(2 * std::numbers::pi) * normal_sigma_mm(grid));
}

}  // namespace palpate::internal::volume_picture
