#include <algorithm>
#include <cmath>
#include <limits>

#include "palpate/rendering.h"

namespace palpate {
namespace {

constexpr std::uint8_t kOutsideScan = 14;  // beyond the scan
constexpr std::uint8_t kNoScan = 26;       // there is no scan at all

/// Calls visit(pixel, voxel) for every pixel, row by row, with its continuous voxel index.
template <class Visit>
void for_each_pixel(const GridGeometry& grid, const SectionPlane& plane, Visit visit) {
  // pixel to voxel is affine: one origin and two steps
  const Transform<Voxel, Patient> X_VoxelPatient = grid.X_PatientVoxel().inverse();
  const Eigen::Vector3d origin = (X_VoxelPatient * plane.at(0, 0)).eigen();
  const Eigen::Vector3d step = (X_VoxelPatient * (plane.right * plane.mm_per_px())).eigen();
  const Eigen::Vector3d line = (X_VoxelPatient * (plane.down * plane.mm_per_px())).eigen();

  std::size_t pixel = 0;
  for (int row = 0; row < plane.height_px; ++row) {
    const Eigen::Vector3d first = origin + line * row;
    for (int column = 0; column < plane.width_px; ++column)
      visit(pixel++, Eigen::Vector3d(first + step * column));
  }
}

/// Whether a continuous index lies in the volume, each voxel reaching half way to its neighbours. False
/// for what is not finite, so that the index can be converted to integers afterwards.
bool inside(const GridGeometry& grid, const Eigen::Vector3d& voxel) {
  for (int axis = 0; axis < 3; ++axis) {
    if (!(voxel[axis] >= -0.5 && voxel[axis] < grid.dims[axis] - 0.5)) return false;
  }
  return true;
}

/// Trilinear value at an index for which inside() holds; the outermost half voxels repeat the border.
double trilinear(const Volume<float>& scan, const Eigen::Vector3d& voxel) {
  const GridGeometry& grid = scan.geometry();
  std::array<int, 3> low{}, high{};
  std::array<double, 3> t{};
  for (int axis = 0; axis < 3; ++axis) {
    const double v = std::clamp(voxel[axis], 0.0, static_cast<double>(grid.dims[axis] - 1));
    low[axis] = static_cast<int>(v);
    high[axis] = std::min(low[axis] + 1, grid.dims[axis] - 1);
    t[axis] = v - low[axis];
  }
  const auto along_i = [&](int j, int k) {
    const double a = static_cast<double>(scan.at(low[0], j, k));
    const double b = static_cast<double>(scan.at(high[0], j, k));
    return a + (b - a) * t[0];
  };
  const auto along_j = [&](int k) {
    const double a = along_i(low[1], k);
    return a + (along_i(high[1], k) - a) * t[1];
  };
  const double a = along_j(low[2]);
  return a + (along_j(high[2]) - a) * t[2];
}

/// How one structure is painted.
struct Paint {
  Rgb colour;
  std::uint8_t fill = 0;     ///< alpha
  std::uint8_t outline = 0;  ///< alpha
};

std::uint8_t to_byte(double value) {
  return static_cast<std::uint8_t>(std::lround(std::clamp(value, 0.0, 1.0) * 255.0));
}

const Tissue* tissue_of(const Model& model, std::size_t label) {
  if (label >= model.tissue_of_label.size()) return nullptr;
  const int tissue = model.tissue_of_label[label];
  return tissue >= 0 && static_cast<std::size_t>(tissue) < model.tissues.size() ? &model.tissues[tissue]
                                                                                : nullptr;
}

/// The paint of every label id: the segment's colour, else the tissue's.
std::vector<Paint> paints(const Model& model, const SectionStyle& style) {
  std::vector<Paint> table(std::size_t{std::numeric_limits<LabelId>::max()} + 1);
  for (std::size_t label = 1; label < table.size(); ++label) {
    const Tissue* tissue = tissue_of(model, label);
    const double opacity = tissue != nullptr ? tissue->opacity : 1.0;
    if (tissue != nullptr) table[label].colour = tissue->colour;
    table[label].fill = to_byte(style.label_opacity * opacity);
    table[label].outline = opacity > 0 ? 255 : 0;
  }
  for (const Segment& segment : model.segments) {
    if (segment.id != 0) table[segment.id].colour = segment.colour;
  }
  return table;
}

/// Whether a pixel's structure differs from that of a neighbour above, below, left or right.
bool is_border(const std::vector<LabelId>& labels, int width, int height, int column, int row) {
  const std::size_t pixel = static_cast<std::size_t>(row) * width + column;
  const LabelId label = labels[pixel];
  return (column > 0 && labels[pixel - 1] != label) || (column + 1 < width && labels[pixel + 1] != label) ||
         (row > 0 && labels[pixel - width] != label) || (row + 1 < height && labels[pixel + width] != label);
}

std::size_t pixel_count(const SectionPlane& plane) {
  PALPATE_CHECK(plane.width_px > 0 && plane.height_px > 0 && plane.width_mm > 0);
  return static_cast<std::size_t>(plane.width_px) * plane.height_px;
}

}  // namespace

std::array<double, 2> scan_window(const Volume<float>& scan) {
  constexpr std::size_t kSamples = 1'000'000;
  const std::vector<float>& voxels = scan.voxels();
  // an odd stride walks through all columns of grids with even dimensions
  const std::size_t stride = std::max<std::size_t>(1, voxels.size() / kSamples) | 1;
  std::vector<float> samples;
  samples.reserve(voxels.size() / stride + 1);
  for (std::size_t i = 0; i < voxels.size(); i += stride) {
    if (std::isfinite(voxels[i])) samples.push_back(voxels[i]);
  }
  if (samples.empty()) return {0, 1};

  const auto percentile = [&](double fraction) {
    const auto nth =
        samples.begin() + static_cast<std::ptrdiff_t>(fraction * static_cast<double>(samples.size() - 1));
    std::nth_element(samples.begin(), nth, samples.end());
    return static_cast<double>(*nth);
  };
  const double low = percentile(0.01), high = percentile(0.99);
  return low < high ? std::array<double, 2>{low, high} : std::array<double, 2>{0, 1};
}

std::vector<LabelId> section_labels(const Model& model, const SectionPlane& plane) {
  std::vector<LabelId> labels(pixel_count(plane), 0);
  if (model.labels == nullptr || model.labels->empty()) return labels;
  const Volume<LabelId>& volume = *model.labels;
  for_each_pixel(volume.geometry(), plane, [&](std::size_t pixel, const Eigen::Vector3d& voxel) {
    if (!inside(volume.geometry(), voxel)) return;
    // not negative after adding a half, so that truncation rounds to the nearest
    labels[pixel] = volume.at(static_cast<int>(voxel[0] + 0.5), static_cast<int>(voxel[1] + 0.5),
                              static_cast<int>(voxel[2] + 0.5));
  });
  return labels;
}

Image render_scan_layer(const Model& model, const SectionPlane& plane, const SectionStyle& style) {
  PALPATE_CHECK(style.grey_levels >= 2 && style.grey_levels <= 256);
  const bool has_scan = model.scan != nullptr && !model.scan->empty();
  Image image{plane.width_px, plane.height_px, {}};
  image.rgb.assign(3 * pixel_count(plane), has_scan ? kOutsideScan : kNoScan);
  if (!has_scan) return image;

  const Volume<float>& scan = *model.scan;
  std::array<double, 2> window{style.window_low, style.window_high};
  if (!(window[0] < window[1])) window = scan_window(scan);
  const double top = style.grey_levels - 1;
  for_each_pixel(scan.geometry(), plane, [&](std::size_t pixel, const Eigen::Vector3d& voxel) {
    if (!inside(scan.geometry(), voxel)) return;
    const double value = (trilinear(scan, voxel) - window[0]) / (window[1] - window[0]);
    if (!std::isfinite(value)) return;
    const double level = std::floor(std::clamp(value, 0.0, 1.0) * top + 0.5) / top;
    std::fill_n(image.rgb.begin() + static_cast<std::ptrdiff_t>(3 * pixel), 3, to_byte(level));
  });
  return image;
}

Overlay render_structure_layer(const Model& model, const SectionPlane& plane, const SectionStyle& style) {
  const std::vector<LabelId> labels = section_labels(model, plane);
  const std::vector<Paint> table = paints(model, style);
  Overlay overlay{plane.width_px, plane.height_px, std::vector<std::uint8_t>(4 * labels.size(), 0)};
  for (int row = 0; row < plane.height_px; ++row) {
    for (int column = 0; column < plane.width_px; ++column) {
      const std::size_t pixel = static_cast<std::size_t>(row) * plane.width_px + column;
      if (labels[pixel] == 0) continue;
      const Paint& paint = table[labels[pixel]];
      const bool outline = style.outlines && is_border(labels, plane.width_px, plane.height_px, column, row);
      const std::uint8_t alpha = outline ? paint.outline : paint.fill;
      if (alpha == 0) continue;  // one kind of transparent: all zero
      const std::array<std::uint8_t, 4> rgba{paint.colour.r, paint.colour.g, paint.colour.b, alpha};
      std::copy(rgba.begin(), rgba.end(), overlay.rgba.begin() + static_cast<std::ptrdiff_t>(4 * pixel));
    }
  }
  return overlay;
}

Image render_section(const Model& model, const SectionPlane& plane, const SectionStyle& style) {
  Image image = render_scan_layer(model, plane, style);
  const Overlay overlay = render_structure_layer(model, plane, style);
  for (std::size_t pixel = 0; 4 * pixel < overlay.rgba.size(); ++pixel) {
    const std::uint8_t* over = &overlay.rgba[4 * pixel];
    for (int channel = 0; channel < 3; ++channel) {
      std::uint8_t& under = image.rgb[3 * pixel + channel];
      under = static_cast<std::uint8_t>((under * (255 - over[3]) + over[channel] * over[3] + 127) / 255);
    }
  }
  return image;
}

}  // namespace palpate
