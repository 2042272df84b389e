#pragma once

#include <Eigen/Core>

/// Decompositions of small matrices, by Eigen's solvers. They are compiled in a single source file, because
/// each instantiation of a solver template costs several seconds of compile time. Matrices must be finite.
namespace palpate {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// Eigendecomposition of a symmetric matrix: eigenvalues in ascending order, and unit eigenvectors as columns
/// in the same order.
template <int kSize>
struct SymmetricEigen {
  Eigen::Matrix<double, kSize, 1> values;
  Eigen::Matrix<double, kSize, kSize> vectors;
};
/// Eigendecomposition of a symmetric matrix, of which only the lower triangle is read.
SymmetricEigen<3> symmetric_eigen(const Eigen::Matrix3d& symmetric);
SymmetricEigen<6> symmetric_eigen(const Matrix6d& symmetric);

/// Singular vectors as columns, ordered by decreasing singular value: matrix = u * diagonal * v^T.
struct SingularVectors {
  Eigen::Matrix3d u, v;
};
SingularVectors singular_vectors(const Eigen::Matrix3d& matrix);

/// Solution x of symmetric * x = right by LDL^T. The matrix must be positive definite; only its lower
/// triangle is read.
Vector6d solve_symmetric(const Matrix6d& symmetric, const Vector6d& right);

/// Inverse of a positive definite matrix by LDL^T; only its lower triangle is read.
Matrix6d inverse_of_symmetric(const Matrix6d& symmetric);

}  // namespace palpate
