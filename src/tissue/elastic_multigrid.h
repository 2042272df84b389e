#pragma once

#include <Eigen/Cholesky>
#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include "palpate/tissue/elastic_grid.h"
#include "tissue/elastic_kernel.h"

namespace palpate::internal::elastic {

/// a . b over a layout's values, summed in one order whatever the machine.
double dot(const ElasticValues& a, const ElasticValues& b);

/// K of one grid: its cells, its springs, what is held.
class Operator {
 public:
  Operator() = default;
  /// @param mu,lambda  N/mm2, by cell
  Operator(const ElasticLayout& layout, double cell_mm, const ElasticValues& mu, const ElasticValues& lambda,
           const ElasticValues& springs, std::vector<std::uint8_t> held);
  /// Cells of a box, and whatever holds its nodes, are others now; the rest is as it was. The same bits as if
  /// it were made anew.
  void change(const ElasticValues& mu, const ElasticValues& lambda, const ElasticValues& springs,
              const std::vector<std::uint8_t>& held, const CellBox& box);
  /// The same body with cells twice as long: moduli averaged, springs shared out, a node held where any is
  /// that it moves with.
  Operator coarser() const;
  /// Where a finer one was changed, this one, which was made of it, follows. @returns where it has changed
  CellBox follow(const Operator& finer, const CellBox& changed);
  /// Some of its cells alone, held all around by what the others are.
  Operator part(const CellBox& box) const;

  const ElasticLayout& layout() const { return layout_; }
  bool can_be_coarser() const { return *std::max_element(layout_.cells.begin(), layout_.cells.end()) > 1; }
  /// force = K displacement, 0 where nodes are held.
  void apply(const ElasticValues& displacement, ElasticValues& force);
  /// Where nodes are held, too: what holds them gives that force.
  void apply_everywhere(const ElasticValues& displacement, ElasticValues& force);
  /// Forces of a neo-Hookean body and its least det F, and how they change from `base` on; 0 where nodes are
  /// held.
  float apply_finite(const ElasticValues& displacement, ElasticValues& force);
  void apply_tangent(const ElasticValues& base, const ElasticValues& displacement, ElasticValues& force);
  void apply_finite_everywhere(const ElasticValues& displacement, ElasticValues& force);
  /// 1 / the diagonal of K; 0 where nodes are held.
  const ElasticValues& inverse_diagonal() const { return inverse_diagonal_; }
  bool free(std::size_t value) const { return inverse_diagonal_[value] > 0; }
  std::size_t free_values() const;
  const std::vector<std::uint8_t>& held() const { return held_; }
  const std::vector<std::pair<std::uint32_t, float>>& springs() const { return springs_; }

 private:
  Cells cells(const std::uint8_t* held);
  void apply(const std::uint8_t* held, const ElasticValues& displacement, ElasticValues& force);
  void add_springs(bool held_too, const ElasticValues& displacement, ElasticValues& force) const;
  void make_room(const ElasticLayout& layout);
  void average(const Operator& finer, const CellBox& box);
  void find_inverse_diagonal(const CellBox& box);
  void list_springs(const CellBox& box);

  ElasticLayout layout_;
  ElasticValues mu_, lambda_;     ///< times h / 16
  ElasticValues spring_of_node_;  ///< 0: none
  std::vector<std::pair<std::uint32_t, float>> springs_;
  std::vector<std::uint8_t> held_;
  ElasticValues inverse_diagonal_, scratch_, volumes_;
  float cell_mm_ = 0;
};

/// A V-cycle as a preconditioner: symmetric and positive, the same linear map each time. Smoothed by
/// Chebyshev's polynomial of degree 3 in K scaled by its diagonal (Adams et al. 2003), on the coarsest grid
/// solved by Cholesky's factors.
class Multigrid {
 public:
  explicit Multigrid(Operator finest);

  Operator& finest() { return levels_.front().k; }
  /// After finest() was changed in a box: the coarser ones follow. The bounds of the smoothers never fall by
  /// it.
  void follow(const CellBox& changed);
  /// z = V r. @param r  0 where nodes are held
  void cycle(const ElasticValues& r, ElasticValues& z);

 private:
  struct Level {
    explicit Level(Operator with);
    Operator k;
    double most = 0;  ///< no eigenvalue of the scaled K is above it
    ElasticValues x, b, residual, step, product;
  };

  static double greatest_eigenvalue(Level& level);
  void factorize();
  // x, which is 0 if `from_zero`, by the polynomial; level.residual is b - K x where that is asked for
  void smooth(Level& level, const ElasticValues& b, ElasticValues& x, bool from_zero, bool want_residual);
  void solve_coarsest(const ElasticValues& b, ElasticValues& x);
  void cycle(std::size_t number, const ElasticValues& b, ElasticValues& x);

  std::vector<Level> levels_;
  std::vector<std::size_t> coarsest_;  ///< its free values
  Eigen::MatrixXd coarsest_k_;
  Eigen::LLT<Eigen::MatrixXd> factors_;
  Eigen::VectorXd coarsest_x_;
  std::vector<float> row_;  ///< scratch of between()
};

}  // namespace palpate::internal::elastic
