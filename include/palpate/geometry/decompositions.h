#pragma once

#include <Eigen/Core>

/// Decompositions of small matrices, by Eigen's solvers. They are compiled in one source: wherever a solver's
/// template is named it costs the compiler several seconds. Matrices are taken to be finite.
namespace palpate {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// Of a symmetric matrix: eigenvalues in ascending order, and unit eigenvectors as columns in the same order.
template <int kSize>
struct SymmetricEigen {
  Eigen::Matrix<double, kSize, 1> values;
  Eigen::Matrix<double, kSize, kSize> vectors;
};
/// Only the lower triangle is read.
SymmetricEigen<3> symmetric_eigen(const Eigen::Matrix3d& symmetric);
SymmetricEigen<6> symmetric_eigen(const Matrix6d& symmetric);

/// Singular vectors as columns, largest singular value first: matrix = u * diagonal * v^T.
struct SingularVectors {
  Eigen::Matrix3d u, v;
};
SingularVectors singular_vectors(const Eigen::Matrix3d& matrix);

/// Solution x of symmetric * x = right by LDL^T, for a positive definite matrix of which only the lower
/// triangle is read.
Vector6d solve_symmetric(const Matrix6d& symmetric, const Vector6d& right);

/// Inverse of such a matrix, by LDL^T.
Matrix6d inverse_of_symmetric(const Matrix6d& symmetric);

}  // namespace palpate
