#include "rendering/block_rows.h"

#include <algorithm>
#include <bit>

#include "rendering/volume_terms.h"

namespace palpate::internal::volume_picture {

BlockRows::BlockRows(const GridGeometry& grid, int along)
    : along_(along), across_(1 - along), dims_(grid.dims), blocks_(blocks_along(grid.dims[along])) {
  words_ = (blocks_ + 63) / 64;
  const std::size_t rows =
      static_cast<std::size_t>(dims_[static_cast<std::size_t>(across_)]) * static_cast<std::size_t>(dims_[2]);
  groups_ = (blocks_ + kGroup - 1) / kGroup;
  first_.resize(rows * static_cast<std::size_t>(groups_));
  room_.resize(first_.size());
  mask_.resize(rows * static_cast<std::size_t>(words_));
  // block 0 is empty
  voxels_.resize(1);
}

void BlockRows::put(int i, int j, int k, const VoxelBlock& block) {
  const std::array<int, 3> at{i, j, k};
  const int number = at[static_cast<std::size_t>(along_)] / kBlock;
  const std::size_t row = row_number(at[static_cast<std::size_t>(across_)], k);
  const std::size_t group =
      row * static_cast<std::size_t>(groups_) + static_cast<std::size_t>(number / kGroup);
  std::uint64_t& word = mask_[row * static_cast<std::size_t>(words_) + static_cast<std::size_t>(number / 64)];
  const std::uint64_t bit = std::uint64_t{1} << number % 64,
                      there = word >> (number % 64 / kGroup * kGroup) & 0xff;
  const int count = std::popcount(there), before = std::popcount(there & ((1u << number % kGroup) - 1));
  const bool is_there = (word & bit) != 0;
  const bool is_empty =
      std::all_of(std::begin(block.extinction), std::end(block.extinction), [](auto e) { return e == 0; });
  const auto at_position = [&](int n) { return voxels_.begin() + first_[group] + n; };
  if (is_empty) {
    // capacity is retained, since the block may return
    if (is_there) std::copy(at_position(before + 1), at_position(count), at_position(before));
    word &= ~bit;
    return;
  }
  word |= bit;
  if (!is_there) {
    if (count == room_[group]) make_room(group, count);
    std::copy_backward(at_position(before), at_position(count), at_position(count + 1));
  }
  *at_position(before) = block;
}

void BlockRows::make_room(std::size_t group, int count) {
  const std::size_t end = voxels_.size();
  if (count > 0 && first_[group] + static_cast<std::size_t>(count) == end) {
    // the last group can grow in place, as groups do during the initial encoding
    voxels_.emplace_back();
    ++room_[group];
    return;
  }
  // a group moves at most once, so the wasted space is bounded
  room_[group] = count == 0 ? 1 : kGroup;
  voxels_.resize(end + room_[group]);
  std::copy_n(voxels_.begin() + first_[group], count, voxels_.begin() + static_cast<std::ptrdiff_t>(end));
  first_[group] = static_cast<std::uint32_t>(end);
}

RowsView BlockRows::view(const VolumeCamera& camera, const VolumeLight& light) const {
  const Vector<Patient> into = camera.into(), from_key = -direction_to_key(camera, light);
  RowsView view;
  view.mask = mask_.data();
  view.first = first_.data();
  view.voxels = voxels_.data();
  const auto set = [](const Vector<Patient>& from, float(&to)[3]) {
    to[0] = static_cast<float>(from.x());
    to[1] = static_cast<float>(from.y());
    to[2] = static_cast<float>(from.z());
  };
  set(into, view.light.into);
  set(from_key, view.light.from_key);
  view.light.ambient = static_cast<float>(light.ambient);
  view.light.diffuse = static_cast<float>(light.diffuse);
  view.light.specular = static_cast<float>(light.specular);
  view.light.key = static_cast<float>(light.key);
  view.light.key_facing = static_cast<float>(std::max(0.0, from_key.dot(into)));
  view.blocks = blocks_;
  view.words = words_;
  view.groups = groups_;
  return view;
}

std::size_t BlockRows::bytes() const {
  return first_.size() * (sizeof(first_[0]) + sizeof(room_[0])) + mask_.size() * sizeof(mask_[0]) +
         voxels_.size() * sizeof(VoxelBlock);
}

}  // namespace palpate::internal::volume_picture
