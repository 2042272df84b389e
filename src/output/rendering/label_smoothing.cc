#include "rendering/label_smoothing.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "palpate/volume/gaussian_rows.h"
#include "rendering/volume_terms.h"

namespace palpate::internal::volume_picture {

namespace {

/// Rows of values, with a flag for rows known to be constant.
struct KnownRows {
  explicit KnownRows(const std::array<int, 3>& size)
      : values(size), is_constant(static_cast<std::size_t>(size[1]) * static_cast<std::size_t>(size[2])) {}
  char& constant(int j, int k) { return is_constant[row_number(j, k)]; }
  /// Whether rows j - reach * dj ... j + reach * dj are constant, and correspondingly along k.
  bool are_constant(int j, int k, int dj, int dk, int reach) const {
    for (int t = -reach; t <= reach; ++t)
      if (!is_constant[row_number(j + t * dj, k + t * dk)]) return false;
    return true;
  }
  std::size_t row_number(int j, int k) const {
    return static_cast<std::size_t>(j) +
           static_cast<std::size_t>(values.size[1]) * static_cast<std::size_t>(k);
  }

  Box<float> values;
  std::vector<char> is_constant;
};

/// Weighted sums of neighbouring rows by a symmetric kernel.
class KernelSum {
 public:
  /// @param step  distance between rows
  KernelSum(const std::vector<float>& kernel, std::size_t step)
      : kernel_(kernel), step_(step), pairs_(kernel.size() - 1) {}
  /// @param constant  all sums of the row are equal: one is computed, by the same operations
  void sum(const float* centre, int length, bool constant, float* out) {
    const auto count = static_cast<std::size_t>(length);
    for (std::size_t t = 1; t <= pairs_.size(); ++t)
      pairs_[t - 1] = {centre - t * step_, centre + t * step_, kernel_[t]};
    sum_rows({centre, kernel_[0], pairs_.data(), pairs_.size()}, constant ? 1 : count, out);
    if (constant) std::fill_n(out + 1, count - 1, out[0]);
  }

 private:
  const std::vector<float>& kernel_;
  std::size_t step_;
  std::vector<RowPair<float>> pairs_;
};

}  // namespace

std::vector<float> smoothing_kernel(double sigma_voxels) {
  const std::vector<float> gaussian = sample_normal_kernel(sigma_voxels).weights;
  const auto at = [&](int t) {
    const auto n = static_cast<std::size_t>(std::abs(t));
    return n < gaussian.size() ? gaussian[n] : 0.0f;
  };
  std::vector<float> kernel;
  for (int t = 0; t <= static_cast<int>(gaussian.size()); ++t)
    kernel.push_back(0.25f * at(t - 1) + 0.5f * at(t) + 0.25f * at(t + 1));
  return kernel;
}

Box<float> smoothed(const Box<LabelId>& labels, const std::vector<float>& value,
                    const std::array<std::vector<float>, 3>& kernels) {
  const std::array<int, 3>& from = labels.size;
  std::array<int, 3> reach{}, to{};
  for (std::size_t a = 0; a < 3; ++a) {
    reach[a] = static_cast<int>(kernels[a].size()) - 1;
    to[a] = from[a] - 2 * reach[a];
  }
  const auto width = static_cast<std::size_t>(from[0]);
  KnownRows plane({from[0], 1, from[2]}), along_k({from[0], from[1], to[2]}), slice({to[0], from[1], 1});
  KernelSum by_k(kernels[2], width), by_i(kernels[0], 1), by_j(kernels[1], static_cast<std::size_t>(to[0]));
  for (int j = 0; j < from[1]; ++j) {
    for (int k = 0; k < from[2]; ++k) {
      const LabelId* row = labels.row(j, k);
      float* values = plane.values.row(0, k);
      for (std::size_t i = 0; i < width; ++i)
        values[i] = value[std::min<std::size_t>(row[i], value.size() - 1)];
      plane.constant(0, k) = std::all_of(values, values + width, [&](float v) { return v == values[0]; });
    }
    for (int k = 0; k < to[2]; ++k) {
      const bool constant = plane.are_constant(0, k + reach[2], 0, 1, reach[2]);
      by_k.sum(plane.values.row(0, k + reach[2]), from[0], constant, along_k.values.row(j, k));
      along_k.constant(j, k) = constant;
    }
  }
  Box<float> all(to);
  for (int k = 0; k < to[2]; ++k) {
    for (int j = 0; j < from[1]; ++j) {
      const bool constant = along_k.constant(j, k);
      by_i.sum(along_k.values.row(j, k) + reach[0], to[0], constant, slice.values.row(j, 0));
      slice.constant(j, 0) = constant;
    }
    for (int j = 0; j < to[1]; ++j)
      by_j.sum(slice.values.row(j + reach[1], 0), to[0], slice.are_constant(j + reach[1], 0, 1, 0, reach[1]),
               all.row(j, k));
  }
  return all;
}

}  // namespace palpate::internal::volume_picture
