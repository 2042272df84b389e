#pragma once

#include <memory>
#include <variant>
#include <vector>

#include "palpate/base/force_method.h"
#include "palpate/sampling/sampling.h"
#include "palpate/sampling/sphere_filters.h"
#include "palpate/sampling/stored_normals.h"

/// Common interface of the direct force methods. Each provides a value and a gradient at a point, and
/// F = F_full * value * n with n = -gradient / |gradient|. For the equations see docs/concepts/methods.md.
namespace palpate {

/// Sphere filter over raw labels with levels: a weighted sum of spheres, each over all structures of at least
/// one level, weighted by the difference to the next lower level. Soft tissue on hard tissue then has its own
/// surface, and the force points outward at every depth. Labels are read in place; for a level whose labels
/// are not consecutive numbers a mask of one byte per voxel is made.
///
///     f(x) = sum over levels l_1 < l_2 < ... of (l_k - l_(k-1)) S_k(x),    S_k over labels of level >= l_k
template <class Sphere>
class LevelledSphere {
 public:
  struct Part {
    double weight = 0;
    Sphere sphere;
  };
  explicit LevelledSphere(std::vector<Part> parts) : parts_(std::move(parts)) {}

  /// Value and gradient at a point. sample_literal() evaluates the defining equation without optimisation,
  /// for tests.
  FieldSample sample(const Point<Patient>& x) const;
  FieldSample sample_literal(const Point<Patient>& x) const;
  const std::vector<Part>& parts() const { return parts_; }

 private:
  std::vector<Part> parts_;
};

/// A force method prepared for one volume. Immutable, so threads may share it. A query does not allocate,
/// lock or throw; a point with a NaN or infinite coordinate counts as free space.
class ForceField {
 public:
  using Source = std::variant<std::shared_ptr<const Field>, SplineField, LevelledSphere<GaussianSphere>,
                              LevelledSphere<SmoothSphere>, StoredNormals>;

  /// @param full_force_N  force at value 1
  ForceField(Source source, double full_force_N) : source_(std::move(source)), full_force_N_(full_force_N) {}

  ForceMethod method() const { return static_cast<ForceMethod>(source_.index()); }
  /// Field value, 0 ... 1, and its gradient per mm in the patient frame. A gradient at the level of rounding
  /// errors, as deep inside, is returned as exactly 0, so that no direction is derived from it.
  FieldSample sample(const Point<Patient>& x) const;
  double full_force_N() const { return full_force_N_; }
  const Source& source() const { return source_; }

 private:
  Source source_;
  double full_force_N_;
};

/// Width over which a Gaussian-smoothed field rises from 0 to 1 at its maximum slope, at a flat surface:
/// sigma * sqrt(2 pi), at least the minimum voxel spacing; mm. The surface stiffness is F_full over this
/// width.
double ramp_mm(double sigma_mm, const GridGeometry& grid);

/// The founding force F = F_full * f(x) * n, n = -grad f / |grad f| (MERL c. 1997); N, patient frame. Zero
/// where the gradient vanishes.
Vector<Patient> normal_force(const FieldSample& sample, double full_force_N);

}  // namespace palpate
