#pragma once

#include <optional>
#include <vector>

#include "palpate/rendering/volume_renderer.h"
#include "rendering/volume_simd.h"

/// Shear-warp factorisation of a view of a grid (Lacroute & Levoy 1994): the rays of a picture, parallel or
/// from one eye, intersect each slice of the grid in a lattice along the slice's own axes. They are therefore
/// accumulated in an intermediate picture parallel to the slices, line by line along the voxel rows, which is
/// then warped to the final picture.
namespace palpate::internal::volume_picture {

/// Rays of a picture in voxel coordinates. Parallel rays start at from + column * from_step + row * from_line
/// with direction `direction`, per mm; perspective rays start at `from` and pass through the pixels in the
/// plane through the focus, along direction + column * ray_step + row * ray_line.
struct Rays {
  Rays(const GridGeometry& grid, const VolumeCamera& camera);
  Eigen::Vector3d start(double column, double row) const {
    return from + from_step * column + from_line * row;
  }
  Eigen::Vector3d along(double column, double row) const {
    return direction + ray_step * column + ray_line * row;
  }

  bool is_parallel;
  Eigen::Vector3d from, from_step = Eigen::Vector3d::Zero(), from_line = Eigen::Vector3d::Zero();
  Eigen::Vector3d direction, ray_step = Eigen::Vector3d::Zero(), ray_line = Eigen::Vector3d::Zero();
};

/// Range of pixels in a row of the picture.
struct PixelRun {
  int row, begin, end;
};
/// Pixels whose rays have the same principal axis of the grid, measured in mm. Parallel rays all have one;
/// perspective rays have up to three.
struct Region {
  int axis;
  bool is_ascending;  ///< Whether the index along the axis grows away from the viewer
  std::vector<PixelRun> runs;
};
std::vector<Region> regions_of(const GridGeometry& grid, const VolumeCamera& camera, const Rays& rays);

/// Factorisation of the view for one region of the picture.
struct ShearWarp {
  /// Factorisation for the rays of `region`; nullopt if none of them intersects the grid.
  /// @param max_apart  maximum sample distance along a ray, in units of the grid's shortest spacing
  static std::optional<ShearWarp> for_region(const GridGeometry& grid, const VolumeCamera& camera,
                                             const Rays& rays, const Region& region, double max_apart);

  int x, y, z;  ///< Axes of the grid: along voxel rows, across them, between slices
  bool is_ascending;
  int width = 0, height = 0;    ///< Size of the intermediate picture
  double z_ref;                 ///< Slice in which the intermediate picture lies
  double x_ref_0, x_ref_per_u;  ///< Mapping of its pixels (u, v) to voxels of that slice
  double y_ref_0, y_ref_per_v;
  std::vector<SamplePlane> planes;  ///< Front to back
  double z_first, z_step;           ///< Slice positions of the planes

  /// Warp of a final pixel: (U, V, W) = start + column * step + row * line; intermediate position (U, V) / W.
  Eigen::Vector3d warp_start, warp_step, warp_line;
};

}  // namespace palpate::internal::volume_picture
