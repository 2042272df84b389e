#pragma once

#include <Eigen/Dense>
#include <array>

#include "palpate/tissue/elastic_grid.h"
#include "tissue/elastic_kernel.h"

/// Reference implementation of tissue/elastic_kernel.h: dense stiffness of every cell, in double.
namespace palpate::testing {

using CellStiffness = Eigen::Matrix<double, 24, 24>;

/// Stiffness of a cube of edge h: one-point integration of B^T D B, plus the hourglass modes. Row index 3 *
/// corner + component; the bits of corner are x, y, z.
inline CellStiffness cell_stiffness(double mu, double lambda, double h,
                                    double hourglass = internal::elastic::kHourglass) {
  const auto sign = [](int corner, int axis) { return (corner >> axis & 1) != 0 ? 1.0 : -1.0; };
  // strains xx, yy, zz, xy, xz, yz (engineering) at the centre
  Eigen::Matrix<double, 6, 24> b = Eigen::Matrix<double, 6, 24>::Zero();
  for (int corner = 0; corner < 8; ++corner) {
    double slope[3];
    for (int a = 0; a < 3; ++a) slope[a] = sign(corner, a) / (4 * h);
    for (int a = 0; a < 3; ++a) b(a, 3 * corner + a) = slope[a];
    const int pairs[3][2] = {{0, 1}, {0, 2}, {1, 2}};
    for (int n = 0; n < 3; ++n) {
      b(3 + n, 3 * corner + pairs[n][0]) = slope[pairs[n][1]];
      b(3 + n, 3 * corner + pairs[n][1]) = slope[pairs[n][0]];
    }
  }
  Eigen::Matrix<double, 6, 6> d = Eigen::Matrix<double, 6, 6>::Zero();
  d.topLeftCorner<3, 3>().setConstant(lambda);
  d.topLeftCorner<3, 3>().diagonal().array() += 2 * mu;
  d.bottomRightCorner<3, 3>().diagonal().setConstant(mu);
  CellStiffness k = h * h * h * b.transpose() * d * b;
  // hourglass modes: products of two and of three signs
  for (const int mode : {3, 5, 6, 7}) {
    for (int c = 0; c < 3; ++c) {
      Eigen::Matrix<double, 24, 1> gamma = Eigen::Matrix<double, 24, 1>::Zero();
      for (int corner = 0; corner < 8; ++corner) {
        double product = 1;
        for (int a = 0; a < 3; ++a)
          if ((mode >> a & 1) != 0) product *= sign(corner, a);
        gamma[3 * corner + c] = product;
      }
      k += hourglass * mu * h / 16 * gamma * gamma.transpose();
    }
  }
  return k;
}

/// Displacements or forces of all nodes in double, three per node, i fastest.
class SlowElastic {
 public:
  explicit SlowElastic(const ElasticGrid& grid) : grid_(grid) {}

  int number(int i, int j, int k) const {
    const auto& n = grid_.layout().cells;
    return (k * (n[1] + 1) + j) * (n[0] + 1) + i;
  }
  int values() const {
    const auto& n = grid_.layout().cells;
    return 3 * (n[0] + 1) * (n[1] + 1) * (n[2] + 1);
  }

  Eigen::VectorXd from(const ElasticField& field) const {
    Eigen::VectorXd all(values());
    for_each_node([&](int i, int j, int k) {
      for (int c = 0; c < 3; ++c)
        all[3 * number(i, j, k) + c] = field.values[grid_.layout().node(i, j, k, c)];
    });
    return all;
  }

  /// K u; held components are 0 unless `include_constrained`.
  Eigen::VectorXd apply(const Eigen::VectorXd& u, bool include_constrained = false) const {
    Eigen::VectorXd force = Eigen::VectorXd::Zero(values());
    const ElasticLayout& layout = grid_.layout();
    for (int k = 0; k < layout.cells[2]; ++k)
      for (int j = 0; j < layout.cells[1]; ++j)
        for (int i = 0; i < layout.cells[0]; ++i) {
          const std::size_t cell = layout.cell(i, j, k);
          const CellStiffness stiffness =
              cell_stiffness(grid_.mu()[cell], grid_.lambda()[cell], grid_.box().cell_mm);
          Eigen::Matrix<double, 24, 1> local;
          const auto node = [&](int corner) {
            return number(i + (corner & 1), j + (corner >> 1 & 1), k + (corner >> 2 & 1));
          };
          for (int corner = 0; corner < 8; ++corner)
            local.segment<3>(3 * corner) = u.segment<3>(3 * node(corner));
          const Eigen::Matrix<double, 24, 1> of_cell = stiffness * local;
          for (int corner = 0; corner < 8; ++corner)
            force.segment<3>(3 * node(corner)) += of_cell.segment<3>(3 * corner);
        }
    for_each_node([&](int i, int j, int k) {
      const int constraint_bits = grid_.constraint(i, j, k);
      for (int c = 0; c < 3; ++c) {
        double& f = force[3 * number(i, j, k) + c];
        f += grid_.springs()[layout.node(i, j, k, c)] * u[3 * number(i, j, k) + c];
        if (!include_constrained &&
            ((constraint_bits >> c & 1) != 0 || (constraint_bits & ElasticGrid::kNoNode) != 0))
          f = 0;
      }
    });
    return force;
  }

  template <class Visit>
  void for_each_node(const Visit& visit) const {
    const auto& n = grid_.layout().cells;
    for (int k = 0; k <= n[2]; ++k)
      for (int j = 0; j <= n[1]; ++j)
        for (int i = 0; i <= n[0]; ++i) visit(i, j, k);
  }

 private:
  const ElasticGrid& grid_;
};

}  // namespace palpate::testing
