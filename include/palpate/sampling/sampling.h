#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <variant>

#include "palpate/volume/bricks.h"
#include "palpate/volume/volume.h"

/// Interpolation of values and gradients of a prepared field at arbitrary points.
///
/// There are three kinds of field with one type each, so that a signed distance cannot be passed as a ramp:
///
/// | type        | stored as          | values                           | interpolation             |
/// |-------------|--------------------|----------------------------------|---------------------------|
/// | Field       | uint8, uint16      | 0 ... 1, 0 outside               | trilinear                 |
/// | SignedField | int16              | any: offset + scale * stored     | trilinear                 |
/// | SplineField | int16, float       | any, its own `outside`           | cubic B-spline            |
///
/// Queries never fail: each field has a constant value outside the volume, which it approaches within one
/// voxel, and a point with a NaN or infinite coordinate is outside. Queries do not allocate.
///
/// Single-point queries are bit-identical on every SIMD target and in every build: the order of
/// multiplications and additions is fixed, and they are never fused. Batch queries are bit-identical too, but
/// computed in float; they differ from single-point queries by less than 1e-6 of the field's range.
namespace palpate {

namespace internal {

/// Constants of a query besides the voxels: the transform from a patient point to voxel coordinates, and that
/// from a kernel's result on stored numbers to a value and a gradient per mm. Padded to columns of four for
/// vector loads.
struct SamplingMap {
  SamplingMap() : SamplingMap(GridGeometry{}, 1, 0, 0, 0, 1) {}
  /// @param scale, offset    a stored number s has the value offset + scale * s
  /// @param outside          value beyond `reach`
  /// @param reach            distance from the outermost voxel centres, in voxels, within which the kernel
  ///                         has support
  /// @param gradient_factor  factor that turns a kernel's difference into a derivative per voxel
  SamplingMap(const GridGeometry& grid, double scale, double offset, double outside, double reach,
              double gradient_factor);

  double voxel_columns[4][4] = {};   ///< voxel = c0 x + c1 y + (c2 z + c3); 4th component 0
  double sample_columns[5][4] = {};  ///< (value, gradient) = c0 g_i + c1 g_j + (c2 g_k + (c3 s + c4))
  double low[4] = {}, high[4] = {};  ///< Bounds of the voxel coordinates inside which the kernel reads voxels
  /// Value outside these bounds.
  double outside = 0;
  Transform<Voxel, Patient> X_VoxelPatient;
  Eigen::Matrix3d gradient_map;  ///< Maps a gradient per voxel to a gradient per mm in the patient frame
};

}  // namespace internal

/// Prepared scalar field of the direct methods: 0 in free space, 1 deep inside the stiffest tissue. Stored as
/// unsigned fractions of full scale in 8 bits (as published) or 16 bits (more accurate direction, see
/// docs/concepts/methods.md). Outside the volume it decreases linearly to 0 over one voxel, so it is
/// continuous.
class Field {
 public:
  Field() = default;
  explicit Field(const Volume<std::uint8_t>& volume);
  explicit Field(const Volume<std::uint16_t>& volume);
  /// @param voxels  outside value 0
  explicit Field(Bricks<std::uint8_t> voxels);
  explicit Field(Bricks<std::uint16_t> voxels);

  const GridGeometry& geometry() const;
  int bytes_per_voxel() const { return voxels_.index() == 0 ? 1 : 2; }
  const Transform<Voxel, Patient>& X_VoxelPatient() const { return map_.X_VoxelPatient; }
  /// Maps a gradient per voxel to a gradient per mm in the patient frame (inverse transpose).
  const Eigen::Matrix3d& gradient_map() const { return map_.gradient_map; }
  /// A copy of the voxels.
  std::variant<Volume<std::uint8_t>, Volume<std::uint16_t>> storage() const;
  /// A copy of the voxels as values, 0 ... 1.
  Volume<float> values() const;

  const std::variant<Bricks<std::uint8_t>, Bricks<std::uint16_t>>& bricks() const { return voxels_; }
  const internal::SamplingMap& map() const { return map_; }

 private:
  std::variant<Bricks<std::uint8_t>, Bricks<std::uint16_t>> voxels_;
  internal::SamplingMap map_;
};

/// Quantisation of a SignedField.
struct SignedSteps {
  double scale = 1;          ///< Value of one step, e.g. in mm for a distance
  double offset = 0;         ///< Value of a stored 0
  std::int16_t outside = 0;  ///< Stored number outside the volume, in steps
};

/// Field of signed numbers in steps of `scale`, e.g. a signed distance in mm. Outside the volume it
/// approaches the value of `steps.outside` linearly over one voxel.
class SignedField {
 public:
  SignedField() = default;
  SignedField(const Volume<std::int16_t>& volume, const SignedSteps& steps);
  /// @param voxels  outside value steps.outside
  SignedField(Bricks<std::int16_t> voxels, const SignedSteps& steps);
  /// A copy with a box of voxels replaced, which must be inside the grid; everything else is shared.
  /// @param patch  new stored numbers, in steps
  SignedField with(const PatchOf<std::int16_t>& patch) const;

