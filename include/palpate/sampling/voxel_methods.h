#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <initializer_list>
#include <memory>
#include <span>
#include <variant>
#include <vector>

#include "palpate/sampling/sampling.h"
#include "palpate/volume/bricks.h"
#include "palpate/volume/volume.h"

/// The force methods that need no prepared field: two spheres of weights on raw labels, and normals stored
/// with the voxels. Each gives value and gradient at a point (sampling.h), has a literal form in double
/// that is its definition, and a vector form that gives the same for one point or many. The vector form's
/// results are the same bit for bit on every SIMD target and build type, and for one point or many; it
/// allocates nothing, locks nothing and throws nothing, as a tick demands. The literal form is no part of a
/// tick. What lies outside the volume is free space: value 0. So is a point with a coordinate that is NaN.
namespace palpate {

/// A run of consecutive labels, both ends included.
struct LabelRange {
  LabelId first = 1, last = 1;
};

/// A set of labels; background (0) is never a member. 8 KB.
class LabelSet {
 public:
  LabelSet() = default;
  LabelSet(std::initializer_list<LabelId> ids) {
    for (const LabelId id : ids) insert(id);
  }
  /// Every label but background.
  static LabelSet all();

  /// Inserting background is a bug.
  void insert(LabelId id);
  void erase(LabelId id) { words_[id / 64] &= ~(std::uint64_t{1} << (id % 64)); }
  bool contains(LabelId id) const { return (words_[id / 64] >> (id % 64) & 1) != 0; }
  /// The set as runs of consecutive labels, ascending; as few as there are.
  std::vector<LabelRange> ranges() const;

 private:
  std::array<std::uint64_t, 1024> words_{};  ///< bit id of the table: id is a member
};

/// The voxels that carry a label of a set: what the spheres feel. Labels are read in place, nothing is copied
/// and nothing prepared, so that a new version of them (deformed, cut) is felt at once. A query tests a
/// voxel against every run of consecutive labels in the set; for a set of many runs, a mask is faster.
class LabelVoxels {
 public:
  /// Reads `labels` (not null, not empty, background outside): shared with whoever else reads them.
  LabelVoxels(std::shared_ptr<const Bricks<LabelId>> labels, const LabelSet& set);
  /// Bricks of their own of one byte a voxel, 1 where `labels` hold a member of the set, else 0.
  static LabelVoxels mask(const Bricks<LabelId>& labels, const LabelSet& set);

  const GridGeometry& geometry() const;
  int bytes_per_voxel() const { return storage_.index() == 0 ? 2 : 1; }
  const Transform<Voxel, Patient>& X_VoxelPatient() const { return X_VoxelPatient_; }
  /// False outside the volume.
  bool contains(int i, int j, int k) const;

  using Labels = std::shared_ptr<const Bricks<LabelId>>;
  using Mask = std::shared_ptr<const Bricks<std::uint8_t>>;
  const std::variant<Labels, Mask>& storage() const { return storage_; }
  /// The runs of voxel values that are members.
  const std::vector<LabelRange>& ranges() const { return ranges_; }

 private:
  LabelVoxels(std::vector<LabelRange> ranges, std::variant<Labels, Mask> storage);

  std::variant<Labels, Mask> storage_;
  std::vector<LabelRange> ranges_;
  Transform<Voxel, Patient> X_VoxelPatient_;
};

/// The founding Gaussian sphere, exactly as published (MERL c. 1997), choppiness included:
///
///   I(x) = sum over i, j, k = -2 ... 2 of (2 pi sigma^2)^(-3/2) exp(-d^2 / 2 sigma^2) L([x]+i, [y]+j, [z]+k)
///
/// with x and sigma in voxels, [.] the nearest voxel (halves go up), d^2 the squared distance from that voxel
/// to x, L 1 in the set and 0 elsewhere. The weights' sum is not constant (0.97 at sigma 1 and a voxel's
/// centre), and the window jumps by a voxel wherever x crosses a half voxel. The gradient is half the
/// difference of the values one voxel away along each axis of the grid, taken to millimetres by the inverse
/// transpose of the voxel matrix.
class GaussianSphere {
 public:
  static constexpr double kMinSigmaVoxels = 0.5, kMaxSigmaVoxels = 2;

