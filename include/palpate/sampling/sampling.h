#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <variant>

#include "palpate/volume/bricks.h"
#include "palpate/volume/volume.h"

/// Values and gradients of a prepared field at any point.
///
/// Three kinds of field, one type each, so that a signed distance cannot be taken for a ramp:
///
/// | type        | stored as          | values                           | interpolation             |
/// |-------------|--------------------|----------------------------------|---------------------------|
/// | Field       | uint8, uint16      | 0 ... 1, 0 outside               | trilinear                 |
/// | SignedField | int16              | any: offset + scale * stored     | trilinear                 |
/// | SplineField | int16, float       | any, its own `outside`           | cubic B-spline            |
///
/// A query never fails: outside the volume every field has a value of its own, which it reaches within
/// one voxel, and a point with a coordinate that is NaN or infinite is outside. Nothing is allocated.
///
/// A query for one point gives the same bits on every SIMD target and in every build: multiplications
/// and additions stand in one order and are never fused. Queries for many points do too, in float, and
/// differ from those for one by less than 1e-6 of the field's range of values.
namespace palpate {

namespace internal {

/// What a query needs besides the voxels: the way from a patient point to voxels, and from what is found
/// among stored voxels to a value and a gradient per mm. Columns of four, for vector loads.
struct SamplingMap {
  SamplingMap() : SamplingMap(GridGeometry{}, 1, 0, 0, 0, 1) {}
  /// A stored number s means offset + scale * s. Beyond `reach` voxels outside the outermost centres
  /// every value is `outside`. What a kernel takes for a derivative is `gradient_factor` too small.
  SamplingMap(const GridGeometry& grid, double scale, double offset, double outside, double reach,
              double gradient_factor);

  double voxel_columns[4][4] = {};   ///< voxel = c0 x + c1 y + (c2 z + c3), 4th component 0
  double sample_columns[5][4] = {};  ///< (value, gradient) = c0 g_i + c1 g_j + (c2 g_k + (c3 s + c4))
  double low[4] = {}, high[4] = {};  ///< voxel indices between which there is something to read
  double outside = 0;
  Transform<Voxel, Patient> X_VoxelPatient;
  Eigen::Matrix3d gradient_map;  ///< gradient per voxel -> per mm in the patient frame
};

}  // namespace internal

/// A prepared intensity field: 0 in free space, 1 deep inside the stiffest tissue. Stored as unsigned
/// fractions of full scale in 8 bits (as published) or 16 (finer direction, see docs/concepts/methods.md).
/// Outside the volume the field is 0, reached linearly over one voxel: free space, no jump.
class Field {
 public:
  Field() = default;
  explicit Field(const Volume<std::uint8_t>& volume);
  explicit Field(const Volume<std::uint16_t>& volume);
  /// @param voxels  with 0 around them
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

/// What the numbers of a SignedField mean.
struct SignedSteps {
  double scale = 1;          ///< value of one step; in mm for a distance
  double offset = 0;         ///< value of a stored 0
  std::int16_t outside = 0;  ///< what is stored beyond the volume, in steps
};

/// A field of signed numbers in steps of `scale`: a signed distance in mm, say. Outside the volume it has
/// the value of `steps.outside`, reached linearly over one voxel.
class SignedField {
 public:
  SignedField() = default;
  SignedField(const Volume<std::int16_t>& volume, const SignedSteps& steps);
  /// @param voxels  with steps.outside around them
  SignedField(Bricks<std::int16_t> voxels, const SignedSteps& steps);
  /// The same but for a box of its voxels, which must lie in the grid; what is stored, in steps. Everything
  /// else is shared with this one.
  SignedField with(const PatchOf<std::int16_t>& patch) const;

  const GridGeometry& geometry() const { return voxels_.geometry(); }
  const SignedSteps& steps() const { return steps_; }
  /// Value beyond the volume.
  double outside() const { return map_.outside; }
  const Transform<Voxel, Patient>& X_VoxelPatient() const { return map_.X_VoxelPatient; }
  /// A copy of the voxels as values.
  Volume<float> values() const;

  const Bricks<std::int16_t>& bricks() const { return voxels_; }
  const internal::SamplingMap& map() const { return map_; }

 private:
  SignedSteps steps_;
  Bricks<std::int16_t> voxels_;
  internal::SamplingMap map_;
};

enum class SplineStorage : std::uint8_t {
  kInt16,  ///< coefficients in steps of the largest over 32767
  kFloat,
};

struct SplineOptions {
  SplineStorage storage = SplineStorage::kInt16;
  double outside = 0;  ///< value beyond the volume
  int threads = 0;     ///< of the prefilter; 0: as many as there are cores
};

/// The cubic B-spline that interpolates a volume's voxels: twice continuously differentiable, where the
/// trilinear interpolant's gradient has steps.
///
///     f(x) = outside + sum over the 4 x 4 x 4 voxels around x of c_ijk b(x_0 - i) b(x_1 - j) b(x_2 - k)
///
/// with the cubic B-spline b and its analytic derivative in the gradient (Unser, "Splines: a perfect fit
/// for signal and image processing", IEEE Signal Processing Magazine 16(6), 1999). The coefficients come
/// from a recursive prefilter along every axis (Unser, Aldroubi, Eden, 1993). One voxel beyond the
/// outermost centres the spline reaches `outside`, and stays there: the values minus `outside` are
/// continued oddly about that place, which makes c 0 there and the recursions' start exact.
class SplineField {
 public:
  SplineField() = default;
  /// Values must be finite.
  explicit SplineField(const Volume<float>& values, const SplineOptions& options = {});
  /// Of a field's voxels; `options.outside` gives way to the field's own value outside.
  explicit SplineField(const Field& field, const SplineOptions& options = {});
  explicit SplineField(const SignedField& field, const SplineOptions& options = {});

  const GridGeometry& geometry() const;
  int bytes_per_voxel() const { return coefficients_.index() == 0 ? 2 : 4; }
  /// What one step of a stored coefficient is worth; 1 for float.
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

struct FieldSample {
  double value = 0;          ///< 0 ... 1 of a Field
  Vector<Patient> gradient;  ///< per mm; of a Field it points into the tissue
};

/// Trilinear interpolation of the eight surrounding voxels. x need not be inside the volume.
double sample_value(const Field& field, const Point<Patient>& x);
double sample_value(const SignedField& field, const Point<Patient>& x);

/// The founding method's sample: seven trilinear interpolations, at x and at +-1 voxel along each
/// axis of the grid, and central differences (MERL c. 1997; docs/concepts/methods.md "trilinear").
FieldSample sample_central_differences(const Field& field, const Point<Patient>& x);
FieldSample sample_central_differences(const SignedField& field, const Point<Patient>& x);

/// The same for many points at once; as many samples as points.
void sample_central_differences(const Field& field, std::span<const Point<Patient>> points,
                                std::span<FieldSample> samples);
void sample_central_differences(const SignedField& field, std::span<const Point<Patient>> points,
                                std::span<FieldSample> samples);

/// Value and analytic gradient of the B-spline.
FieldSample sample_spline(const SplineField& field, const Point<Patient>& x);
/// The same for many points, with the same bits; as many samples as points.
void sample_spline(const SplineField& field, std::span<const Point<Patient>> points,
                   std::span<FieldSample> samples);

}  // namespace palpate
