#include "preparation/gaussian_slice.h"

#include <algorithm>

namespace palpate::internal {

namespace {

/// Padding of a cache line between the rows of the ring: with power-of-two lengths the rows would otherwise
/// map to the same cache sets.
constexpr std::size_t kRingPadding = 16;

}  // namespace

template <class In>
SliceSmoother<In>::SliceSmoother(const SmoothingInput<In>& input)
    : input_(&input),
      nx_(input.volume->geometry().dims[0]),
      ny_(input.volume->geometry().dims[1]),
      nz_(input.volume->geometry().dims[2]) {
  const auto n = static_cast<std::size_t>(nx_);
  const auto& [ki, kj, kk] = input.kernels;
  line_.resize(n + 2 * static_cast<std::size_t>(ki.radius()));
  line_start_ = line_.data() + ki.radius();
  ring_stride_ = n + kRingPadding;
  ring_.resize((2 * static_cast<std::size_t>(kj.radius()) + 1) * ring_stride_);
  no_input_.resize(n);
  no_ring_.resize(n);
  ring_rows_.assign(ny_ + 2 * static_cast<std::size_t>(kj.radius()), no_ring_.data());
  pairs_k_.reserve(kk.weights.size());
  pairs_j_.reserve(kj.weights.size());
  for (int t = 1; t <= ki.radius(); ++t) {
    pairs_i_.push_back({line_start_ - t, line_start_ + t, ki.weights[t]});
  }
}

template <class In>
bool SliceSmoother<In>::occupied(int j, int k) const {
  return k >= 0 && k < nz_ && input_->occupied[static_cast<std::size_t>(k) * ny_ + j] != 0;
}

template <class In>
const In* SliceSmoother<In>::input_row(int j, int k) const {
  if (!occupied(j, k)) return no_input_.data();
  return input_->volume->voxels().data() + input_->volume->geometry().offset(0, j, k);
}

/// Smooths row j of slice k along k and i into its position in the ring.
template <class In>
void SliceSmoother<In>::fill_ring_row(int j, int k) {
  const auto& [ki, kj, kk] = input_->kernels;

  // along k: rows of adjacent slices; rows outside the grid and empty rows are skipped
  pairs_k_.clear();
  for (int t = 1; t <= kk.radius(); ++t) {
    if (!occupied(j, k - t) && !occupied(j, k + t)) continue;
    pairs_k_.push_back({input_row(j, k - t), input_row(j, k + t), kk.weights[t]});
  }
  const float*& smoothed = ring_rows_[j + kj.radius()];
  if (pairs_k_.empty() && !occupied(j, k)) {
    smoothed = no_ring_.data();
    return;
  }
  sum_rows(WeightedRows<In>{input_row(j, k), kk.weights[0], pairs_k_.data(), pairs_k_.size()}, nx_,
           line_start_);

  // along i
  float* row = ring_.data() + static_cast<std::size_t>(j % (2 * kj.radius() + 1)) * ring_stride_;
  sum_rows(WeightedRows<float>{line_start_, ki.weights[0], pairs_i_.data(), pairs_i_.size()}, nx_, row);
  smoothed = row;
}

/// Along j: output row j from the adjacent rows in the ring.
template <class In>
template <class Out>
void SliceSmoother<In>::write_row(int j, Out* out) {
  const AxisKernel& kernel = input_->kernels[1];
  const float* const* centre = ring_rows_.data() + j + kernel.radius();
  const float* const nothing = no_ring_.data();
  pairs_j_.clear();
  for (int t = 1; t <= kernel.radius(); ++t) {
    if (centre[-t] == nothing && centre[t] == nothing) continue;
    pairs_j_.push_back({centre[-t], centre[t], kernel.weights[t]});
  }
  if (pairs_j_.empty() && *centre == nothing) {
    std::fill_n(out, nx_, Out{0});
    return;
  }
  sum_rows(WeightedRows<float>{*centre, kernel.weights[0], pairs_j_.data(), pairs_j_.size()}, nx_, out);
}

template <class In>
template <class Out>
void SliceSmoother<In>::smooth(int k, Out* out) {
  const int reach = input_->kernels[1].radius();
  for (int j = 0; j < ny_ + reach; ++j) {
    if (j < ny_) fill_ring_row(j, k);
    if (j >= reach) write_row(j - reach, out + static_cast<std::size_t>(j - reach) * nx_);
  }
}

template class SliceSmoother<std::uint8_t>;
template class SliceSmoother<float>;
template void SliceSmoother<std::uint8_t>::smooth(int, std::uint8_t*);
template void SliceSmoother<std::uint8_t>::smooth(int, std::uint16_t*);
template void SliceSmoother<std::uint8_t>::smooth(int, float*);
template void SliceSmoother<float>::smooth(int, float*);

}  // namespace palpate::internal