  /// Error kBadInput where sigma_voxels lies outside 0.5 ... 2.
  static Result<GaussianSphere> make(LabelVoxels voxels, double sigma_voxels = 1);

  /// The weights once for all seven evaluations, because a whole voxel lies between them; the product form
  /// exp(-dx^2) exp(-dy^2) exp(-dz^2), each factor by linear interpolation in a table over the fraction of x
  /// (steps of 1/512 voxel). Within 1e-5 of the literal form.
  FieldSample sample(const Point<Patient>& x) const;
  /// As many samples as points.
  void sample(std::span<const Point<Patient>> points, std::span<FieldSample> samples) const;
  /// The definition: seven evaluations of 125 voxels, coefficients by linear interpolation in a table over
  /// d^2 (steps of 1/256 voxel^2: within 1e-5 of the exponential, relatively, at the smallest sigma).
  FieldSample sample_literal(const Point<Patient>& x) const;

  const LabelVoxels& voxels() const { return voxels_; }
  double sigma_voxels() const { return sigma_voxels_; }

 private:
  GaussianSphere(LabelVoxels voxels, double sigma_voxels);

  LabelVoxels voxels_;
  double sigma_voxels_;
  std::vector<double> over_squared_distance_;
  std::vector<float> over_fraction_;
};

/// The smooth sphere: ours. The raw labels seen through a kernel that is twice continuously differentiable
/// and reaches zero, with zero slope and curvature, inside its window:
///
///   f(x) = sum over voxels of  w_i(x) w_j(y) w_k(z) L(i, j, k)
///   w_i(x) = t((i - x) / r) / sum over n of t((n - x) / r)
///
/// with t(u) = (1 - u^2)^3 for |u| < 1 and else 0, separable along the axes of the grid with its radius R in
/// millimetres (r = R over the spacing). Each axis is divided by its own sum, so that the weights sum to 1
/// everywhere; the gradient is the exact derivative of that quotient, from the same pass over the voxels.
///
/// R = 3 sigma gives t the second moment sigma^2 of a Gaussian. The steepest slope of a flat surface across a
/// grid axis is then 35/(96 sigma) = 0.365/sigma per mm, a Gaussian's 0.399/sigma: the rule sigma >=
/// F_full/(K_stable sqrt(2 pi)) holds with room to spare. Over fewer than four voxels no kernel is smooth:
/// along an axis where 3 sigma is less than two voxels, the radius is two voxels.
///
/// Where all voxels within reach are equal the value is exactly 0 or 1 and the gradient exactly 0.
class SmoothSphere {
 public:
  static constexpr double kRadiusPerSigma = 3;
  static constexpr double kMinRadiusVoxels = 2, kMaxRadiusVoxels = 64;

  /// Error kBadInput where sigma_mm is not above 0, or reaches more than 64 voxels along an axis.
  static Result<SmoothSphere> make(LabelVoxels voxels, double sigma_mm);

  FieldSample sample(const Point<Patient>& x) const;
  /// As many samples as points.
  void sample(std::span<const Point<Patient>> points, std::span<FieldSample> samples) const;
  /// The definition, in double. Within 1e-5 of `sample` for the value, 1e-5 per voxel for the gradient.
  FieldSample sample_literal(const Point<Patient>& x) const;

  const LabelVoxels& voxels() const { return voxels_; }
  /// Along i, j, k.
  const std::array<double, 3>& radius_voxels() const { return radius_voxels_; }
  /// Of the Gaussian with the kernel's second moment, along the axis where it is narrowest.
  double least_sigma_mm() const;

 private:
  SmoothSphere(LabelVoxels voxels, const std::array<double, 3>& radius_voxels);

