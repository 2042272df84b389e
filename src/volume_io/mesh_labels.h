#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "palpate/volume/volume.h"
#include "volume_io/mesh.h"
#include "volume_io/voxel_runs.h"
#include "volume_io/winding_number.h"

/// A surface on a grid: a voxel is in where the surface winds around its centre by more than a half,
/// in either direction: one whose triangles all run clockwise is taken as well.
namespace palpate::volume_io {

/// A mesh in which equal points are one, and that says where it is open.
///
/// Wherever edges are that triangles do not share in both directions, they form loops, because the border of
/// a surface has none. A fan over each loop, from the middle of its corners, closes the surface: of the
/// closed one the winding number is whole everywhere, and that of the open one is less by what the fans have,
/// of whatever shape they are.
struct ClosedMesh {
  std::vector<Eigen::Vector3d> points;
  std::vector<MeshTriangle> triangles;  ///< those of the mesh, then the fans
  std::size_t own = 0;                  ///< how many are the mesh's
  std::size_t open_edges = 0, loops = 0;
};
ClosedMesh closed_mesh(const TriangleMesh& mesh);

/// The voxels of a mesh, row by row.
///
/// Of the closed mesh: cut by the plane of a slice, which leaves closed polygons, then by the row, which the
/// polygons cross; an entrance counts 1, an exit -1, and so the number of turns is known everywhere. A point
/// on the surface belongs to one side by rule, so that meshes which share a wall share no voxel and leave
/// none. Where a mesh is open, the winding number of its fans, where they can be seen as half of all
/// directions, is taken off (FastWinding); what is in is within the mesh's own box.
/// @param look  called before each row; false: nobody listens any more, and the rest is left out
VoxelRuns voxels_of_mesh(const ClosedMesh& mesh, const GridGeometry& grid, const std::function<bool()>& look);

}  // namespace palpate::volume_io
