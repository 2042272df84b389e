#include <algorithm>
#include <cmath>
#include <limits>

#include "palpate/sampling/sampling.h"
#include "sampling/spline_prefilter.h"

namespace palpate {

namespace {

// one voxel beyond the grid the spline has reached its outside value
constexpr double kSplineReach = 1;

constexpr int kMargin = 2;

/// Coefficients with the margin that queries near the border read, continued oddly about one voxel beyond the
/// grid.
template <class T>
Bricks<T> continued_oddly(const Volume<T>& coefficients) {
  GridGeometry wide = coefficients.geometry();
  for (int& n : wide.dims) n += 2 * kMargin;
  Volume<T> c(wide);
  // mirror image along one axis of the voxel at n beyond the grid's first: its index and sign; sign 0 at one
  // voxel beyond the grid
  struct Twin {
    int at, sign;
  };
  const auto twin = [](int n, int count) {
    if (count == 0 || n == -1 || n == count) return Twin{0, 0};
    if (n < 0) return Twin{-2 - n, -1};
    return n < count ? Twin{n, 1} : Twin{2 * count - n, -1};
  };
  const auto& dims = coefficients.geometry().dims;
  for (int k = -kMargin; k < dims[2] + kMargin; ++k) {
    const Twin of_k = twin(k, dims[2]);
    for (int j = -kMargin; j < dims[1] + kMargin; ++j) {
      const Twin of_j = twin(j, dims[1]);
      for (int i = -kMargin; i < dims[0] + kMargin; ++i) {
        const Twin of_i = twin(i, dims[0]);
        const int sign = of_i.sign * of_j.sign * of_k.sign;
        if (sign == 0) continue;
        const T value = coefficients.at(of_i.at, of_j.at, of_k.at);
        c.at(i + kMargin, j + kMargin, k + kMargin) = sign > 0 ? value : static_cast<T>(-value);
      }
    }
  }
  return {coefficients.geometry(), c, kMargin, T{0}};
}

Volume<std::int16_t> in_steps(const Volume<float>& coefficients, double scale) {
  Volume<std::int16_t> steps(coefficients.geometry());
  std::transform(coefficients.voxels().begin(), coefficients.voxels().end(), steps.voxels().begin(),
                 [=](float c) { return static_cast<std::int16_t>(std::lround(c / scale)); });
  return steps;
}

SplineOptions with_outside(SplineOptions options, double outside) {
  options.outside = outside;
  return options;
}

}  // namespace

SplineField::SplineField(const Volume<float>& values, const SplineOptions& options) {
  Volume<float> coefficients = values;
  for (float& c : coefficients.voxels()) c -= static_cast<float>(options.outside);
  internal::spline_prefilter(coefficients, options.threads);
  float largest = 0;
  for (const float c : coefficients.voxels()) {
    PALPATE_CHECK(std::isfinite(c));
    largest = std::max(largest, std::abs(c));
  }

  // the spline's coefficients exceed the range of its values, so the step is derived from the coefficients
  if (options.storage == SplineStorage::kFloat) {
    coefficients_ = continued_oddly(coefficients);
  } else {
    if (largest > 0) scale_ = static_cast<double>(largest) / std::numeric_limits<std::int16_t>::max();
    coefficients_ = continued_oddly(in_steps(coefficients, scale_));
  }
  map_ = internal::SamplingMap(values.geometry(), scale_, options.outside, options.outside, kSplineReach, 1);
}

SplineField::SplineField(const Field& field, const SplineOptions& options)
    : SplineField(field.values(), with_outside(options, 0)) {}

SplineField::SplineField(const SignedField& field, const SplineOptions& options)
    : SplineField(field.values(), with_outside(options, field.outside())) {}

const GridGeometry& SplineField::geometry() const {
  return std::visit([](const auto& c) -> const GridGeometry& { return c.geometry(); }, coefficients_);
}

}  // namespace palpate
