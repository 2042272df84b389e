#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "palpate/tissue/elastic_solver.h"

namespace palpate {

/// One row of the contact Jacobian J: the mean displacement into the tissue of a circular patch of surface,
/// weighted by the pressure under a sphere, p ~ sqrt(1 - r2 / rho2) (Hertz 1882). The same weights distribute
/// a force on the patch to the nodes, so that W = J K^-1 J^T is symmetric and force times displacement is
/// work.
class PressurePatch {
 public:
  PressurePatch() = default;
  /// Circular patch on the plane through `at`. Sample points outside all tissue cells are moved inwards to
  /// the first such cell, by at most kMaxDepth_cells.
  /// @param outward  unit, out of the tissue
  /// @param rho_mm   radius, above 0
  PressurePatch(const ElasticGrid& grid, const Point<Patient>& at, const Vector<Patient>& outward,
                double rho_mm);
  /// Patch of arbitrary points with equal shares of the force, for the nodes of a wide contact.
  PressurePatch(const ElasticGrid& grid, std::span<const Point<Patient>> positions,
                const Vector<Patient>& outward);
  /// Whether any part of the patch lies on tissue.
  bool touches() const { return modulus_ > 0; }
  /// Contact modulus E / (1 - nu2) of the tissue in the patch's cells, N/mm2, as if the cells were full.
  double contact_modulus_N_per_mm2() const { return modulus_; }
  /// Mean Poisson's ratio of the patch's cells; 0 unless touches().
  double poissons_ratio() const { return poissons_ratio_; }

  /// Adds the nodal forces of `force_N` pressing on the patch.
  void add(double force_N, ElasticField& nodes_N) const;
  /// Displacement of the patch into the tissue, J u, mm.
  double displacement_mm(const ElasticField& u_mm) const;
  /// Derivative of displacement_mm() when the patch moves along the surface: (dJ) u, mm per mm, tangential.
  Vector<Patient> gradient_along_surface(const ElasticField& u_mm) const;
  /// Constraints that fix the patch without prescribing a pressure distribution: for each column of nodes
  /// along the axis nearest to `outward` and each component, the mean of the column's nodes weighted by their
  /// loads, which is the displacement of the surface between them.
  /// @param min_load_fraction  columns that bear less than this fraction of the most loaded column are left
  ///                           free; nodes constrained by the grid belong to no column
  ConstrainedMeans columns(double min_load_fraction) const;

 private:
  static constexpr double kMaxDepth_cells = 2;
  using Weight = ConstrainedMeans::Weight;
  /// @param positions  in cells from the box's corner
  void spread(const ElasticGrid& grid, std::span<const Eigen::Vector3d> positions);

  std::vector<Weight> weights_;
  std::vector<Weight> along_[3];  ///< Weights of the derivatives along the box's axes
  struct NodeLoad {
    std::uint32_t column, value;  ///< Column of the node, and index of its first component
    float weight;
  };
  std::vector<NodeLoad> node_loads_;  ///< Loads of unconstrained nodes, for a force of 1; column by column
  std::uint32_t row_ = 0;             ///< Stride from a node's component to the next
  Eigen::Vector3d outward_ = Eigen::Vector3d::UnitZ();
  Eigen::Matrix3d axes_ = Eigen::Matrix3d::Identity();
  double modulus_ = 0, poissons_ratio_ = 0;
};

/// Contact of a rigid sphere pressed normally into soft tissue, without friction.
struct SphereContact {
  double force_N = 0;
  double contact_radius_mm = 0;
  double compliance_mm_per_N = 0;  ///< W of its patch
  Vector<Patient> tangential_N;    ///< F2 / 2 grad W; without it, work over a nodule is not conserved
  ElasticSolution solution;        ///< Convergence of the last unit load
};

/// Force of a sphere of radius R at a given depth d: d = F W + F (0.75 / a - 0.6 / rho) / E*, with the
/// contact radius a = (3 F R / 4 E*)^(1/3) and rho = max(a, 3 h), where h is the edge length of a cell. The
/// grid carries a pressure patch of radius rho, whose mean depth on a half space is 0.6 F / (rho E*); details
/// below that size are not resolved, and the sphere's actual contact sinks in by 0.75 F / (a E*) (Johnson
/// 1985, 4.2). Exact on a half space with an exact W. Valid for contact radii up to 3/8 of the thickness of
/// the deformable tissue.
/// @param unit_mm  displacements under a force of 1 N: initial guess, replaced by the solution
/// @param load_N   scratch of the grid's layout
SphereContact press_sphere(const ElasticGrid& grid, ElasticSolver& solver, const Point<Patient>& at,
                           const Vector<Patient>& outward, double radius_mm, double depth_mm,
                           ElasticField& unit_mm, ElasticField& load_N, int max_iterations, double tolerance);

/// Compliance matrix W of several patches: entry (n, m) is the displacement of patch n under 1 N on patch m,
/// mm. Columns are solved one by one.
/// @param worst_residual  receives the largest residual; may be null
Eigen::MatrixXd contact_compliance_mm_per_N(ElasticSolver& solver, std::span<const PressurePatch> patches,
                                            double tolerance, double* worst_residual = nullptr);

/// Contact forces of a rigid shape without friction and adhesion, by the complementarity problem lambda >= 0,
/// W lambda - depth >= 0, lambda (W lambda - depth) = 0 for each patch.
/// @param compliance  W, symmetric positive definite
/// @param depth_mm    depth of the shape below the surface at rest at each patch; negative: above it
Eigen::VectorXd contact_forces(const Eigen::MatrixXd& compliance, const Eigen::VectorXd& depth_mm);

}  // namespace palpate
