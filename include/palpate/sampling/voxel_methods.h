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

/// Force methods without a prepared field: two sphere filters on raw labels, and normals stored with the
/// voxels. Each gives value and gradient at a point (sampling.h). The literal form in double is its
/// definition; the vector form is the one used in a tick. The vector form is bit-identical on every SIMD
/// target and in every build, for a single point and for batches, and does not allocate, lock or throw.
/// Points outside the volume, or with a NaN coordinate, are free space with value 0.
namespace palpate {

/// Range of consecutive labels, both ends included.
struct LabelRange {
  LabelId first = 1, last = 1;
};

/// Set of labels, 8 KB; background (0) is never a member.
class LabelSet {
 public:
  LabelSet() = default;
  LabelSet(std::initializer_list<LabelId> ids) {
    for (const LabelId id : ids) insert(id);
  }
  /// All labels except background.
  static LabelSet all();

  /// Precondition: id is not background.
  void insert(LabelId id);
  void erase(LabelId id) { words_[id / 64] &= ~(std::uint64_t{1} << (id % 64)); }
  bool contains(LabelId id) const { return (words_[id / 64] >> (id % 64) & 1) != 0; }
  /// The set as the minimum number of ranges of consecutive labels, ascending.
  std::vector<LabelRange> ranges() const;

 private:
  std::array<std::uint64_t, 1024> words_{};  ///< Bit set by label id
};

/// Voxels with a label of a set, i.e. the binary input of the sphere filters. Labels are read in place
/// without copy or preparation, so a new version of them (deformed, cut) takes effect at once. A query tests
/// every voxel against each range of labels; for sets of many ranges a mask is faster.
class LabelVoxels {
 public:
  /// @param labels  shared; not null, not empty, outside value background
  /// @param set     members
  LabelVoxels(std::shared_ptr<const Bricks<LabelId>> labels, const LabelSet& set);
  /// A binary mask: separate bricks of one byte per voxel, 1 where the label is a member of the set, else 0.
  static LabelVoxels mask(const Bricks<LabelId>& labels, const LabelSet& set);

  const GridGeometry& geometry() const;
  int bytes_per_voxel() const { return storage_.index() == 0 ? 2 : 1; }
  const Transform<Voxel, Patient>& X_VoxelPatient() const { return X_VoxelPatient_; }
  /// Whether a voxel is a member; false outside the volume.
  bool contains(int i, int j, int k) const;

  using Labels = std::shared_ptr<const Bricks<LabelId>>;
  using Mask = std::shared_ptr<const Bricks<std::uint8_t>>;
  const std::variant<Labels, Mask>& storage() const { return storage_; }
  /// Ranges of voxel values that are members.
  const std::vector<LabelRange>& ranges() const { return ranges_; }

 private:
  LabelVoxels(std::vector<LabelRange> ranges, std::variant<Labels, Mask> storage);

  std::variant<Labels, Mask> storage_;
  std::vector<LabelRange> ranges_;
  Transform<Voxel, Patient> X_VoxelPatient_;
};

/// The founding Gaussian sphere, exactly as published (MERL c. 1997), including its discontinuities:
///
///   I(x) = sum over i, j, k = -2 ... 2 of (2 pi sigma^2)^(-3/2) exp(-d^2 / 2 sigma^2) L([x]+i, [y]+j, [z]+k)
///
/// where x and sigma are in voxels, [.] is the nearest voxel (halves round up), d^2 the squared distance from
/// that voxel to x, and L is 1 in the set and 0 elsewhere. The sum of the weights is not constant (0.97 at
/// sigma 1 at a voxel's centre), and the window jumps by a voxel wherever x crosses a half voxel. The
/// gradient is half the difference of the values one voxel away along each axis of the grid, transformed to
/// mm by the inverse transpose of the voxel matrix.
class GaussianSphere {
 public:
  static constexpr double kMinSigmaVoxels = 0.5, kMaxSigmaVoxels = 2;

  /// Errors: kBadInput if sigma_voxels is outside 0.5 ... 2.
  static Result<GaussianSphere> make(LabelVoxels voxels, double sigma_voxels = 1);

  /// Value and gradient, within 1e-5 of the literal form. The weights are shared by all seven evaluations,
  /// which are whole voxels apart, and factorised as exp(-dx^2) exp(-dy^2) exp(-dz^2), each factor
  /// interpolated linearly in a table over the fraction of x (steps of 1/512 voxel).
  FieldSample sample(const Point<Patient>& x) const;
  /// Batch version; `samples` and `points` have the same size.
  void sample(std::span<const Point<Patient>> points, std::span<FieldSample> samples) const;
  /// The definition: seven evaluations of 125 voxels, with coefficients interpolated linearly in a table over
  /// d^2 (steps of 1/256 voxel^2; relative error below 1e-5 at the smallest sigma).
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

/// The smooth sphere, developed for palpate: the raw labels filtered by a kernel that is twice continuously
/// differentiable and reaches zero, with zero slope and curvature, inside its window:
///
///   f(x) = sum over voxels of  w_i(x) w_j(y) w_k(z) L(i, j, k)
///   w_i(x) = t((i - x) / r) / sum over n of t((n - x) / r)
///
/// where t(u) = (1 - u^2)^3 for |u| < 1 and 0 elsewhere, separable along the grid axes with a radius R in mm
/// (r = R over the spacing). Each axis is normalised by its own sum, so the weights sum to 1 everywhere; the
/// gradient is the exact derivative of that quotient, from the same pass over the voxels.
///
/// R = 3 sigma gives t the second moment sigma^2 of a Gaussian. The maximum slope of a flat surface across a
/// grid axis is then 35/(96 sigma) = 0.365/sigma per mm, compared with 0.399/sigma of a Gaussian, so the rule
/// sigma >= F_full/(K_stable sqrt(2 pi)) holds with margin. No kernel over fewer than four voxels is smooth:
/// along an axis where 3 sigma is less than two voxels the radius is two voxels.
///
/// If all voxels in the window are equal, the value is exactly 0 or 1 and the gradient exactly 0.
class SmoothSphere {
 public:
  static constexpr double kRadiusPerSigma = 3;
  static constexpr double kMinRadiusVoxels = 2, kMaxRadiusVoxels = 64;

