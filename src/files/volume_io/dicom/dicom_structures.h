#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/volume/volume.h"
#include "volume_io/dicom/dicom_segments.h"

/// Rasterises the contours of a DICOM structure set (RTSTRUCT) on the grid of the scan on which they were
/// drawn. Plain data, as dicom_volumes.h.
namespace palpate::volume_io {

struct DicomStructure {
  DicomSegment segment;  ///< Name and codes; numbered from 1 in the order of the file.
  std::optional<std::array<std::uint8_t, 3>> colour;   ///< ROIDisplayColor.
  std::vector<std::vector<Eigen::Vector3d>> contours;  ///< Closed, at least 3 points each, LPS mm.
  std::size_t left_out = 0;  ///< Number of contours dropped because they are open, points or less than a
                             ///< triangle.
};

/// Rasterisation of one structure from the planes of its contours; a voxel is inside if its centre is.
///
/// Within a plane the even-odd rule applies: a contour within another is a hole, and so is the interior of a
/// keyhole contour. Between planes a voxel belongs to the nearest one. The first and the last plane extend
/// outwards by half the usual plane distance, and so does each of two planes with more than two missing
/// planes between them, which are treated as separate parts. A centre on a contour is inside.
class StructurePlanes {
 public:
  /// Prepares the planes. Errors, without `where`: a contour that is not planar, or not parallel to the
  /// others.
  static Result<StructurePlanes> make(const DicomStructure& structure, const GridGeometry& grid);

  /// Calls visit(i + j * dims[0]) once for each voxel of a slice of the grid that is inside.
  void read_slice(int slice, const std::function<void(std::size_t)>& visit) const;
  /// Number of missing planes that were filled from their neighbours.
  std::size_t bridged() const { return bridged_; }
  /// True if a contour extends beyond the grid.
  bool is_cut() const { return cut_; }

 private:
  struct Edge {
    double x0, y0, x1, y1;
  };
  struct Plane {
    double from_mm = 0, to_mm = 0;  // extent along the normal, excluding to_mm
    double low_y = 0, high_y = 0;
    std::vector<Edge> edges;
  };
  struct Contour {
    double position_mm = 0;  // position along the normal
    const std::vector<Eigen::Vector3d>* points = nullptr;
  };
  Result<void> choose_normal(const DicomStructure& structure);
  void choose_axes();
  std::vector<std::vector<Contour>> in_planes(const DicomStructure& structure) const;
  void lay(const std::vector<std::vector<Contour>>& planes);
  // sets marks[first ... last - 1] where the line at y is inside the plane's contours
  void mark_line(const Plane& plane, double x, double y, int first, int last, std::vector<char>& marks) const;

  GridGeometry grid_;
  Eigen::Vector3d normal_{0, 0, 1};
  int along_ = 0;                              // grid axis of the scan lines, 0 or 1
  Eigen::Vector3d x_{1, 0, 0}, y_{0, 1, 0};    // unit vectors in the planes; scan lines run along x_
  double step_x_mm_ = 1, step_normal_mm_ = 0;  // components of the step between two voxels of a scan line
  std::vector<Plane> planes_;                  // ordered along the normal
  std::size_t bridged_ = 0;
  bool cut_ = false;
};

}  // namespace palpate::volume_io
