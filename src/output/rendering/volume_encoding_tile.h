#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

#include "palpate/rendering/volume_renderer.h"
#include "rendering/label_smoothing.h"
#include "rendering/volume_encoding.h"

namespace palpate::internal::volume_picture {

/// Appearance of a voxel that belongs to one structure entirely, and components of mixtures.
struct StructureOptics {
  float opacity = 0;
  float solid = 0;    ///< In units of h / mm
  float surface = 0;  ///< Optical depth
  float haze = 0;     ///< In units of h / mm
  Rgb colour;
};

struct VoxelAppearance {
  float extinction = 0;  ///< In units of h / mm
  float colour[3] = {};
  float covered = 0;  ///< Coverage by structures that are drawn
};

/// A box of voxels, with all data that determine their appearance.
class VolumeEncoding::Tile {
 public:
  /// @param changed       voxels whose appearance differs from the stored blocks
  /// @param renormalised  voxels whose normals may differ; includes `changed`
  Tile(const VolumeEncoding& encoding, const Bricks<LabelId>& labels, const VoxelBox& box,
       const VoxelBox& changed, const VoxelBox& renormalised);
  static std::array<int, 3> margins(const VolumeEncoding& encoding) {
    std::array<int, 3> margin{};
    // central difference of the smoothed values
    for (std::size_t a = 0; a < 3; ++a) margin[a] = static_cast<int>(encoding.kernels_[a].size());
    return margin;
  }

  /// Calls put(rows, i, j, k, block) for every block of either kind of rows that may have changed.
  template <class Put>
  void for_each_block(const Put& put) {
    encode_voxels();
    const std::array<int, 3>& size = box_.size;
    for (int along = 0; along < 2; ++along) {
      const auto a = static_cast<std::size_t>(along), across = 1 - a;
      for (int k = renormalised_[2][0]; k < renormalised_[2][1]; ++k)
        for (int c = renormalised_[across][0]; c < renormalised_[across][1]; ++c) {
          // voxels of the row whose appearance has changed
          const bool is_in = is_changed(across, c) && is_changed(2, k);
          const std::array<int, 2> changed = is_in ? changed_[a] : std::array{0, 0};
          const BlockRows::Row row = encoding_.rows_[a].row(box_.first[across] + c, box_.first[2] + k);
          for (int b = 0; b < size[a]; b += kBlock) {
            const std::array<int, 3> at{box_.first[0] + (along == 0 ? b : c),
                                        box_.first[1] + (along == 0 ? c : b), box_.first[2] + k};
            const int end = std::min(b + kBlock, size[a]), from = std::max(b, changed[0]),
                      to = std::min(end, changed[1]);
            const bool is_whole = from == b && to == end;
            const VoxelBlock* before = is_whole ? nullptr : row[(box_.first[a] + b) / kBlock];
            if (before == nullptr && from >= to) continue;
            const NormalWords normals = normal_words(a, at, std::max(b, renormalised_[a][0]) - b,
                                                     std::min(end, renormalised_[a][1]) - b);
            if (from >= to && normals.are_of(*before)) continue;
            VoxelBlock block{};
            if (before != nullptr) block = *before;
            const std::size_t first_voxel = offset(at[0] - box_.first[0], at[1] - box_.first[1], k),
                              step = along == 0 ? 1 : static_cast<std::size_t>(size[0]);
            for (int n = from; n < to; ++n)
              fill_appearance(block, n - b, first_voxel + static_cast<std::size_t>(n - b) * step);
            normals.write_into(block);
            put(along, at[0], at[1], at[2], block);
          }
        }
    }
  }

 private:
  using Region = std::array<std::array<int, 2>, 3>;  ///< First and end relative to the box's first voxel

  static Region within(const VoxelBox& box, const VoxelBox& part);
  static std::array<int, 3> widened(const Region& region, const std::array<int, 3>& margin) {
    std::array<int, 3> size{};
    for (std::size_t a = 0; a < 3; ++a) size[a] = region[a][1] - region[a][0] + 2 * margin[a];
    return size;
  }
  StructureOptics optics_of(const StructureAppearance& appearance) const;
  const StructureOptics& optics(LabelId label) const { return optics_[label < optics_.size() ? label : 0]; }
  std::size_t offset(int i, int j, int k) const {
    return static_cast<std::size_t>(i) +
           static_cast<std::size_t>(box_.size[0]) *
               (static_cast<std::size_t>(j) +
                static_cast<std::size_t>(box_.size[1]) * static_cast<std::size_t>(k));
  }

