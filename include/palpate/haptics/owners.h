#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "palpate/volume/bricks.h"

/// Whose a place on a surface is that several structures have in common.
namespace palpate {

/// A structure's part of a place, 0 ... 1.
struct OwnerShare {
  int structure = -1;
  double part = 0;
};

/// The shares of a place, largest first; they add up to 1.
class OwnerShares {
 public:
  static constexpr std::size_t kMost = 8;
  OwnerShares() = default;
  /// Of a place that belongs to one structure alone.
  explicit OwnerShares(int structure) : count_(1) { share_[0] = {structure, 1}; }
  std::span<const OwnerShare> all() const { return {share_.data(), count_}; }
  int largest() const { return share_[0].structure; }

 private:
  friend class Owners;
  std::array<OwnerShare, kMost> share_;
  std::size_t count_ = 0;
};

/// To whom places on the outer surface of structures that touch belong: each structure's weight is the sum of
/// (1 - r^2 / R^2)^2 over its voxels that lie at the outside (with a face that is none of theirs), r from
/// voxel centre to the place, within R. Straight across a flat seam a share grows by at most 1.1 / R per mm,
/// so that what is felt has no step where one label ends and the next begins. What lies beneath has no share,
/// however thin the layer. Immutable; a query allocates, locks and throws nothing.
class Owners {
 public:
  /// mm; at least one and a half voxels of the widest spacing, so that a place half a voxel off finds them.
  static constexpr double kReach_mm = 2.6;

  /// @param labels              axes of the grid count as perpendicular; what is around it is none of these
  /// @param structure_of_label  by label, for all that the volume holds; -1: none of these structures. One of
  ///                            them at least has voxels
  Owners(const Bricks<LabelId>& labels, const std::vector<std::int16_t>& structure_of_label);

  /// Of the structures whose voxels lie within reach, at most kMost of them; where there are none, or `x` is
  /// not finite, one of the structures has it all.
  OwnerShares at(const Point<Patient>& x) const;
  /// Of a place that was beneath the outer surface and was laid open: the shares of the structures whose
  /// voxels lie around it, as trilinear interpolation weighs them. Where there are none, as at().
  /// @param labels  those that it was made of
  OwnerShares within(const Bricks<LabelId>& labels, const Point<Patient>& x) const;
  double reach_mm() const { return reach_mm_; }
  /// No other one that was made in this program has it; 1 and above.
  std::uint64_t number() const { return number_; }

 private:
  /// A structure's voxels in a block, from one place of index_ on to where the next run begins.
  struct Run {
    std::uint32_t begin;
    std::int16_t structure;
  };
  // So many voxels are looked at together; what a run lacks to a multiple of that stands far away.
  static constexpr std::size_t kAtOnce = 8;
  static constexpr float kFarAway = 1e9F;

  std::size_t block_of(int i, int j, int k) const;
  template <class Body>
  void each_of_layer(const Bricks<LabelId>& labels, int layer, const Body& body) const;
  template <class Value, class Join>
  void spread(std::vector<Value>& of_block, const Join& join) const;
  double weight_of(std::size_t run, const std::array<float, 3>& place,
                   const std::array<float, 3>& per_reach) const;
  static OwnerShares in_order(OwnerShares shares);

  std::uint64_t number_;
  std::vector<std::int16_t> structure_of_label_;
  Eigen::Vector3d spacing_mm_;
  double reach_mm_;
  Transform<Voxel, Patient> X_VoxelPatient_;
  // A block's edges are at least as long as the reach and half a voxel, so that a place sees its own block
  // and those around it.
  std::array<int, 3> dims_, block_{1, 1, 1}, blocks_{0, 0, 0};
  std::vector<std::uint32_t> first_run_of_block_;  // one more than there are blocks
  std::vector<Run> runs_;                          // block by block; one more, where the last one ends
  std::array<std::vector<float>, 3> index_;        // of the runs' voxels, by axis
  // Most places are far from a seam: the only structure that a place in the block sees, or that there are
  // none or several.
  std::vector<std::int16_t> only_;
  std::int16_t any_ = -1;
};

}  // namespace palpate
