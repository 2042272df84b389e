#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "palpate/volume/volume.h"
#include "volume_io/mesh/mesh.h"
#include "volume_io/mesh/winding_number.h"
#include "volume_io/voxel_runs.h"

/// Rasterises a surface on a grid: a voxel is inside if the absolute winding number of the surface around its
/// centre exceeds 1/2, so a surface with all triangles clockwise is accepted too.
namespace palpate::volume_io {

/// Mesh with equal points merged and its holes closed.
///
/// Edges that are not shared by triangles in both directions form loops, because the boundary of a surface
/// has no boundary. A fan over each loop, from the mean of its corners, closes the surface: the winding
/// number of the closed surface is an integer everywhere, and that of the open surface is smaller by the
/// contribution of the fans, whatever their shape.
struct ClosedMesh {
  std::vector<Eigen::Vector3d> points;
  std::vector<MeshTriangle> triangles;  ///< Triangles of the mesh, then the fans.
  std::size_t mesh_triangles = 0;       ///< Number of triangles of the mesh.
  std::size_t open_edges = 0, loops = 0;
};
ClosedMesh closed_mesh(const TriangleMesh& mesh);

/// Voxels of a mesh, scan line by scan line.
///
/// The closed mesh is intersected with the plane of each slice, which yields closed polygons, and these with
/// each row; an entry counts 1 and an exit -1, which gives the winding number everywhere. A point on the
/// surface is assigned to one side by rule, so that adjacent meshes share no voxel and leave none out. Near
/// holes, the winding number of the fans (FastWinding) is subtracted where it can reach one half; voxels
/// outside the mesh's own bounding box are outside.
/// @param should_continue  called before each row; false: the parent has gone, and the rest is skipped
VoxelRuns voxels_of_mesh(const ClosedMesh& mesh, const GridGeometry& grid,
                         const std::function<bool()>& should_continue);

}  // namespace palpate::volume_io
