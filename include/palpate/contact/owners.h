#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "palpate/volume/bricks.h"

/// Ownership of points on a surface that several structures share.
namespace palpate {

/// Ownership share of a structure at a point, 0 ... 1.
struct OwnerFraction {
  int structure = -1;
  double fraction = 0;
};

/// Ownership shares at a point, largest first; their sum is 1.
class OwnerFractions {
 public:
  /// Maximum number of structures at a point; further ones are ignored.
  static constexpr std::size_t kCapacity = 8;
  OwnerFractions() = default;
  /// A point owned by one structure alone.
  explicit OwnerFractions(int structure) : count_(1) { fraction_[0] = {structure, 1}; }
  std::span<const OwnerFraction> all() const { return {fraction_.data(), count_}; }
  int largest() const { return fraction_[0].structure; }

 private:
  friend class Owners;
  std::array<OwnerFraction, kCapacity> fraction_;
  std::size_t count_ = 0;
};

/// Ownership of points on the common surface of touching structures. A structure's weight is the sum of
/// (1 - r^2 / R^2)^2 over its outer voxels (those with a face to a voxel of none of the structures) within R,
/// where r is the distance from the voxel's centre. Across a flat seam a share changes by at most 1.1 / R per
/// mm, so that contact properties are continuous from one label to the next. Structures beneath the surface
/// have no share, however thin the layer above them. Immutable; a query does not allocate, lock or throw.
class Owners {
 public:
  /// Radius R, mm. At least 1.5 voxels of the largest spacing are used, so that a point half a voxel off the
  /// surface finds outer voxels.
  static constexpr double kReach_mm = 2.6;

  /// @param labels              grid axes are treated as perpendicular; voxels outside the grid belong to
  ///                            none of the structures
  /// @param structure_of_label  structure of every label in the volume; -1: none. At least one structure must
  ///                            have voxels
  Owners(const Bricks<LabelId>& labels, const std::vector<std::int16_t>& structure_of_label);

  /// Shares of the structures with outer voxels within R, at most kCapacity. If there are none, or `x` is not
  /// finite, a single structure has share 1.
  OwnerFractions at(const Point<Patient>& x) const;
  /// Shares at a point below the original surface that was exposed by removal: trilinear interpolation of the
  /// structures of the surrounding voxels. As at() if there are none.
  /// @param labels  labels of which the surface was made
  OwnerFractions within(const Bricks<LabelId>& labels, const Point<Patient>& x) const;
  double reach_mm() const { return reach_mm_; }
  /// Identifies this object among all made in this process; at least 1.
  std::uint64_t id() const { return id_; }

 private:
  /// Voxels of one structure in a block: from `begin` in index_ to the begin of the next run.
  struct Run {
    std::uint32_t begin;
    std::int16_t structure;
  };
  // SIMD width in voxels; runs are padded to a multiple of it with points far away.
  static constexpr std::size_t kAtOnce = 8;
  static constexpr float kFarAway = 1e9F;

  std::size_t block_of(int i, int j, int k) const;
  template <class Body>
  void each_of_layer(const Bricks<LabelId>& labels, int layer, const Body& body) const;
  template <class Value, class Join>
  void spread(std::vector<Value>& of_block, const Join& join) const;
  double weight_of(std::size_t run, const std::array<float, 3>& point,
                   const std::array<float, 3>& per_reach) const;
  static OwnerFractions in_order(OwnerFractions fractions);

  std::uint64_t id_;
  std::vector<std::int16_t> structure_of_label_;
  Eigen::Vector3d spacing_mm_;
  double reach_mm_;
  Transform<Voxel, Patient> X_VoxelPatient_;
  // Block edges are at least the radius plus half a voxel, so that only a point's own block and its
  // neighbours can contribute.
  std::array<int, 3> dims_, block_{1, 1, 1}, blocks_{0, 0, 0};
  std::vector<std::uint32_t> first_run_of_block_;  // one more than there are blocks
  std::vector<Run> runs_;                          // ordered by block, with a sentinel at the end
  std::array<std::vector<float>, 3> index_;        // voxel indices of the runs, by axis
  // Shortcut, since most points are far from a seam: the only structure within reach of a block, or a mark
  // for none or several.
  std::vector<std::int16_t> single_structure_;
  std::int16_t first_structure_ = -1;
};

}  // namespace palpate