  const GridGeometry& geometry() const { return voxels_.geometry(); }
  const SignedSteps& steps() const { return steps_; }
  /// Value outside the volume.
  double outside() const { return map_.outside; }
  const Transform<Voxel, Patient>& X_VoxelPatient() const { return map_.X_VoxelPatient; }
  /// Copy of the voxels as values.
  Volume<float> values() const;

  const Bricks<std::int16_t>& bricks() const { return voxels_; }
  const internal::SamplingMap& map() const { return map_; }

 private:
  SignedSteps steps_;
  Bricks<std::int16_t> voxels_;
  internal::SamplingMap map_;
};

/// Storage of the coefficients of a SplineField.
enum class SplineStorage : std::uint8_t {
  kInt16,  ///< In steps of the maximum magnitude over 32767
  kFloat,
};

/// Options of the constructor of SplineField.
struct SplineOptions {
  SplineStorage storage = SplineStorage::kInt16;
  double outside = 0;  ///< Value outside the volume
  int threads = 0;     ///< Threads of the prefilter; 0: one per core
};

/// Cubic B-spline that interpolates a volume's voxels. It is twice continuously differentiable, while the
/// gradient of the trilinear interpolant is discontinuous.
///
///     f(x) = outside + sum over the 4 x 4 x 4 voxels around x of c_ijk b(x_0 - i) b(x_1 - j) b(x_2 - k)
///
/// where b is the cubic B-spline, whose analytic derivative gives the gradient (Unser, "Splines: a perfect
/// fit for signal and image processing", IEEE Signal Processing Magazine 16(6), 1999). The coefficients are
/// computed by a recursive prefilter along every axis (Unser, Aldroubi, Eden, 1993). The spline reaches
/// `outside` one voxel beyond the outermost centres and stays there: the values minus `outside` are continued
/// oddly about that point, which makes c 0 there and the start of the recursions exact.
class SplineField {
 public:
  SplineField() = default;
  /// @param values  finite
  explicit SplineField(const Volume<float>& values, const SplineOptions& options = {});
  /// Interpolates a field's voxels; `options.outside` is replaced by the field's own outside value.
  explicit SplineField(const Field& field, const SplineOptions& options = {});
  explicit SplineField(const SignedField& field, const SplineOptions& options = {});

  const GridGeometry& geometry() const;
  int bytes_per_voxel() const { return coefficients_.index() == 0 ? 2 : 4; }
  /// Value of one step of a stored coefficient; 1 for float.
  double scale() const { return scale_; }
  double outside() const { return map_.outside; }
  const Transform<Voxel, Patient>& X_VoxelPatient() const { return map_.X_VoxelPatient; }

  const std::variant<Bricks<std::int16_t>, Bricks<float>>& coefficients() const { return coefficients_; }
  const internal::SamplingMap& map() const { return map_; }

 private:
  double scale_ = 1;
  std::variant<Bricks<std::int16_t>, Bricks<float>> coefficients_;
  internal::SamplingMap map_;
};

/// Value and gradient of a field at a point.
struct FieldSample {
  double value = 0;          ///< 0 ... 1 for a Field
  Vector<Patient> gradient;  ///< Per mm in the patient frame; for a Field it points into the tissue
};

/// Trilinear interpolation between the eight surrounding voxels. x may be outside the volume.
double sample_value(const Field& field, const Point<Patient>& x);
double sample_value(const SignedField& field, const Point<Patient>& x);

/// Sampling of the founding method: seven trilinear interpolations, at x and at +-1 voxel along each axis of
/// the grid, and central differences (MERL c. 1997; docs/concepts/methods.md, "trilinear").
FieldSample sample_central_differences(const Field& field, const Point<Patient>& x);
FieldSample sample_central_differences(const SignedField& field, const Point<Patient>& x);

/// Batch version of sample_central_differences(); `samples` and `points` have the same size.
void sample_central_differences(const Field& field, std::span<const Point<Patient>> points,
                                std::span<FieldSample> samples);
void sample_central_differences(const SignedField& field, std::span<const Point<Patient>> points,
                                std::span<FieldSample> samples);

/// Value and analytic gradient of the B-spline.
FieldSample sample_spline(const SplineField& field, const Point<Patient>& x);
/// Batch version of sample_spline(), bit-identical; `samples` and `points` have the same size.
void sample_spline(const SplineField& field, std::span<const Point<Patient>> points,
                   std::span<FieldSample> samples);

}  // namespace palpate
