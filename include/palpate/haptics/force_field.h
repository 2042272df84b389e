#pragma once

#include <memory>
#include <variant>
#include <vector>

#include "palpate/base/force_method.h"
#include "palpate/sampling/sampling.h"
#include "palpate/sampling/voxel_methods.h"

/// The force methods behind one interface: whatever they read, each gives a value and a gradient at a point,
/// and F = F_full * value * n with n = -gradient / |gradient|. docs/concepts/methods.md has their equations.
namespace palpate {

/// What a scene says of the methods' own settings.
struct MethodSettings {
  double sphere_sigma_voxels = 1;  ///< of the Gaussian sphere, 0.5 ... 2
  NormalEncoding normals = NormalEncoding::kBytes;
  double coupling_damping_N_s_per_mm = 0;  ///< of the proxy's spring, beside each tissue's stiffness

  friend bool operator==(const MethodSettings&, const MethodSettings&) = default;
};

/// A sphere of weights over raw labels whose structures count differently: a sum of spheres, each over the
/// structures of one level and all harder ones, times what that level adds to the one below. Soft tissue
/// that lies on hard keeps its own surface and still pushes outward all the way down. Labels are read in
/// place; of a level whose labels are not consecutive numbers a mask is made, a byte a voxel.
///
///   f(x) = sum over levels l_1 < l_2 < ... of (l_k - l_(k-1)) S_k(x),    S_k over labels of level >= l_k
template <class Sphere>
class LevelledSphere {
 public:
  struct Part {
    double weight = 0;
    Sphere sphere;
  };
  explicit LevelledSphere(std::vector<Part> parts) : parts_(std::move(parts)) {}

  FieldSample sample(const Point<Patient>& x) const;
  FieldSample sample_literal(const Point<Patient>& x) const;
  const std::vector<Part>& parts() const { return parts_; }

 private:
  std::vector<Part> parts_;
};

/// One method with what it reads, prepared for one volume. Immutable, so that threads may share it. A query
/// allocates, locks and throws nothing; a point with a coordinate that is NaN or infinite is free space.
class ForceField {
 public:
  using Source = std::variant<std::shared_ptr<const Field>, SplineField, LevelledSphere<GaussianSphere>,
                              LevelledSphere<SmoothSphere>, StoredNormals>;

  /// @param full_force_N  where the value is 1
  ForceField(Source source, double full_force_N) : source_(std::move(source)), full_force_N_(full_force_N) {}

  ForceMethod method() const { return static_cast<ForceMethod>(source_.index()); }
  /// Value 0 ... 1, gradient per mm in the patient frame; exactly 0 where it is no more than rounding, as
  /// deep inside, so that no direction is made of it.
  FieldSample sample(const Point<Patient>& x) const;
  double full_force_N() const { return full_force_N_; }
  const Source& source() const { return source_; }

 private:
  Source source_;
  double full_force_N_;
};

/// mm over which a field smoothed with a Gaussian climbs from 0 to 1 at its steepest, at a flat surface:
/// sigma * sqrt(2 pi), and never less than the narrowest voxel. The stiffness there is F_full over this.
double ramp_mm(double sigma_mm, const GridGeometry& grid);

/// The founding force F = F_full * f(x) * n, n = -grad f / |grad f| (MERL c. 1997). Zero where the gradient
/// vanishes. N, patient frame.
Vector<Patient> normal_force(const FieldSample& sample, double full_force_N);

}  // namespace palpate
