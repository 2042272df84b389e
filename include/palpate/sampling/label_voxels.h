#pragma once

#include <array>
#include <cstdint>
#include <initializer_list>
#include <memory>
#include <variant>
#include <vector>

#include "palpate/volume/bricks.h"
#include "palpate/volume/volume.h"

/// Sets of labels, and the voxels that have a label of a set.
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

}  // namespace palpate