  /// Computes appearance and normal of every voxel that may differ.
  void encode_voxels();
  void copy_labels(const Bricks<LabelId>& labels);
  /// @return labels of a row, from `first_label()` on
  const LabelId* label_row(int j, int k) const {
    return labels_.row(j - renormalised_[1][0] + margin_[1], k - renormalised_[2][0] + margin_[2]);
  }
  int first_label() const { return renormalised_[0][0] - margin_[0]; }

  static VoxelAppearance appearance_of_one(const StructureOptics& optics) {
    const Rgb& c = optics.colour;
    return {
        optics.solid + optics.haze, {1.0f * c.r, 1.0f * c.g, 1.0f * c.b}, optics.opacity > 0 ? 1.0f : 0.0f};
  }

  bool is_changed(std::size_t axis, int n) const { return n >= changed_[axis][0] && n < changed_[axis][1]; }
  bool is_all_changed() const {
    for (std::size_t a = 0; a < 3; ++a)
      if (changed_[a] != std::array{0, box_.size[a]}) return false;
    return true;
  }

  void fill_appearances(const VoxelAppearance& appearance);

  /// Marks the voxels with an unchanged appearance that are not empty, as find_normals() needs it.
  void load_unchanged_extinction();

  void find_appearances();

  /// Appearance of a voxel from the 27 voxels around it.
  VoxelAppearance mixture(const LabelId* const* rows, int i) const;

  void add_scan();

  void find_normals();

  void fill_appearance(VoxelBlock& block, int index, std::size_t voxel) const;
  /// Normals of a block as eight-byte words per component, restricted to those that may differ.
  struct NormalWords {
    std::uint64_t differing;  ///< Byte mask
    std::array<std::uint64_t, 3> made;

    static std::uint64_t word(const std::int8_t* bytes) {
      std::uint64_t word;
      static_assert(sizeof word == kBlock);
      std::memcpy(&word, bytes, sizeof word);
      return word;
    }
    bool are_of(const VoxelBlock& block) const {
      std::uint64_t others = 0;
      for (std::size_t a = 0; a < 3; ++a) others |= word(block.normal[a]) ^ made[a];
      return (others & differing) == 0;
    }
    void write_into(VoxelBlock& block) const {
      for (std::size_t a = 0; a < 3; ++a) {
        const std::uint64_t mixed = (word(block.normal[a]) & ~differing) | (made[a] & differing);
        std::memcpy(block.normal[a], &mixed, sizeof mixed);
      }
    }
  };
  /// @param along   axis of the block
  /// @param at      its first voxel
  /// @param first,  end  voxels whose normals may differ
  NormalWords normal_words(std::size_t along, const std::array<int, 3>& at, int first, int end) const;
  /// @param along  0: i fastest, 1: j fastest
  std::size_t normal_offset(std::size_t along, int i, int j, int k) const {
    const int fast = along == 0 ? i : j, slow = along == 0 ? j : i;
    return static_cast<std::size_t>(fast) +
           static_cast<std::size_t>(box_.size[along]) *
               (static_cast<std::size_t>(slow) +
                static_cast<std::size_t>(box_.size[1 - along]) * static_cast<std::size_t>(k));
  }

  const VolumeEncoding& encoding_;
  VoxelBox box_;
  Region changed_, renormalised_;
  std::array<int, 3> margin_;
  Box<LabelId> labels_;
  std::vector<StructureOptics> optics_;  ///< By label
  std::vector<float> opacities_;         ///< By label, and one entry for all labels beyond
  std::vector<VoxelAppearance> appearances_;
  /// Normals in the order of either kind of rows, by component; 0 where nothing is visible.
  std::array<std::array<std::vector<std::int8_t>, 3>, 2> normals_;
};

}  // namespace palpate::internal::volume_picture
