#pragma once

#include <optional>
#include <vector>

#include "palpate/rendering/volume_renderer.h"
#include "rendering/volume_simd.h"

/// A view of a grid, factored (Lacroute & Levoy 1994): the rays of a picture, parallel or from one eye, meet
/// each slice of the grid in a lattice along the slice's own axes. So what lies on them is gathered in an
/// intermediate picture, parallel to the slices, line by line along the voxels' rows, and that is then warped
/// into the picture.
namespace palpate::internal::volume_picture {

/// A picture's rays in voxels. Parallel ones start at from + column * from_step + row * from_line and go
/// along `way`, for a mm; those of an eye start at `from` and go to the pixels in the plane through the
/// focus, along way + column * way_step + row * way_line.
struct Rays {
  Rays(const GridGeometry& grid, const VolumeCamera& camera);
  Eigen::Vector3d start(double column, double row) const {
    return from + from_step * column + from_line * row;
  }
  Eigen::Vector3d along(double column, double row) const { return way + way_step * column + way_line * row; }

  bool is_parallel;
  Eigen::Vector3d from, from_step = Eigen::Vector3d::Zero(), from_line = Eigen::Vector3d::Zero();
  Eigen::Vector3d way, way_step = Eigen::Vector3d::Zero(), way_line = Eigen::Vector3d::Zero();
};

/// Pixels of a row of the picture.
struct PixelRun {
  int row, begin, end;
};
/// The pixels whose rays go along an axis of the grid more than along the others, measured in mm. Parallel
/// rays all have one; an eye sees up to three.
struct Region {
  int axis;
  bool is_ascending;  ///< its index grows away from the viewer
  std::vector<PixelRun> runs;
};
std::vector<Region> regions_of(const GridGeometry& grid, const VolumeCamera& camera, const Rays& rays);

/// How a region of the picture is made.
struct Factored {
  /// @param most_apart  samples along a ray, in the grid's shortest spacing
  /// None where none of the region's rays meets the grid.
  static std::optional<Factored> of(const GridGeometry& grid, const VolumeCamera& camera, const Rays& rays,
                                    const Region& region, double most_apart);

  int x, y, z;  ///< axes of the grid: along rows of voxels, across them, between slices
  bool is_ascending;
  int width = 0, height = 0;    ///< of the intermediate picture
  double z_ref;                 ///< it lies in this slice
  double x_ref_0, x_ref_per_u;  ///< and its pixel (u, v) there
  double y_ref_0, y_ref_per_v;
  std::vector<SamplePlane> planes;  ///< front to back
  double z_first, z_step;           ///< where they are

  /// Of a final pixel, (U, V, W) = start + column * step + row * line; it lies at (U, V) / W.
  Eigen::Vector3d warp_start, warp_step, warp_line;
};

}  // namespace palpate::internal::volume_picture
