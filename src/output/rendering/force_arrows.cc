#include "palpate/rendering/force_arrows.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "palpate/base/file.h"
#include "rendering/marks.h"

namespace palpate {
namespace force_arrows {

double Arrow::force_N() const {
  return std::hypot(right_N, down_N, away_N);
}

double Arrow::in_plane_N() const {
  return std::hypot(right_N, down_N);
}

double arrows_per_side(double size_mm, double spacing_mm) {
  // tolerance for rounding, so that 20 mm holds 24 arrows at 20/24 mm
  return std::max(1.0, std::floor(size_mm / spacing_mm + 1e-9));
}

std::vector<Arrow> sample_arrows(const ForceField& field, const SectionPlane& plane, double spacing_mm,
                                 const Progress& progress) {
  const int count = static_cast<int>(arrows_per_side(plane.width_mm, spacing_mm));
  const double step_px = spacing_mm / plane.mm_per_px();
  const auto along = [&](int n, int size_px) {
    return 0.5 * (size_px - 1) + (n - 0.5 * (count - 1)) * step_px;
  };
  const Vector<Patient> away = plane.right.cross(plane.down);
  std::vector<Arrow> arrows;
  for (int row = 0; row < count && !progress.stopped(); ++row) {
    progress.report("forces", static_cast<double>(row) / count);
    for (int column = 0; column < count; ++column) {
      const Pixel at{along(column, plane.width_px), along(row, plane.height_px)};
      const FieldSample sample = field.sample(plane.at(at[0], at[1]));
      const Vector<Patient> force = normal_force(sample, field.full_force_N());
      arrows.push_back({at, force.dot(plane.right), force.dot(plane.down), force.dot(away), sample.value});
    }
  }
  progress.report("forces", 1);
  return arrows;
}

ValueGrid::ValueGrid(const ForceField& field, const SectionPlane& plane, int cells, const Progress& progress)
    : cells_(cells),
      cell_px_(static_cast<double>(plane.width_px) / cells),
      values_(static_cast<std::size_t>((cells + 1) * (cells + 1))) {
  for (int row = 0; row <= cells && !progress.stopped(); ++row) {
    progress.report("lines of equal value", static_cast<double>(row) / cells);
    for (int column = 0; column <= cells; ++column)
      values_[static_cast<std::size_t>(row * (cells + 1) + column)] =
          field.sample(plane.at(column * cell_px_ - 0.5, row * cell_px_ - 0.5)).value;
  }
}

void ValueGrid::add_cell(int column, int row, double level, std::vector<ContourSegment>& segments) const {
  constexpr int kCorners[5][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}, {0, 0}};
  std::vector<Pixel> crossings;
  for (int edge = 0; edge < 4; ++edge) {
    const auto& [x0, y0] = kCorners[edge];
    const auto& [x1, y1] = kCorners[edge + 1];
    const double a = at(column + x0, row + y0), b = at(column + x1, row + y1);
    if ((a < level) == (b < level)) continue;
    const double t = (level - a) / (b - a);
    crossings.push_back(
        {(column + x0 + t * (x1 - x0)) * cell_px_ - 0.5, (row + y0 + t * (y1 - y0)) * cell_px_ - 0.5});
  }
  // two crossings, or four at a saddle
  for (std::size_t n = 0; n + 1 < crossings.size(); n += 2)
    segments.push_back({crossings[n], crossings[n + 1]});
}

std::vector<ContourSegment> ValueGrid::contour(double level) const {
  std::vector<ContourSegment> segments;
  for (int row = 0; row < cells_; ++row)
    for (int column = 0; column < cells_; ++column) add_cell(column, row, level, segments);
  return segments;
}

}  // namespace force_arrows

Result<std::string> force_arrows_svg(const Model& model, ForceMethod method,
                                     const ForceArrowsRequest& request, const Progress& progress) {
  PALPATE_CHECK(model.has(method));
  PALPATE_CHECK(request.size_mm > 0 && request.spacing_mm >= 0);
  const GridGeometry& grid = model.labels->geometry();
  if (!marks::contains(grid, request.centre)) return marks::outside_error(grid, request.centre);
  const double spacing_mm = request.spacing_mm > 0 ? request.spacing_mm : request.size_mm / kArrowsPerSide;
  if (const double count = force_arrows::arrows_per_side(request.size_mm, spacing_mm);
      count > kMaxArrowsPerSide) {
    char what[120];
    std::snprintf(what, sizeof what, "%.0f x %.0f arrows, and at most %d x %d can be drawn", count, count,
                  kMaxArrowsPerSide, kMaxArrowsPerSide);
    return Error{ErrorKind::kBadInput, what, "spacing",
                 "increase the distance between arrows, or choose a smaller section"};
  }
  const int side_px = force_arrows::kSection_px;
  const SectionPlane section =
      anatomical_section(request.plane, request.centre, request.size_mm, side_px, side_px);
  auto svg =
      force_arrows::draw({model, model.force_field(method), request.plane, section, spacing_mm}, progress);
  if (progress.stopped()) return Progress::interrupted();
  return svg;
}

Result<void> write_force_arrows(const std::filesystem::path& file, const Model& model, ForceMethod method,
                                const ForceArrowsRequest& request, const Progress& progress) {
  const auto svg = force_arrows_svg(model, method, request, progress);
  if (!svg) return svg.error();
  return write_file(file, *svg);
}

}  // namespace palpate
