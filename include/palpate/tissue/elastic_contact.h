#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "palpate/tissue/elastic_solver.h"

namespace palpate {

/// A row of J: the mean displacement of a round patch of surface, weighted by the pressure under a sphere,
/// p ~ sqrt(1 - r2 / rho2) (Hertz 1882), into the tissue. The same weights turn a force on the patch into
/// forces of nodes, so that W = J K^-1 J^T is symmetric and force times displacement is work.
class PressurePatch {
 public:
  PressurePatch() = default;
  /// On the plane through `at`; where that is in no cell of tissue, its places are taken down to the first
  /// that is, at most kReach cells.
  /// @param outward   unit, out of the tissue
  /// @param rho_mm    above 0
  PressurePatch(const ElasticGrid& grid, const Point<Patient>& at, const Vector<Patient>& outward,
                double rho_mm);
  /// The same of any places, each with as much of the force: as nodes of a wide contact.
  PressurePatch(const ElasticGrid& grid, std::span<const Point<Patient>> places,
                const Vector<Patient>& outward);
  /// Lies on tissue at all.
  bool touches() const { return modulus_ > 0; }
  /// E / (1 - nu2) of the tissue in the patch's cells, N/mm2, as if they were full.
  double contact_modulus() const { return modulus_; }

  /// Adds the forces of its nodes where `force_N` presses it in.
  void add(double force_N, ElasticField& nodes_N) const;
  /// J u, mm.
  double displacement(const ElasticField& u_mm) const;
  /// How that changes as the patch moves along the surface: (dJ) u, mm per mm, along the surface.
  Vector<Patient> change(const ElasticField& u_mm) const;
  /// What holds the patch where it is, without a pressure of a shape of its own: by each column of nodes
  /// along the axis nearest to `outward`, for each component, the mean of its nodes by what they bear, which
  /// is the displacement of the surface between them. Of columns that bear `part` of what the one does that
  /// bears most, and more. Nodes that the grid holds are in none.
  HeldMeans columns(double part) const;

 private:
  static constexpr double kReach = 2;
  using Weight = HeldMeans::Weight;
  /// @param places  in cells from the box's corner
  void spread(const ElasticGrid& grid, std::span<const Eigen::Vector3d> places);

  std::vector<Weight> weights_;
  std::vector<Weight> along_[3];  ///< of its change along the box's axes
  struct Borne {
    std::uint32_t column, value;  ///< its first component's
    float weight;
  };
  std::vector<Borne> borne_;  ///< by nodes that are not held, of a force of 1; column by column
  std::uint32_t row_ = 0;     ///< from a node's component to its next
  Eigen::Vector3d outward_ = Eigen::Vector3d::UnitZ();
  Eigen::Matrix3d axes_ = Eigen::Matrix3d::Identity();
  double modulus_ = 0;
};

/// What a rigid sphere feels that is pressed straight into soft tissue, without friction.
struct SphereContact {
  double force_N = 0;
  double contact_radius_mm = 0;
  double compliance_mm_per_N = 0;  ///< W of its patch
  Vector<Patient> tangential_N;    ///< F2 / 2 grad W: without it work over a nodule is not conserved
  ElasticSolution solution;        ///< of the last unit load
};

/// The force at a depth: d = F W + F (0.75 / a - 0.6 / rho) / E*, a = (3 F R / 4 E*)^(1/3), rho = max(a, 3
/// h). The grid carries a pressure of radius rho, whose mean depth on a half space is 0.6 F / (rho E*); below
/// that it knows nothing, and the sphere's own contact sinks in by 0.75 F / (a E*) (Johnson 1985, 4.2). Exact
/// on a half space with an exact W. For contacts up to 3/8 of the thickness of what yields.
/// @param unit_mm   displacements under a force of 1 N, from which to go on; the new ones
/// @param load_N    scratch of the layout
SphereContact press_sphere(const ElasticGrid& grid, ElasticSolver& solver, const Point<Patient>& at,
                           const Vector<Patient>& outward, double radius_mm, double depth_mm,
                           ElasticField& unit_mm, ElasticField& load_N, int most_iterations,
                           double tolerance);

/// W of several patches: entry (n, m) is what patch n gives way, mm, under 1 N on patch m.
/// Columns are solved one by one; the worst residual is told.
Eigen::MatrixXd contact_compliance(ElasticSolver& solver, std::span<const PressurePatch> patches,
                                   double tolerance, double* worst_residual = nullptr);

/// Forces of a rigid shape without friction and without adhesion: lambda >= 0, W lambda - depth >= 0, and one
/// of them 0 for each patch.
/// @param compliance  symmetric, positive
/// @param depth_mm    how deep the shape is at each patch in the surface at rest; below 0: above it
Eigen::VectorXd contact_forces(const Eigen::MatrixXd& compliance, const Eigen::VectorXd& depth_mm);

}  // namespace palpate
