#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "palpate/geometry/geometry.h"

/// Generalised winding number of a triangle mesh: 1 inside a closed surface, 0 outside, and fractional near
/// holes. Jacobson, Kavan, Sorkine-Hornung 2013, Robust Inside-Outside Segmentation using Generalized Winding
/// Numbers; fast approximation: Barill, Dickson, Schmidt, Levin, Jacobson 2018, Fast Winding Numbers for
/// Soups and Clouds.
namespace palpate::volume_io {

using MeshPoints = std::span<const Eigen::Vector3d>;
using MeshTriangle = std::array<std::uint32_t, 3>;
using MeshTriangles = std::span<const MeshTriangle>;

/// Signed solid angle of a triangle seen from a point, divided by 4 pi: -0.5 ... 0.5, positive from behind, 0
/// on its plane. Van Oosterom, Strackee 1983.
double winding_of_triangle(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c,
                           const Eigen::Vector3d& from);

/// Exact sum over all triangles: slow, the reference for FastWinding.
double winding_number(MeshPoints points, MeshTriangles triangles, const Eigen::Vector3d& from);

/// Approximation by a tree of triangles. Distant nodes are represented by a dipole at their centre and its
/// first moment (Barill's second-order expansion).
class FastWinding {
 public:
  FastWinding() = default;
  /// Stores no reference to either.
  FastWinding(MeshPoints points, MeshTriangles triangles);

  bool empty() const { return nodes_.empty(); }
  /// Winding number at a point. The error was about 0.002 on the meshes tested.
  double at(const Eigen::Vector3d& from) const;
  /// Upper bound of |at()| within a sphere; summation stops once it reaches `enough`.
  double bound_within(const Eigen::Vector3d& centre, double radius, double enough) const;

 private:
  struct Node {
    Eigen::Vector3d middle = Eigen::Vector3d::Zero();  // area-weighted centroid
    Eigen::Vector3d dipole = Eigen::Vector3d::Zero();  // sum of area times normal
    Eigen::Matrix3d moment = Eigen::Matrix3d::Zero();  // sum of (centroid - middle) area normal^T
    double radius = 0;                                 // radius of a sphere around `middle` that contains all
                                                       // triangles
    double area = 0;
    std::uint32_t first = 0, last = 0;  // range of triangles
    std::uint32_t left = 0, right = 0;  // children; 0: none
  };
  std::uint32_t build(std::vector<std::uint32_t>& order, std::uint32_t first, std::uint32_t last,
                      MeshPoints points, MeshTriangles triangles);

  std::vector<Node> nodes_;
  std::vector<std::array<Eigen::Vector3d, 3>> corners_;
};

}  // namespace palpate::volume_io