  /// Errors: kBadInput if sigma_mm is not above 0, or the radius exceeds 64 voxels along an axis.
  static Result<SmoothSphere> make(LabelVoxels voxels, double sigma_mm);

  /// Value and gradient.
  FieldSample sample(const Point<Patient>& x) const;
  /// Batch version; `samples` and `points` have the same size.
  void sample(std::span<const Point<Patient>> points, std::span<FieldSample> samples) const;
  /// The definition, in double. Within 1e-5 of `sample` for the value, 1e-5 per voxel for the gradient.
  FieldSample sample_literal(const Point<Patient>& x) const;

  const LabelVoxels& voxels() const { return voxels_; }
  /// Kernel radius along i, j, k, in voxels.
  const std::array<double, 3>& radius_voxels() const { return radius_voxels_; }
  /// Standard deviation of a Gaussian with the kernel's second moment, along its narrowest axis; mm.
  double min_sigma_mm() const;

 private:
  SmoothSphere(LabelVoxels voxels, const std::array<double, 3>& radius_voxels);

  LabelVoxels voxels_;
  std::array<double, 3> radius_voxels_;
  std::array<int, 3> count_{};  ///< Window size in voxels along each axis
};

/// Encoding of stored normals. Octahedral: the unit sphere unfolded onto a square (Cigolle et al. 2014, "A
/// Survey of Efficient Representations for Independent Unit Vectors"); of the four codes around a direction
/// the nearest is chosen.
enum class NormalEncoding : std::uint8_t {
  kBytes,         ///< Three signed bytes, one per component, as published
  kOctahedral16,  ///< Two signed bytes
  kOctahedral24,  ///< Two signed 12-bit numbers
};

/// Bytes of an encoded normal.
int normal_bytes(NormalEncoding encoding);

/// Encodes and decodes a unit normal. Returns a unit vector, or zero for zero.
Vector<Patient> stored_normal(const Vector<Patient>& unit_normal, NormalEncoding encoding);

/// The first method of the founding work: every voxel centre stores a magnitude m (1 byte, of 255) and an
/// outward normal n in the patient frame. Between centres, with the distances d in mm to the eight
/// surrounding centres:
///
///   w = 1 / (d + eps),     I = sum(w m) / sum(w),     N = sum(w n) / |sum(w n)|,     eps = 0.001 mm
///
/// Exactly as published, hence with a cusp at every centre and a discontinuity at every face between two
/// cells, where four of the eight centres are replaced. Voxels outside the grid have m = 0 and no normal; a
/// whole voxel outside, the value is 0.
class StoredNormals {
 public:
  static constexpr double kEpsilonMm = 1e-3;

  /// From a ramp: magnitudes are its values rounded to 1/255, normals its central differences at the voxel
  /// centres (0 outside), in the patient frame for any grid. No normal where the ramp is flat.
  static StoredNormals from_ramp(const Volume<std::uint8_t>& ramp, NormalEncoding encoding);
  static StoredNormals from_ramp(const Volume<std::uint16_t>& ramp, NormalEncoding encoding);
  /// From any field, evaluated at every voxel centre; values are clamped to 0 ... 1.
  static StoredNormals from_field(const GridGeometry& grid, NormalEncoding encoding,
                                  const std::function<FieldSample(const Point<Patient>&)>& field);

  /// Value I, and as gradient -N, of length 1, or 0 if there is no normal: the direction of the founding
  /// method, F = F_full I N. It is not the derivative of I.
  FieldSample sample(const Point<Patient>& x) const;
  /// Batch version; `samples` and `points` have the same size.
  void sample(std::span<const Point<Patient>> points, std::span<FieldSample> samples) const;
  /// The definition, in double; within 1e-5 of `sample`.
  FieldSample sample_literal(const Point<Patient>& x) const;

  /// Contents of one voxel: its magnitude 0 ... 1, and minus its normal as gradient.
  FieldSample voxel(int i, int j, int k) const;

  const GridGeometry& geometry() const { return grid_; }
  NormalEncoding encoding() const { return encoding_; }
  int bytes_per_voxel() const { return 1 + normal_bytes(encoding_); }
  /// Number of voxels with a magnitude above 0, which a sparse store would have to hold.
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
  /// Magnitude, then normal, little-endian, per voxel; with a border of one voxel, so that queries need no
  /// bounds checks.
  std::vector<std::uint8_t> bytes_;
};

}  // namespace palpate
