#include <algorithm>
#include <cmath>
#include <limits>

#include "palpate/contact/colours.h"
#include "rendering/section_rows.h"
#include "rendering/section_volumes.h"

namespace palpate {
namespace {

using internal::section::Paint;
using internal::section::Row;
using internal::section::RowCursor;

/// Positions of a picture's pixels in voxel coordinates: an origin and two steps.
struct PixelsInGrid {
  PixelsInGrid(const GridGeometry& grid, const SectionPlane& plane) : dims(grid.dims) {
    const Transform<Voxel, Patient> X_VoxelPatient = grid.X_PatientVoxel().inverse();
    origin = (X_VoxelPatient * plane.at(0, 0)).eigen();
    step = (X_VoxelPatient * (plane.right * plane.mm_per_px())).eigen();
    line = (X_VoxelPatient * (plane.down * plane.mm_per_px())).eigen();
  }

  Eigen::Vector3d start_of(int row) const { return origin + line * row; }
  /// Whether a pixel is inside the volume, where voxels extend half a spacing about their centres. False for
  /// coordinates that are not finite.
  bool inside(const Eigen::Vector3d& start, int column) const {
    const Eigen::Vector3d voxel = start + step * column;
    for (int a = 0; a < 3; ++a) {
      if (!(voxel[a] >= -0.5 && voxel[a] < dims[a] - 0.5)) return false;
    }
    return true;
  }