  LabelVoxels voxels_;
  std::array<double, 3> radius_voxels_;
  std::array<int, 3> count_{};  ///< voxels that can lie within the radius
};

/// How a voxel keeps its normal. Octahedral: the unit sphere unfolded onto a square (Cigolle et al. 2014, "A
/// Survey of Efficient Representations for Independent Unit Vectors"), of the four codes around a
/// direction the nearest one.
enum class NormalEncoding : std::uint8_t {
  kBytes,         ///< three signed bytes, one a component, as published
  kOctahedral16,  ///< two signed bytes
  kOctahedral24,  ///< two signed numbers of 12 bits
};

/// Bytes of a voxel's normal.
int normal_bytes(NormalEncoding encoding);

/// What becomes of a unit normal that is stored and read again; a unit vector, or zero for zero.
Vector<Patient> stored_normal(const Vector<Patient>& unit_normal, NormalEncoding encoding);

/// The founding work's first method: every voxel centre holds a magnitude m (1 byte, of 255) and an outward
/// normal n in the patient frame. Between centres, with d the distances in mm to the eight centres around x:
///
///   w = 1 / (d + eps),     I = sum(w m) / sum(w),     N = sum(w n) / |sum(w n)|,     eps = 0.001 mm
///
/// Exactly as published, hence with a cusp at every centre and a step at every face between two cells, where
/// four centres at finite distance give way to four others. Outside the grid stand voxels with m = 0 and
/// no normal; a whole voxel outside, the value is 0.
class StoredNormals {
 public:
  static constexpr double kEpsilonMm = 1e-3;

  /// From a ramp: magnitudes are its values to the nearest of 255, normals its central differences at the
  /// voxel centres (0 outside), in the patient frame whatever the grid. No normal where the ramp is flat.
  static StoredNormals from_ramp(const Volume<std::uint8_t>& ramp, NormalEncoding encoding);
  static StoredNormals from_ramp(const Volume<std::uint16_t>& ramp, NormalEncoding encoding);
  /// From any field, asked at every voxel centre; values are held to 0 ... 1.
  static StoredNormals from_field(const GridGeometry& grid, NormalEncoding encoding,
                                  const std::function<FieldSample(const Point<Patient>&)>& field);

  /// The value I, and as gradient -N, of length 1, or 0 where there is no normal: the direction of the
  /// founding method, F = F_full I N. It is no derivative of I.
  FieldSample sample(const Point<Patient>& x) const;
  /// As many samples as points.
  void sample(std::span<const Point<Patient>> points, std::span<FieldSample> samples) const;
  /// The definition, in double. Within 1e-5 of `sample`.
  FieldSample sample_literal(const Point<Patient>& x) const;

  /// What one voxel holds: its magnitude 0 ... 1, and minus its normal as gradient.
  FieldSample voxel(int i, int j, int k) const;

  const GridGeometry& geometry() const { return grid_; }
  NormalEncoding encoding() const { return encoding_; }
  int bytes_per_voxel() const { return 1 + normal_bytes(encoding_); }
  /// Voxels with a magnitude above 0: what a sparse store would have to hold.
  std::size_t occupied_voxels() const { return occupied_voxels_; }

 private:
  StoredNormals(const GridGeometry& grid, NormalEncoding encoding);
  template <class T>
  static StoredNormals from_ramp_of(const Volume<T>& ramp, NormalEncoding encoding);
  void set_voxel(int i, int j, int k, double value, const Eigen::Vector3d& gradient);
  std::size_t byte_offset(int i, int j, int k) const;

  GridGeometry grid_;
  NormalEncoding encoding_;
  Transform<Voxel, Patient> X_VoxelPatient_;
  std::size_t occupied_voxels_ = 0;
  /// magnitude, then normal, little-endian; one voxel of border all around, so that a query meets no edge
  std::vector<std::uint8_t> bytes_;
};

}  // namespace palpate
