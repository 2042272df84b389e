#pragma once

#include <Eigen/Cholesky>
#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include "palpate/tissue/elastic_layout.h"
#include "tissue/elastic_kernel.h"

namespace palpate::internal::elastic {

/// Dot product of two fields, summed in the same order on every machine.
double dot(const ElasticValues& a, const ElasticValues& b);

/// Stiffness operator K of one grid: cells, springs, and constraints.
class Operator {
 public:
  Operator() = default;
  /// @param mu,lambda   Lame's moduli by cell, N/mm2
  /// @param stiffening  ElasticConstants::stiffening by cell; empty: none
  Operator(const ElasticLayout& layout, double cell_mm, const ElasticValues& mu, const ElasticValues& lambda,
           const ElasticValues& springs, std::vector<std::uint8_t> constraints,
           const ElasticValues& stiffening = {});
  /// Replaces cells of a box and the constraints of their nodes. The result is bit-identical to a new
  /// operator.
  void change(const ElasticValues& mu, const ElasticValues& lambda, const ElasticValues& springs,
              const std::vector<std::uint8_t>& constraints, const CellBox& box,
              const ElasticValues& stiffening = {});
  /// Operator of the same body on cells twice as long: moduli averaged, springs restricted, a node
  /// constrained if any fine node that it interpolates is constrained.
  Operator coarser() const;
  /// Updates this operator, made by coarser(), after a change of the finer one. @returns box of changed cells
  CellBox update(const Operator& finer, const CellBox& changed);
  /// Operator of a sub-box, with nodes on its inner boundary constrained.
  Operator part(const CellBox& box) const;

  const ElasticLayout& layout() const { return layout_; }
  bool can_be_coarser() const { return *std::max_element(layout_.cells.begin(), layout_.cells.end()) > 1; }
  /// force = K displacement, 0 at constrained nodes.
  void apply(const ElasticValues& displacement, ElasticValues& force);
  /// force = K displacement everywhere; at constrained nodes, the reaction.
  void apply_everywhere(const ElasticValues& displacement, ElasticValues& force);
  /// Forces of a neo-Hookean body, or with stiffening of one under Fung's law, and their derivative at
  /// `base`; 0 at constrained nodes.
  /// @returns the least det F of all cells
  float apply_finite_strain(const ElasticValues& displacement, ElasticValues& force);
  void apply_tangent(const ElasticValues& base, const ElasticValues& displacement, ElasticValues& force);
  void apply_finite_strain_everywhere(const ElasticValues& displacement, ElasticValues& force);
  /// 1 / diagonal of K; 0 at constrained nodes.
  const ElasticValues& inverse_diagonal() const { return inverse_diagonal_; }
  bool free(std::size_t value) const { return inverse_diagonal_[value] > 0; }
  std::size_t free_values() const;
  const std::vector<std::uint8_t>& constraints() const { return constraints_; }
  const std::vector<std::pair<std::uint32_t, float>>& springs() const { return springs_; }

 private:
  Cells cells(const std::uint8_t* constraints);
  void apply(const std::uint8_t* constraints, const ElasticValues& displacement, ElasticValues& force);
  void apply_finite_strain(const std::uint8_t* constraints, const ElasticValues& displacement,
                           ElasticValues& force);
  void add_springs(bool include_constrained, const ElasticValues& displacement, ElasticValues& force) const;
  void make_room(const ElasticLayout& layout);
  void average(const Operator& finer, const CellBox& box);
  void find_inverse_diagonal(const CellBox& box);
  void list_springs(const CellBox& box);

  ElasticLayout layout_;
  ElasticValues mu_, lambda_;     ///< Multiplied by h / 16
  ElasticValues stiffening_;      ///< By cell of the finest grid; empty: no cell stiffens
  ElasticValues spring_of_node_;  ///< 0: none
  std::vector<std::pair<std::uint32_t, float>> springs_;
  std::vector<std::uint8_t> constraints_;
  ElasticValues inverse_diagonal_, scratch_, volumes_;
  float cell_mm_ = 0;
};

/// Multigrid V-cycle as a preconditioner: a symmetric positive definite linear map, identical in every call.
/// Smoothed by Chebyshev polynomials of degree 3 in the diagonally scaled K (Adams et al. 2003); the coarsest
/// grid is solved by Cholesky factorisation.
class Multigrid {
 public:
  /// Contains the finest operator only, until prepare() has returned true.
  explicit Multigrid(Operator finest);
  /// Advances the preparation of the levels by one step, which takes less time than one or two cycle()s.
  /// @returns whether the preparation is complete
  bool prepare();

  Operator& finest() { return levels_.front().k; }
  /// Updates the coarser levels after finest() was changed in a box. The eigenvalue bounds of the smoothers
  /// never decrease.
  void update(const CellBox& changed);
  /// z = V r.
  /// @param r  0 at constrained nodes
  void cycle(const ElasticValues& r, ElasticValues& z);

 private:
  struct Level {
    explicit Level(Operator with);
    Operator k;
    double max_eigenvalue = 0;  ///< Upper bound of the eigenvalues of the scaled K
    ElasticValues x, b, residual, step, product;
  };

  /// Power iteration for a level's greatest eigenvalue, whose vector is Level::x.
  struct PowerIteration {
    int iterations = 0;
    double largest = 1;  ///< Lower bound of the eigenvalue; 1 if no value is free
  };
  /// Continues a power iteration. @returns whether it has ended
  static bool advance(Level& level, PowerIteration& power, int iterations);
  static double max_eigenvalue(Level& level);
  void factorize();
  // smooths x, which is 0 if `from_zero`; sets level.residual to b - K x if requested
  void smooth(Level& level, const ElasticValues& b, ElasticValues& x, bool from_zero, bool residual_needed);
  void solve_coarsest(const ElasticValues& b, ElasticValues& x);
  void cycle(std::size_t number, const ElasticValues& b, ElasticValues& x);

  std::vector<Level> levels_;
  // preparation: number of levels whose eigenvalue is known, and the iteration on the next one
  std::size_t bounded_levels_ = 0;
  PowerIteration power_;
  bool is_prepared_ = false;
  std::vector<std::size_t> coarsest_;  ///< Indices of its free values
  Eigen::MatrixXd coarsest_k_;
  Eigen::LLT<Eigen::MatrixXd> factors_;
  Eigen::VectorXd coarsest_x_;
  std::vector<float> row_;  ///< Scratch of restriction and prolongation
};

}  // namespace palpate::internal::elastic
