#include "palpate/geometry/decompositions.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/SVD>

namespace palpate {
namespace {

template <int kSize>
SymmetricEigen<kSize> eigen_of(const Eigen::Matrix<double, kSize, kSize>& symmetric) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, kSize, kSize>> solver(symmetric);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

}  // namespace

SymmetricEigen<3> symmetric_eigen(const Eigen::Matrix3d& symmetric) {
  return eigen_of<3>(symmetric);
}
SymmetricEigen<6> symmetric_eigen(const Matrix6d& symmetric) {
  return eigen_of<6>(symmetric);
}

SingularVectors singular_vectors(const Eigen::Matrix3d& matrix) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(matrix, Eigen::ComputeFullU | Eigen::ComputeFullV);
  return {svd.matrixU(), svd.matrixV()};
}

Vector6d solve_symmetric(const Matrix6d& symmetric, const Vector6d& right) {
  return symmetric.ldlt().solve(right);
}

Matrix6d inverse_of_symmetric(const Matrix6d& symmetric) {
  const Eigen::LDLT<Matrix6d> factors(symmetric);
  Matrix6d out;
  for (int n = 0; n < 6; ++n) out.col(n) = factors.solve(Vector6d::Unit(n).eval());
  return out;
}

}  // namespace palpate
