#include "lint/voxel_bits.h"

#include <algorithm>
#include <cmath>

namespace palpate::internal {

VoxelBits::VoxelBits(const std::array<int, 3>& dims)
    : dims_(dims),
      words_per_row_((static_cast<std::size_t>(dims[0]) + 63) / 64),
      words_(words_per_row_ * static_cast<std::size_t>(dims[1]) * static_cast<std::size_t>(dims[2])) {}

void VoxelBits::set_run(int first, int last, int j, int k) {
  std::uint64_t* words = row(j, k);
  for (int w = first >> 6; w <= last >> 6; ++w) {
    std::uint64_t mask = ~std::uint64_t{0};
    if (w == first >> 6) mask &= ~std::uint64_t{0} << (first & 63);
    if (w == last >> 6) mask &= ~std::uint64_t{0} >> (63 - (last & 63));
    words[w] |= mask;
  }
}

bool VoxelBits::any(int first, int last, int j, int k) const {
  const std::uint64_t* words = row(j, k);
  for (int w = first >> 6; w <= last >> 6; ++w) {
    std::uint64_t mask = ~std::uint64_t{0};
    if (w == first >> 6) mask &= ~std::uint64_t{0} << (first & 63);
    if (w == last >> 6) mask &= ~std::uint64_t{0} >> (63 - (last & 63));
    if ((words[w] & mask) != 0) return true;
  }
  return false;
}

bool VoxelBits::empty() const {
  return std::ranges::all_of(words_, [](std::uint64_t word) { return word == 0; });
}

void VoxelBits::clear_beyond() {
  if (dims_[0] % 64 == 0) return;
  const std::uint64_t mask = ~std::uint64_t{0} >> (64 - dims_[0] % 64);
  for (std::size_t w = words_per_row_ - 1; w < words_.size(); w += words_per_row_) words_[w] &= mask;
}

void VoxelBits::invert() {
  for (std::uint64_t& word : words_) word = ~word;
  clear_beyond();
}

Result<VoxelBits> VoxelBits::dilated(double radius_mm, const Eigen::Vector3d& spacing_mm, int workers,
                                     const Progress& progress, const ProgressSpan& span) const {
  // rows of the ball: half-length along i, in voxels, at each offset along j and k
  constexpr double kRounding_mm = 1e-9;
  struct BallRow {
    int j, k;
    std::size_t reach;
  };
  std::vector<BallRow> ball;
  std::size_t largest = 0;
  const int rj = std::min(dims_[1] - 1, static_cast<int>((radius_mm + kRounding_mm) / spacing_mm[1]));
  const int rk = std::min(dims_[2] - 1, static_cast<int>((radius_mm + kRounding_mm) / spacing_mm[2]));
  for (int k = -rk; k <= rk; ++k)
    for (int j = -rj; j <= rj; ++j) {
      const double left = radius_mm * radius_mm - std::pow(j * spacing_mm[1], 2) -
                          std::pow(k * spacing_mm[2], 2) + kRounding_mm;
      if (left < 0) continue;
      const auto reach = std::min(static_cast<std::size_t>(dims_[0] - 1),
                                  static_cast<std::size_t>(std::sqrt(left) / spacing_mm[0]));
      ball.push_back({j, k, reach});
      largest = std::max(largest, reach);
    }
  // the set dilated along i by each half-length
  std::vector<VoxelBits> along{*this};
  for (std::size_t reach = 1; reach <= largest; ++reach) {
    if (progress.stopped()) return Progress::interrupted();
    const VoxelBits& before = along.back();
    VoxelBits next(dims_);
    for (std::size_t first = 0; first < words_.size(); first += words_per_row_)
      for (std::size_t w = 0; w < words_per_row_; ++w) {
        const std::uint64_t word = before.words_[first + w];
        std::uint64_t grown = word | word << 1 | word >> 1;
        if (w > 0) grown |= before.words_[first + w - 1] >> 63;
        if (w + 1 < words_per_row_) grown |= before.words_[first + w + 1] << 63;
        next.words_[first + w] = grown;
      }
    next.clear_beyond();
    along.push_back(std::move(next));
  }
  VoxelBits out(dims_);
  const auto done = for_each_slice(dims_[2], workers, progress, span, [&](int, int k) {
    for (const BallRow& at : ball) {
      const int from_k = k + at.k;
      if (from_k < 0 || from_k >= dims_[2]) continue;
      for (int j = std::max(0, -at.j); j < std::min(dims_[1], dims_[1] - at.j); ++j) {
        const std::uint64_t* from = along[at.reach].row(j + at.j, from_k);
        std::uint64_t* to = out.row(j, k);
        for (std::size_t w = 0; w < words_per_row_; ++w) to[w] |= from[w];
      }
    }
  });
  if (!done) return done.error();
  return out;
}

RunVolume VoxelBits::runs() const {
  RunVolume runs(dims_);
  const std::vector<LabelId> values(static_cast<std::size_t>(dims_[0]));
  std::vector<std::uint8_t> mask(values.size());
  for (int k = 0; k < dims_[2]; ++k)
    for (int j = 0; j < dims_[1]; ++j) {
      for (int i = 0; i < dims_[0]; ++i) mask[static_cast<std::size_t>(i)] = at(i, j, k);
      runs.append_row(k, values.data(), mask.data());
    }
  return runs;
}

}  // namespace palpate::internal
