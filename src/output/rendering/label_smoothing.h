#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "palpate/volume/volume.h"

namespace palpate::internal::volume_picture {

/// Dense array over a box, i fastest.
template <class T>
struct Box {
  explicit Box(const std::array<int, 3>& box_size) : size(box_size) {
    values.resize(static_cast<std::size_t>(size[0]) * size[1] * size[2]);
  }
  std::size_t offset(int i, int j, int k) const {
    return static_cast<std::size_t>(i) +
           static_cast<std::size_t>(size[0]) *
               (static_cast<std::size_t>(j) +
                static_cast<std::size_t>(size[1]) * static_cast<std::size_t>(k));
  }
  T* row(int j, int k) { return values.data() + offset(0, j, k); }
  const T* row(int j, int k) const { return values.data() + offset(0, j, k); }

  std::array<int, 3> size;
  std::vector<T> values;
};

/// Gaussian convolved with [1 2 1] / 4, one side.
std::vector<float> smoothing_kernel(double sigma_voxels);

/// Smooths values of labels along all axes; the result is smaller by the kernels' reach on either side.
/// Processes plane after plane across j along k, then slice after slice along i and j, so that each fits in a
/// core's cache.
/// @param value  by label; the last entry applies to all labels beyond
Box<float> smoothed(const Box<LabelId>& labels, const std::vector<float>& value,
                    const std::array<std::vector<float>, 3>& kernels);

}  // namespace palpate::internal::volume_picture
