#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "palpate/geometry/geometry.h"

/// How often a surface winds around a point: 1 inside of a closed one, 0 outside, and between them where it
/// has holes. Jacobson, Kavan, Sorkine-Hornung 2013, Robust Inside-Outside Segmentation using Generalized
/// Winding Numbers; fast: Barill, Dickson, Schmidt, Levin, Jacobson 2018, Fast Winding Numbers for Soups and
/// Clouds.
namespace palpate::volume_io {

using MeshPoints = std::span<const Eigen::Vector3d>;
using MeshTriangle = std::array<std::uint32_t, 3>;
using MeshTriangles = std::span<const MeshTriangle>;

/// The solid angle of a triangle seen from a point, over 4 pi; positive from behind, -0.5 ... 0.5. On its
/// plane 0. Van Oosterom, Strackee 1983.
double winding_of_triangle(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c,
                           const Eigen::Vector3d& from);

/// The sum over all triangles: slow, and what the fast one is tested against.
double winding_number(MeshPoints points, MeshTriangles triangles, const Eigen::Vector3d& from);

/// The same from a tree of triangles, those far away taken together: as a dipole in their middle, with the
/// first moment around it (Barill's expansion of second order).
class FastWinding {
 public:
  FastWinding() = default;
  /// Keeps neither.
  FastWinding(MeshPoints points, MeshTriangles triangles);

  bool empty() const { return nodes_.empty(); }
  /// Off by some 0.002 on whatever meshes it was tested on.
  double at(const Eigen::Vector3d& from) const;
  /// More than |at()| anywhere in a sphere; up to `enough`, where it stops to count.
  double most_within(const Eigen::Vector3d& middle, double radius, double enough) const;

 private:
  struct Node {
    Eigen::Vector3d middle = Eigen::Vector3d::Zero();  // the areas' centroid
    Eigen::Vector3d dipole = Eigen::Vector3d::Zero();  // the sum of area times normal
    Eigen::Matrix3d moment = Eigen::Matrix3d::Zero();  // of (centroid - middle) area normal^T
    double radius = 0;                                 // of all that is in it, around the middle
    double area = 0;
    std::uint32_t first = 0, last = 0;  // of the triangles
    std::uint32_t left = 0, right = 0;  // children; 0: none
  };
  std::uint32_t build(std::vector<std::uint32_t>& order, std::uint32_t first, std::uint32_t last,
                      MeshPoints points, MeshTriangles triangles);

  std::vector<Node> nodes_;
  std::vector<std::array<Eigen::Vector3d, 3>> corners_;
};

}  // namespace palpate::volume_io
