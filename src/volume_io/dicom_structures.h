#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/volume/volume.h"
#include "volume_io/dicom_segments.h"

/// The contours of a DICOM structure set (RTSTRUCT) on the grid of the scan that they were drawn on. Plain
/// numbers, as dicom_volumes.h.
namespace palpate::volume_io {

struct DicomStructure {
  DicomSegment segment;  ///< its number counts from 1, in the order of the file; its name and codes
  std::optional<std::array<std::uint8_t, 3>> colour;   ///< ROIDisplayColor
  std::vector<std::vector<Eigen::Vector3d>> contours;  ///< closed, at least 3 points each, LPS mm
  std::size_t left_out = 0;  ///< contours that are open, points or less than a triangle
};

/// One structure in the planes of its contours, in which a voxel is in where its centre is.
///
/// In a plane the contours count by even and odd: one within another is a hole, and so is what a keyhole
/// leads to. Between planes a voxel belongs to the nearest one. The first and the last plane reach as far out
/// as half the usual distance of planes, and so does each of two planes that are farther apart than two
/// missing ones: those are parts of their own. A centre on a contour, as of contours that go from centre to
/// centre, is in.
class StructurePlanes {
 public:
  /// Errors, without `where`: a contour that is not planar, or in another plane than the others.
  static Result<StructurePlanes> make(const DicomStructure& structure, const GridGeometry& grid);

  /// Calls take(i + j * dims[0]) once for each voxel of a slice of the grid that is in.
  void read_slice(int slice, const std::function<void(std::size_t)>& take) const;
  /// How many planes are missing between two that are taken as of one part.
  std::size_t bridged() const { return bridged_; }
  /// Whether a contour goes beyond the grid.
  bool is_cut() const { return cut_; }

 private:
  struct Edge {
    double x0, y0, x1, y1;
  };
  struct Plane {
    double from_mm = 0, to_mm = 0;  // along the normal, the latter not included
    double low_y = 0, high_y = 0;
    std::vector<Edge> edges;
  };
  struct Contour {
    double place_mm = 0;  // along the normal
    const std::vector<Eigen::Vector3d>* points = nullptr;
  };
  Result<void> choose_normal(const DicomStructure& structure);
  void choose_axes();
  std::vector<std::vector<Contour>> in_planes(const DicomStructure& structure) const;
  void lay(const std::vector<std::vector<Contour>>& planes);
  // marks from `first` to before `last` where a line at y is in
  void mark_line(const Plane& plane, double x, double y, int first, int last, std::vector<char>& marks) const;

  GridGeometry grid_;
  Eigen::Vector3d normal_{0, 0, 1};
  int along_ = 0;                              // the axis of the grid that lines go along, 0 or 1
  Eigen::Vector3d x_{1, 0, 0}, y_{0, 1, 0};    // unit, in the planes; lines go along x_
  double step_x_mm_ = 1, step_normal_mm_ = 0;  // from voxel to voxel of a line
  std::vector<Plane> planes_;                  // in their order along the normal
  std::size_t bridged_ = 0;
  bool cut_ = false;
};

}  // namespace palpate::volume_io