  std::array<int, 3> dims;
  Eigen::Vector3d origin, step, line;
};

/// Range of a row's pixels inside the volume: intersection of a line with a box.
Row clipped(const PixelsInGrid& pixels, int row, int width) {
  const Eigen::Vector3d start = pixels.start_of(row);
  double low = 0, high = width;
  for (int a = 0; a < 3; ++a) {
    if (pixels.step[a] == 0) continue;
    const double at_0 = (-0.5 - start[a]) / pixels.step[a];
    const double at_end = (pixels.dims[a] - 0.5 - start[a]) / pixels.step[a];
    if (std::isnan(at_0) || std::isnan(at_end)) return {};
    low = std::max(low, std::min(at_0, at_end));
    high = std::min(high, std::max(at_0, at_end));
  }
  if (!(low <= high)) return {};

  // inside() decides about pixels on the boundary
  Row clip;
  for (int a = 0; a < 3; ++a) clip.start[a] = start[a];
  clip.begin = std::max(0, static_cast<int>(std::floor(low)) - 1);
  clip.end = std::min(width, static_cast<int>(std::ceil(high)) + 2);
  while (clip.begin < clip.end && !pixels.inside(start, clip.begin)) ++clip.begin;
  while (clip.begin < clip.end && !pixels.inside(start, clip.end - 1)) --clip.end;
  return clip;
}

/// Collects the displaced pixels with their rest positions.
void find_displaced(const GridGeometry& grid, const SectionPlane& plane, const TissueDisplacement& moved,
                    std::vector<internal::section::DisplacedPixel>& pixels) {
  const Transform<Voxel, Patient> X_VoxelPatient = grid.X_PatientVoxel().inverse();
  for (int y = 0; y < plane.height_px; ++y)
    for (int x = 0; x < plane.width_px; ++x) {
      const Point<Patient> displayed = plane.at(x, y), at_rest = rest_position(displayed, moved);
      if (at_rest == displayed) continue;
      const Eigen::Vector3d voxel = (X_VoxelPatient * at_rest).eigen();
      internal::section::DisplacedPixel& pixel = pixels.emplace_back();
      pixel.row = y;
      pixel.column = x;
      pixel.at_rest.end = 1;
      for (int a = 0; a < 3; ++a) {
        pixel.at_rest.start[a] = voxel[a];
        if (!(voxel[a] >= -0.5 && voxel[a] < grid.dims[a] - 0.5)) pixel.at_rest.end = 0;
      }
    }
}

std::uint8_t to_byte(double value) {
  return static_cast<std::uint8_t>(std::lround(std::clamp(value, 0.0, 1.0) * 255.0));
}

bool differs_from_neighbour(const RowCursor& row, int x) {
  const LabelId label = row.labels[x];
  return row.labels[x - 1] != label || row.labels[x + 1] != label || row.above[x] != label ||
         row.below[x] != label;
}

}  // namespace

SectionRenderer::SectionRenderer(const Model& model, const SectionStyle& style, SectionStorage storage)
    : volumes_(std::make_shared<const internal::section::Volumes>(model, storage)),
      pixels_(std::make_unique<internal::section::Pixels>()) {
  for (const Rgb& colour : colours_of_labels(model)) {
    const Tissue* tissue = model.tissue_of(static_cast<LabelId>(colours_.size()));
    colours_.push_back(tissue != nullptr ? Colouring{colour, tissue->opacity} : Colouring{.colour = colour});
  }
  set_style(style);
}

SectionRenderer::SectionRenderer(const SectionRenderer& other)
    : style_(other.style_),
      volumes_(other.volumes_),
      pixels_(std::make_unique<internal::section::Pixels>()),
      colours_(other.colours_),
      paints_(other.paints_) {}

SectionRenderer::SectionRenderer(SectionRenderer&&) noexcept = default;
SectionRenderer& SectionRenderer::operator=(SectionRenderer&&) noexcept = default;
SectionRenderer& SectionRenderer::operator=(const SectionRenderer& other) {
  return *this = SectionRenderer(other);
}
SectionRenderer::~SectionRenderer() = default;

void SectionRenderer::set_style(const SectionStyle& style) {
  PALPATE_CHECK(style.grey_levels >= 2 && style.grey_levels <= 256);
  style_ = style;
  paints_.assign(2 * (std::size_t{std::numeric_limits<LabelId>::max()} + 1), Paint{});
  for (std::size_t label = 1; 2 * label < paints_.size(); ++label) {
    const Colouring colouring = label < colours_.size() ? colours_[label] : Colouring{};
    const Rgb& c = colouring.colour;
    const std::uint8_t inside = to_byte(style.label_opacity * colouring.opacity);
    const std::uint8_t outline = !style.outlines ? inside : colouring.opacity > 0 ? 255 : 0;
    // canonical transparency: all components zero
    if (inside > 0) paints_[2 * label] = {c.r, c.g, c.b, inside};
    if (outline > 0) paints_[2 * label + 1] = {c.r, c.g, c.b, outline};
  }
}

std::size_t SectionRenderer::prepared_bytes() const {
  return volumes_->prepared_bytes();
}

RowCursor SectionRenderer::sample(const SectionPlane& plane, Layers layers) {
  const internal::section::Band band = pixels_->sized(plane.width_px, plane.height_px);
  std::vector<Row>& row = pixels_->rows();
  internal::section::Rows rows{row.data(), plane.height_px, plane.width_px};
  internal::section::VolumeView view = volumes_->view();
  if (layers == Layers::kLabels) view.scan = nullptr, view.codes = nullptr;
  if (layers == Layers::kScan) view.labels = nullptr, view.numbers = nullptr;

  std::fill_n(row.begin(), plane.height_px, Row{});
  pixels_->moved().clear();
  internal::section::GreyScale scale;
  if (!volumes_->empty()) {
    const PixelsInGrid in_grid(volumes_->grid(), plane);
    for (int y = 0; y < plane.height_px; ++y) row[y] = clipped(in_grid, y, plane.width_px);
    for (int a = 0; a < 3; ++a) rows.step[a] = in_grid.step[a];
    if (style_.moved) find_displaced(volumes_->grid(), plane, style_.moved, pixels_->moved());
    const bool has_window = style_.window_low < style_.window_high;
    const std::array<double, 2> window = has_window || layers == Layers::kLabels
                                             ? std::array{style_.window_low, style_.window_high}
                                             : volumes_->automatic_window();
    scale = volumes_->grey_scale(window, style_.grey_levels);
  }
  const std::uint8_t background =
      volumes_->has_scan() ? internal::section::kOutsideScan : internal::section::kNoScan;
  return {view, scale, rows, background, band, pixels_->moved()};
}

void SectionRenderer::render(const SectionPlane& plane, std::span<std::uint8_t> rgb) {
  PALPATE_CHECK(rgb.size() == 3 * plane.pixel_count());
  std::uint8_t* out = rgb.data();
  for (RowCursor row = sample(plane, Layers::kBoth); row.next(); out += std::ptrdiff_t{3} * plane.width_px)
    internal::section::blend_row(paints_.data(), row.grey, row.labels, row.above, row.below, plane.width_px,
                                 out);
}

void SectionRenderer::render_scan(const SectionPlane& plane, std::span<std::uint8_t> rgb) {
  PALPATE_CHECK(rgb.size() == 3 * plane.pixel_count());
  std::uint8_t* out = rgb.data();
  for (RowCursor row = sample(plane, Layers::kScan); row.next(); out += std::ptrdiff_t{3} * plane.width_px)
    internal::section::grey_row(row.grey, plane.width_px, out);
}

void SectionRenderer::render_structures(const SectionPlane& plane, std::span<std::uint8_t> rgba) {
  PALPATE_CHECK(rgba.size() == 4 * plane.pixel_count());
  auto out = rgba.begin();
  for (RowCursor row = sample(plane, Layers::kLabels); row.next();) {
    for (int x = 0; x < plane.width_px; ++x) {
      const Paint& paint = paints_[2 * std::size_t{row.labels[x]} + (differs_from_neighbour(row, x) ? 1 : 0)];
      out = std::copy(paint.begin(), paint.end(), out);
    }
  }
}

void SectionRenderer::labels(const SectionPlane& plane, std::span<LabelId> labels) {
  PALPATE_CHECK(labels.size() == plane.pixel_count());
  auto out = labels.begin();
  for (RowCursor row = sample(plane, Layers::kLabels); row.next();)
    out = std::copy_n(row.labels, plane.width_px, out);
}

}  // namespace palpate
