#include "palpate/haptics/owners.h"

#include <algorithm>
#include <atomic>
#include <cmath>

namespace palpate {
namespace {

constexpr std::int16_t kNobody = -1, kSeveral = -2;

std::uint64_t next_number() {
  static std::atomic<std::uint64_t> last{0};
  return ++last;
}

std::int16_t joined(std::int16_t a, std::int16_t b) {
  if (a == kNobody || a == b) return b;
  return b == kNobody ? a : kSeveral;
}

// calls body(i, j, k, structure) for every voxel that has a face outside of all structures
template <class Body>
void for_each_outer_voxel(const Bricks<LabelId>& labels, const std::vector<std::int16_t>& structure_of_label,
                          const Body& body) {
  const auto is_out = [&](LabelId label) { return structure_of_label[label] == kNobody; };
  PALPATE_CHECK(is_out(labels.outside()));
  const auto& faces = BrickLayout::kFaces;
  labels.for_each_piece([&](const RowPiece<LabelId>& piece) {
    if (piece.uniform) return;
    for (int i = 0; i < piece.count; ++i) {
      const LabelId* const voxel = piece.voxels + i;
      if (is_out(*voxel)) continue;
      if (std::any_of(faces.begin(), faces.end(), [&](auto face) { return is_out(voxel[face]); }))
        body(piece.i + i, piece.j, piece.k, structure_of_label[*voxel]);
    }
  });
}

}  // namespace

Owners::Owners(const Bricks<LabelId>& labels, const std::vector<std::int16_t>& structure_of_label)
    : number_(next_number()),
      structure_of_label_(structure_of_label),
      spacing_mm_(labels.geometry().spacing_mm),
      reach_mm_(std::max(kReach_mm, 1.5 * spacing_mm_.maxCoeff())),
      X_VoxelPatient_(labels.geometry().X_PatientVoxel().inverse()),
      dims_(labels.geometry().dims) {
  std::size_t count = 1;
  for (std::size_t a = 0; a < 3; ++a) {
    block_[a] = static_cast<int>(std::ceil(reach_mm_ / spacing_mm_[static_cast<int>(a)])) + 1;
    blocks_[a] = (dims_[a] + block_[a] - 1) / block_[a];
    count *= static_cast<std::size_t>(blocks_[a]);
  }

  // counted first, then each to its block
  first_in_block_.assign(count + 1, 0);
  for_each_outer_voxel(labels, structure_of_label, [&](int i, int j, int k, std::int16_t /*structure*/) {
    ++first_in_block_[block_of(i, j, k) + 1];
  });
  for (std::size_t b = 0; b < count; ++b) first_in_block_[b + 1] += first_in_block_[b];
  voxels_.structure.resize(first_in_block_.back());
  for (std::vector<float>& index : voxels_.index) index.resize(first_in_block_.back());
  only_.assign(count, kNobody);
  std::vector<std::uint32_t> next = first_in_block_;
  for_each_outer_voxel(labels, structure_of_label, [&](int i, int j, int k, std::int16_t structure) {
    const std::size_t block = block_of(i, j, k);
    const std::uint32_t n = next[block]++;
    voxels_.structure[n] = structure;
    const std::array<int, 3> index{i, j, k};
    for (std::size_t a = 0; a < 3; ++a) voxels_.index[a][n] = static_cast<float>(index[a]);
    only_[block] = joined(only_[block], structure);
    any_ = structure;
  });
  PALPATE_CHECK(any_ >= 0);
  join_blocks();
}

std::size_t Owners::block_of(int i, int j, int k) const {
  return (static_cast<std::size_t>(k / block_[2]) * static_cast<std::size_t>(blocks_[1]) +
          static_cast<std::size_t>(j / block_[1])) *
             static_cast<std::size_t>(blocks_[0]) +
         static_cast<std::size_t>(i / block_[0]);
}

// each block's structures with those of its neighbours
void Owners::join_blocks() {
  std::size_t stride = 1;
  for (const int length : blocks_) {
    const std::vector<std::int16_t> own = only_;
    for (std::size_t b = 0; b < own.size(); ++b) {
      const auto place = static_cast<int>(b / stride % static_cast<std::size_t>(length));
      if (place > 0) only_[b] = joined(only_[b], own[b - stride]);
      if (place + 1 < length) only_[b] = joined(only_[b], own[b + stride]);
    }
    stride *= static_cast<std::size_t>(length);
  }
}

OwnerShares Owners::at(const Point<Patient>& x) const {
  const Point<Voxel> p = X_VoxelPatient_ * x;
  std::array<int, 3> nearest{}, low{}, high{};
  for (std::size_t a = 0; a < 3; ++a) {
    const double at = p[static_cast<int>(a)], voxels = reach_mm_ / spacing_mm_[static_cast<int>(a)];
    // not finite, or out of everything's reach
    if (!(at + voxels >= 0 && at - voxels <= dims_[a] - 1)) return OwnerShares(any_);
    nearest[a] = std::clamp(static_cast<int>(std::lround(at)), 0, dims_[a] - 1);
    low[a] = std::max(0, static_cast<int>(std::ceil(at - voxels))) / block_[a];
    high[a] = std::min(dims_[a] - 1, static_cast<int>(std::floor(at + voxels))) / block_[a];
  }
  const std::int16_t seen = only_[block_of(nearest[0], nearest[1], nearest[2])];
  if (seen != kSeveral) return OwnerShares(seen == kNobody ? any_ : seen);

  OwnerShares shares;
  std::array<float, 3> place{}, scale{};  // in parts of the reach
  for (std::size_t a = 0; a < 3; ++a) {
    place[a] = static_cast<float>(p[static_cast<int>(a)]);
    scale[a] = static_cast<float>(spacing_mm_[static_cast<int>(a)] / reach_mm_);
  }
  const float *const x_of = voxels_.index[0].data(), *const y_of = voxels_.index[1].data(),
                     *const z_of = voxels_.index[2].data();
  // where the structure that was met last stands: neighbours mostly have the same owner
  std::size_t last = 0;
  const auto add = [&](std::int16_t structure, float part) {
    if (last >= shares.count_ || shares.share_[last].structure != structure) {
      last = 0;
      while (last < shares.count_ && shares.share_[last].structure != structure) ++last;
      // no tissue has more beside one another
      if (last == OwnerShares::kMost) return;
      if (last == shares.count_) shares.share_[shares.count_++] = {structure, 0};
    }
    shares.share_[last].part += static_cast<double>(part);
  };
  const auto add_all = [&](std::uint32_t begin, std::uint32_t end) {
    constexpr std::uint32_t kAtOnce = 64;
    std::array<float, kAtOnce> part;
    for (; begin < end; begin += kAtOnce) {
      const std::uint32_t count = std::min(kAtOnce, end - begin);
      // indices of 32 bits may wrap, and a comparison may trap: of such loops compilers make no vectors
      const float *const xs = x_of + begin, *const ys = y_of + begin, *const zs = z_of + begin;
      for (std::uint32_t n = 0; n < count; ++n) {
        const float dx = (xs[n] - place[0]) * scale[0];
        const float dy = (ys[n] - place[1]) * scale[1];
        const float dz = (zs[n] - place[2]) * scale[2];
        const float left = 1 - (dx * dx + dy * dy + dz * dz);
        // the greater of it and 0, without a comparison
        const float inside = 0.5F * (left + std::abs(left));
        part[n] = inside * inside;
      }
      for (std::uint32_t n = 0; n < count; ++n)
        if (part[n] > 0) add(voxels_.structure[begin + n], part[n]);
    }
  };
  for (int c = low[2]; c <= high[2]; ++c)
    for (int b = low[1]; b <= high[1]; ++b) {
      // blocks of a row follow one another
      const std::size_t row =
          (static_cast<std::size_t>(c) * static_cast<std::size_t>(blocks_[1]) + static_cast<std::size_t>(b)) *
          static_cast<std::size_t>(blocks_[0]);
      add_all(first_in_block_[row + static_cast<std::size_t>(low[0])],
              first_in_block_[row + static_cast<std::size_t>(high[0]) + 1]);
    }
  return shares.count_ > 0 ? in_order(shares) : OwnerShares(any_);
}

OwnerShares Owners::within(const Bricks<LabelId>& labels, const Point<Patient>& x) const {
  const Point<Voxel> p = X_VoxelPatient_ * x;
  std::array<int, 3> first{};
  for (std::size_t a = 0; a < 3; ++a) {
    const double at = p[static_cast<int>(a)];
    if (!(at >= 0 && at <= dims_[a] - 1)) return this->at(x);
    first[a] = std::min(static_cast<int>(at), std::max(0, dims_[a] - 2));
  }
  OwnerShares shares;
  for (int corner = 0; corner < 8; ++corner) {
    std::array<int, 3> voxel{};
    double part = 1;
    for (std::size_t a = 0; a < 3; ++a) {
      const bool next = (corner >> a & 1) != 0;
      voxel[a] = first[a] + (next ? 1 : 0);
      const double beyond = p[static_cast<int>(a)] - first[a];
      part *= next ? beyond : 1 - beyond;
    }
    const std::int16_t structure = structure_of_label_[labels.anywhere(voxel[0], voxel[1], voxel[2])];
    if (structure == kNobody || !(part > 0)) continue;
    std::size_t n = 0;
    while (n < shares.count_ && shares.share_[n].structure != structure) ++n;
    if (n == shares.count_) shares.share_[shares.count_++] = {structure, 0};
    shares.share_[n].part += part;
  }
  return shares.count_ > 0 ? in_order(shares) : at(x);
}

// largest first, and one in all
OwnerShares Owners::in_order(OwnerShares shares) {
  double all = 0;
  for (std::size_t n = 0; n < shares.count_; ++n) all += shares.share_[n].part;
  for (std::size_t n = 0; n < shares.count_; ++n) shares.share_[n].part /= all;
  std::sort(shares.share_.begin(), shares.share_.begin() + static_cast<std::ptrdiff_t>(shares.count_),
            [](const OwnerShare& a, const OwnerShare& b) {
              return a.part > b.part || (a.part == b.part && a.structure < b.structure);
            });
  return shares;
}

}  // namespace palpate
