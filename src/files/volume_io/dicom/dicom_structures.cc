#include "volume_io/dicom/dicom_structures.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include "volume_io/dicom/dicom_segment_names.h"
#include "volume_io/voxel_source.h"

namespace palpate::volume_io {
namespace {

using Vector3 = Eigen::Vector3d;
using Points = std::vector<Vector3>;

constexpr const char* kLoadInSlicer =
    "load it with its images in 3D Slicer (extension SlicerRT) and save the segmentation as .seg.nrrd";

Vector3 slice_normal(const GridGeometry& grid) {
  return Vector3(grid.direction.col(0)).cross(Vector3(grid.direction.col(1))).normalized();
}

// tolerance for rounding, and for points of one plane; mm
double flat_mm(const GridGeometry& grid) {
  constexpr double kRounding_mm = 0.02, kOfSlice = 0.05;
  return std::max(kRounding_mm, kOfSlice * grid.spacing_mm[2]);
}

// area vector along the normal (Newell's method)
Vector3 area_of(const Points& points) {
  Vector3 sum = Vector3::Zero();
  for (std::size_t n = 0; n < points.size(); ++n)
    sum += (points[n] - points[0]).cross(points[(n + 1) % points.size()] - points[0]);
  return 0.5 * sum;
}

double mean_along(const Points& points, const Vector3& normal) {
  double sum = 0;
  for (const Vector3& point : points) sum += point.dot(normal);
  return sum / static_cast<double>(points.size());
}

// largest distance of a contour's points from its mean plane; mm
double max_off(const Points& points, const Vector3& normal) {
  const double mean = mean_along(points, normal);
  double largest = 0;
  for (const Vector3& point : points) largest = std::max(largest, std::abs(point.dot(normal) - mean));
  return largest;
}

// Typical plane distance. A distance that occurs only once may separate two parts of the structure, and is
// not trusted if it exceeds the slice distance.
double usual_gap(const std::vector<double>& gaps, double slice_mm) {
  if (gaps.empty()) return slice_mm;
  std::vector<double> sorted = gaps;
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>((sorted.size() - 1) / 2);
  std::nth_element(sorted.begin(), middle, sorted.end());
  const double usual = *middle;
  constexpr double kSame = 0.1;
  constexpr std::ptrdiff_t kBelieved = 2;
  const auto alike =
      std::ranges::count_if(gaps, [&](double gap) { return std::abs(gap - usual) <= kSame * usual; });
  return alike >= kBelieved ? usual : std::min(usual, slice_mm);
}

std::string mm_in_words(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.2f", value);
  return text;
}

}  // namespace

Result<StructurePlanes> StructurePlanes::make(const DicomStructure& structure, const GridGeometry& grid) {
  StructurePlanes planes;
  planes.grid_ = grid;
  if (auto chosen = planes.choose_normal(structure); !chosen) return chosen.error();
  planes.choose_axes();
  planes.lay(planes.in_planes(structure));
  const auto X_VoxelPatient = grid.X_PatientVoxel().inverse();
  for (const Points& points : structure.contours)
    for (const Vector3& point : points) {
      const Vector3 voxel = (X_VoxelPatient * Point<Patient>(point)).eigen();
      for (int a = 0; a < 3; ++a)
        planes.cut_ = planes.cut_ || voxel[a] < -1 || voxel[a] > grid.dims[static_cast<std::size_t>(a)];
    }
  return planes;
}

// the normal of the scan's slices if all contours are parallel to them, otherwise that of the contours
Result<void> StructurePlanes::choose_normal(const DicomStructure& structure) {
  const double allowed_mm = flat_mm(grid_);
  const auto first_off = [&] {
    return std::ranges::find_if(structure.contours,
                                [&](const Points& points) { return max_off(points, normal_) > allowed_mm; });
  };
  normal_ = slice_normal(grid_);
  if (first_off() == structure.contours.end()) return {};
  Vector3 sum = Vector3::Zero();
  for (const Points& points : structure.contours) {
    const Vector3 area = area_of(points);
    sum += area.dot(sum) < 0 ? Vector3(-area) : area;
  }
  if (sum.norm() > 0) normal_ = sum.normalized();
  const auto off = first_off();
  if (off == structure.contours.end()) return {};
  return bad_input("",
                   "contour " + std::to_string(off - structure.contours.begin() + 1) + " of " +
                       name_of_segment(structure.segment) +
                       " is not planar, or not parallel to the others: its points are up to " +
                       mm_in_words(max_off(*off, normal_)) + " mm off",
                   kLoadInSlicer);
}

void StructurePlanes::choose_axes() {
  // slice axis with the smaller component out of the planes, at most 45 degrees
  const auto out = [&](int axis) { return std::abs(normal_.dot(Vector3(grid_.direction.col(axis)))); };
  along_ = out(0) <= out(1) ? 0 : 1;
  const Vector3 line = grid_.direction.col(along_);
  x_ = (line - line.dot(normal_) * normal_).normalized();
  y_ = normal_.cross(x_);
  step_x_mm_ = grid_.spacing_mm[along_] * line.dot(x_);
  step_normal_mm_ = grid_.spacing_mm[along_] * line.dot(normal_);
  // ignore rounding in the last digits of an orientation
  constexpr double kStraight = 1e-9;
  if (std::abs(step_normal_mm_) < kStraight * step_x_mm_) step_normal_mm_ = 0;
}

std::vector<std::vector<StructurePlanes::Contour>> StructurePlanes::in_planes(
    const DicomStructure& structure) const {
  std::vector<Contour> contours;
  for (const Points& points : structure.contours) contours.push_back({mean_along(points, normal_), &points});
  std::ranges::stable_sort(contours, {}, &Contour::position_mm);
  std::vector<std::vector<Contour>> planes;
  for (const Contour& contour : contours) {
    if (planes.empty() || contour.position_mm - planes.back().front().position_mm > flat_mm(grid_))
      planes.emplace_back();
    // a duplicate would be its own hole
    const auto same = [&](const Contour& other) { return *other.points == *contour.points; };
    if (std::ranges::none_of(planes.back(), same)) planes.back().push_back(contour);
  }
  return planes;
}

void StructurePlanes::lay(const std::vector<std::vector<Contour>>& planes) {
  std::vector<double> coordinates, gaps;
  for (const auto& plane : planes) {
    double sum = 0;
    for (const Contour& contour : plane) sum += contour.position_mm;
    coordinates.push_back(sum / static_cast<double>(plane.size()));
    if (coordinates.size() > 1) gaps.push_back(coordinates.back() - coordinates[coordinates.size() - 2]);
  }
  // Planes that are not parallel to the slices use the smallest spacing. In a sheared grid (tilted gantry)
  // slices are closer together than their centres.
  const double slice_mm = normal_ == slice_normal(grid_)
                              ? grid_.spacing_mm[2] * std::abs(Vector3(grid_.direction.col(2)).dot(normal_))
                              : grid_.spacing_mm.minCoeff();
  const double usual_mm = usual_gap(gaps, slice_mm);
  // plane gaps, in units of the typical one: above the first, planes are missing; up to the second, they are
  // filled
  constexpr double kNoneMissing = 1.5, kBridged = 3.5;
  const auto joined = [&](std::size_t gap) { return gap < gaps.size() && gaps[gap] <= kBridged * usual_mm; };
  planes_.reserve(planes.size());
  for (std::size_t n = 0; n < planes.size(); ++n) {
    // adjacent joined planes share their boundary exactly
    const double from_mm = n > 0 && joined(n - 1) ? planes_.back().to_mm : coordinates[n] - usual_mm / 2;
    Plane& laid = planes_.emplace_back();
    laid.from_mm = from_mm;
    laid.to_mm = coordinates[n] + (joined(n) ? gaps[n] : usual_mm) / 2;
    if (joined(n) && gaps[n] > kNoneMissing * usual_mm)
      bridged_ += static_cast<std::size_t>(std::lround(gaps[n] / usual_mm)) - 1;
    for (const Contour& contour : planes[n]) {
      const Points& points = *contour.points;
      for (std::size_t p = 0; p < points.size(); ++p) {
        const Vector3 &a = points[p], &b = points[(p + 1) % points.size()];
        laid.edges.push_back({a.dot(x_), a.dot(y_), b.dot(x_), b.dot(y_)});
      }
    }
    const auto [low, high] = std::ranges::minmax_element(laid.edges, {}, &Edge::y0);
    laid.low_y = low->y0;
    laid.high_y = high->y0;
  }
}

void StructurePlanes::mark_line(const Plane& plane, double x, double y, int first, int last,
                                std::vector<char>& marks) const {
  // tolerance for a centre on a contour, in voxels
  constexpr double kOn = 5e-3;
  const double on_mm = kOn * step_x_mm_;
  if (first >= last || y < plane.low_y - on_mm || y > plane.high_y + on_mm) return;
  std::vector<double> crossings;
  const auto mark_at = [&](double height) {
    crossings.clear();
    for (const Edge& edge : plane.edges)
      if ((edge.y0 <= height) != (edge.y1 <= height))
        crossings.push_back(edge.x0 + (height - edge.y0) / (edge.y1 - edge.y0) * (edge.x1 - edge.x0));
    std::ranges::sort(crossings);
    for (std::size_t n = 0; n + 1 < crossings.size(); n += 2) {
      const double from = std::ceil((crossings[n] - x) / step_x_mm_ - kOn),
                   to = std::floor((crossings[n + 1] - x) / step_x_mm_ + kOn);
      for (double at = std::max<double>(from, first); at <= std::min<double>(to, last - 1); ++at)
        marks[static_cast<std::size_t>(at)] = 1;
    }
  };
  // if a corner or an edge lies on the scan line, both sides of the line count
  const bool touched =
      std::ranges::any_of(plane.edges, [&](const Edge& edge) { return std::abs(edge.y0 - y) <= on_mm; });
  mark_at(y);
  if (!touched) return;
  mark_at(y - 2 * on_mm);
  mark_at(y + 2 * on_mm);
}

void StructurePlanes::read_slice(int slice, const std::function<void(std::size_t)>& visit) const {
  const int other = 1 - along_, count = grid_.dims[static_cast<std::size_t>(along_)],
            lines = grid_.dims[static_cast<std::size_t>(other)];
  const auto X = grid_.X_PatientVoxel();
  std::vector<char> marks(static_cast<std::size_t>(count));
  for (int line = 0; line < lines; ++line) {
    const Vector3 begin =
        (X * (along_ == 0 ? Point<Voxel>(0, line, slice) : Point<Voxel>(line, 0, slice))).eigen();
    const double x = begin.dot(x_), y = begin.dot(y_), coordinate = begin.dot(normal_);
    const double reach = coordinate + (count - 1) * step_normal_mm_, low = std::min(coordinate, reach),
                 high = std::max(coordinate, reach);
    bool any = false;
    // first plane whose upper end exceeds `low`
    auto plane = std::ranges::upper_bound(planes_, low, {}, &Plane::to_mm);
    for (; plane != planes_.end() && plane->from_mm <= high; ++plane) {
      int first = 0, last = count;
      if (step_normal_mm_ != 0) {
        // first voxel at or beyond a boundary
        const auto begins = [&](double boundary) {
          const double at = std::ceil((boundary - coordinate) / step_normal_mm_);
          return static_cast<int>(std::clamp<double>(at, 0, count));
        };
        first = begins(step_normal_mm_ > 0 ? plane->from_mm : plane->to_mm);
        last = begins(step_normal_mm_ > 0 ? plane->to_mm : plane->from_mm);
      }
      mark_line(*plane, x, y, first, last, marks);
      any = true;
    }
    if (!any) continue;
    const auto stride = along_ == 0 ? std::size_t{1} : static_cast<std::size_t>(grid_.dims[0]);
    const std::size_t start =
        static_cast<std::size_t>(line) * (along_ == 0 ? static_cast<std::size_t>(grid_.dims[0]) : 1);
    for (std::size_t n = 0; n < marks.size(); ++n)
      if (std::exchange(marks[n], 0)) visit(start + n * stride);
  }
}

}  // namespace palpate::volume_io
