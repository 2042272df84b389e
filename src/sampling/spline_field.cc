#include <algorithm>
#include <cmath>
#include <limits>

#include "palpate/sampling.h"
#include "sampling/spline_prefilter.h"

namespace palpate {

namespace {

// beyond one voxel outside, the spline's value is the one outside
constexpr double kSplineReach = 1;

/// Fills what queries near the border read: the coefficients are odd about one voxel beyond the grid. The
/// border of a PaddedVolume is shared by two rows, and two voxels of it are each one's.
template <class T>
void continue_oddly(PaddedVolume<T>& c) {
  const auto& dims = c.geometry().dims;
  const auto negative = [](T x) { return static_cast<T>(-x); };
  for (int k = 0; k < dims[2]; ++k) {
    for (int j = 0; j < dims[1]; ++j) {
      c.at(-2, j, k) = negative(c.at(0, j, k));
      c.at(dims[0] + 1, j, k) = negative(c.at(dims[0] - 1, j, k));
    }
  }
  for (int k = 0; k < dims[2]; ++k) {
    for (int i = -2; i <= dims[0] + 1; ++i) {
      c.at(i, -2, k) = negative(c.at(i, 0, k));
      c.at(i, dims[1] + 1, k) = negative(c.at(i, dims[1] - 1, k));
    }
  }
  for (int j = -2; j <= dims[1] + 1; ++j) {
    for (int i = -2; i <= dims[0] + 1; ++i) {
      c.at(i, j, -2) = negative(c.at(i, j, 0));
      c.at(i, j, dims[2] + 1) = negative(c.at(i, j, dims[2] - 1));
    }
  }
}

Volume<std::int16_t> in_steps(const Volume<float>& coefficients, double scale) {
  Volume<std::int16_t> steps(coefficients.geometry());
  std::transform(coefficients.voxels().begin(), coefficients.voxels().end(), steps.voxels().begin(),
                 [=](float c) { return static_cast<std::int16_t>(std::lround(c / scale)); });
  return steps;
}

template <class T>
PaddedVolume<T> padded(const Volume<T>& coefficients) {
  PaddedVolume<T> result(coefficients, 0);
  continue_oddly(result);
  return result;
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

  // the spline overshoots its voxels, so the step follows from the coefficients themselves
  if (options.storage == SplineStorage::kFloat) {
    coefficients_ = padded(coefficients);
  } else {
    if (largest > 0) scale_ = static_cast<double>(largest) / std::numeric_limits<std::int16_t>::max();
    coefficients_ = padded(in_steps(coefficients, scale_));
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
