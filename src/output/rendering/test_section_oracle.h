#pragma once

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "palpate/rendering/rendering.h"

/// Reference implementation of sections: pixel by pixel, in double, without optimisation.
namespace palpate::testing {

struct OraclePixel {
  bool inside = false;          ///< Inside the volume
  LabelId label = 0;            ///< Label of the nearest voxel
  bool near_tie = false;        ///< Two voxels are almost equally near
  std::optional<double> value;  ///< Interpolated scan value; none if a voxel of the cell is not finite
};

inline OraclePixel oracle_pixel(const Model& model, const GridGeometry& grid, const Eigen::Vector3d& voxel) {
  OraclePixel pixel;
  std::array<int, 3> cell{}, next{}, nearest{};
  std::array<double, 3> t{};
  for (int a = 0; a < 3; ++a) {
    // extends half a voxel beyond the outermost centres; false for coordinates that are not finite
    if (!(voxel[a] >= -0.5 && voxel[a] < grid.dims[a] - 0.5)) return {};
    const double v = std::clamp(voxel[a], 0.0, static_cast<double>(grid.dims[a] - 1));
    cell[a] = std::min(static_cast<int>(v), std::max(0, grid.dims[a] - 2));
    next[a] = std::min(cell[a] + 1, grid.dims[a] - 1);
    t[a] = v - cell[a];
    nearest[a] = static_cast<int>(voxel[a] + 0.5);
    pixel.near_tie = pixel.near_tie || std::abs(t[a] - 0.5) < 1e-3;
  }
  pixel.inside = true;
  if (model.labels != nullptr) pixel.label = model.labels->at(nearest[0], nearest[1], nearest[2]);
  if (model.scan == nullptr) return pixel;
  double sum = 0;
  for (int corner = 0; corner < 8; ++corner) {
    std::array<int, 3> at{};
    double weight = 1;
    for (int a = 0; a < 3; ++a) {
      const bool far = (corner >> a & 1) != 0;
      at[a] = far ? next[a] : cell[a];
      weight *= far ? t[a] : 1 - t[a];
    }
    const double value = model.scan->at(at[0], at[1], at[2]);
    if (!std::isfinite(value)) return pixel;
    sum += weight * value;
  }
  pixel.value = sum;
  return pixel;
}

/// All pixels, row by row.
inline std::vector<OraclePixel> oracle_section(const Model& model, const SectionPlane& plane) {
  const GridGeometry& grid = model.labels != nullptr ? model.labels->geometry() : model.scan->geometry();
  const auto X_VoxelPatient = grid.X_PatientVoxel().inverse();
  const Eigen::Vector3d origin = (X_VoxelPatient * plane.at(0, 0)).eigen();
  const Eigen::Vector3d step = (X_VoxelPatient * (plane.right * plane.mm_per_px())).eigen();
  const Eigen::Vector3d line = (X_VoxelPatient * (plane.down * plane.mm_per_px())).eigen();
  std::vector<OraclePixel> pixels;
  for (int row = 0; row < plane.height_px; ++row) {
    const Eigen::Vector3d start = origin + line * row;
    for (int column = 0; column < plane.width_px; ++column)
      pixels.push_back(oracle_pixel(model, grid, start + step * column));
  }
  return pixels;
}

/// The same for displaced tissue: rest positions by Newton's method.
inline std::vector<OraclePixel> oracle_section(const Model& model, const SectionPlane& plane,
                                               const TissueDisplacement& moved) {
  const GridGeometry& grid = model.labels != nullptr ? model.labels->geometry() : model.scan->geometry();
  const auto X_VoxelPatient = grid.X_PatientVoxel().inverse();
  std::vector<OraclePixel> pixels;
  for (int row = 0; row < plane.height_px; ++row)
    for (int column = 0; column < plane.width_px; ++column) {
      const Point<Patient> displayed = plane.at(column, row);
      Point<Patient> at = displayed;
      for (int step = 0; step < 20; ++step) {
        Eigen::Matrix3d slope = Eigen::Matrix3d::Identity();
        for (int axis = 0; axis < 3; ++axis) {
          Vector<Patient> displacement;
          displacement[axis] = 1e-4;
          slope.col(axis) += (moved(at + displacement) - moved(at - displacement)).eigen() / 2e-4;
        }
        at += Vector<Patient>(slope.inverse() * ((displayed - at) - moved(at)).eigen());
      }
      pixels.push_back(oracle_pixel(model, grid, (X_VoxelPatient * at).eigen()));
    }
  return pixels;
}

/// Blends the structures' colours over greys, with outlines in full colour.
inline std::vector<std::uint8_t> oracle_blend(const std::vector<std::uint8_t>& grey_rgb,
                                              const std::vector<LabelId>& labels, const SectionPlane& plane,
                                              const std::vector<Rgb>& colours, const SectionStyle& style) {
  const int width = plane.width_px, height = plane.height_px;
  std::vector<std::uint8_t> rgb = grey_rgb;
  const auto label_at = [&](int x, int y, LabelId beyond) {
    return x < 0 || y < 0 || x >= width || y >= height ? beyond
                                                       : labels[static_cast<std::size_t>(y) * width + x];
  };
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const LabelId label = label_at(x, y, 0);
      if (label == 0) continue;
      const bool border = label_at(x - 1, y, label) != label || label_at(x + 1, y, label) != label ||
                          label_at(x, y - 1, label) != label || label_at(x, y + 1, label) != label;
      const double alpha = style.outlines && border ? 255 : std::round(255 * style.label_opacity);
      const Rgb& c = colours[label % colours.size()];
      std::uint8_t* pixel = &rgb[3 * (static_cast<std::size_t>(y) * width + x)];
      const double over[3] = {1.0 * c.r, 1.0 * c.g, 1.0 * c.b};
      for (int n = 0; n < 3; ++n)
        pixel[n] = static_cast<std::uint8_t>(std::lround((pixel[n] * (255 - alpha) + over[n] * alpha) / 255));
    }
  }
  return rgb;
}

}  // namespace palpate::testing
