#include "surfaces/surface_filter.h"

#include <cmath>
#include <limits>
#include <vector>

#include "surfaces/surface_rows.h"

namespace palpate::internal {

namespace {

/// Weights of a normalised Gaussian at 0 ... radius.
std::vector<double> samples(double sigma_voxels, int radius) {
  std::vector<double> w(static_cast<std::size_t>(radius) + 1);
  double sum = 0;
  for (int t = radius; t >= 0; --t) {
    const double x = t / sigma_voxels;
    w[t] = std::exp(-0.5 * x * x);
    sum += t == 0 ? w[t] : 2 * w[t];
  }
  for (double& weight : w) weight /= sum;
  return w;
}

AxisKernel axis_kernel(double sigma_voxels, double cut, double narrow, double wide) {
  if (sigma_voxels <= 0) return {{1.0f}};
  const int radius = static_cast<int>(std::ceil(cut * sigma_voxels));
  const std::vector<double> a = samples(sigma_voxels, radius);
  const std::vector<double> b = samples(sigma_voxels * std::sqrt(2.0), radius);
  AxisKernel kernel;
  for (int t = 0; t <= radius; ++t) kernel.weights.push_back(static_cast<float>(narrow * a[t] + wide * b[t]));
  return kernel;
}

BlockKernel block_kernel(const Eigen::Vector3d& spacing_mm, double sigma_mm, double cut, double narrow,
                         double wide) {
  BlockKernel kernel;
  for (int a = 0; a < 3; ++a) kernel.axis[a] = axis_kernel(sigma_mm / spacing_mm[a], cut, narrow, wide);
  return kernel;
}

/// Value of each row that is constant, NaN for other rows.
class ConstantRows {
 public:
  explicit ConstantRows(const Block<float>& block) : span_(block.span()) {
    const auto length = static_cast<std::size_t>(span_.size(0));
    for_each_row(span_, [&](int j, int k) {
      const float* row = block.row(j, k);
      values_.push_back(all_equal(row, length) ? row[0] : kUneven);
    });
  }
  explicit ConstantRows(const Span3& span) : span_(span) {
    values_.resize(static_cast<std::size_t>(span.size(1)) * static_cast<std::size_t>(span.size(2)));
  }

  float& at(int j, int k) { return values_[positions(j, k)]; }
  const float& at(int j, int k) const { return values_[positions(j, k)]; }

  static constexpr float kUneven = std::numeric_limits<float>::quiet_NaN();

 private:
  std::size_t positions(int j, int k) const {
    return static_cast<std::size_t>(k - span_.low[2]) * static_cast<std::size_t>(span_.size(1)) +
           static_cast<std::size_t>(j - span_.low[1]);
  }
  Span3 span_;
  std::vector<float> values_;
};

/// Input rows of one output row.
class Neighbours {
 public:
  explicit Neighbours(const AxisKernel& kernel) : kernel_(kernel) {
    pairs_.resize(static_cast<std::size_t>(kernel.radius()));
    for (int t = 1; t <= kernel.radius(); ++t) pairs_[t - 1].weight = kernel.weights[t];
  }

  /// @param where  where(t) returns the row at distance t
  template <class Where>
  WeightedRows<float> rows(const Where& where) {
    for (int t = 1; t <= kernel_.radius(); ++t) {
      pairs_[t - 1].before = where(-t);
      pairs_[t - 1].after = where(t);
    }
    return {where(0), kernel_.weights[0], pairs_.data(), pairs_.size()};
  }

  /// Whether value(t) is a number, i.e. the row is constant, for every input row.
  template <class Value>
  bool all_even(const Value& value) const {
    for (int t = -kernel_.radius(); t <= kernel_.radius(); ++t) {
      if (std::isnan(*value(t))) return false;
    }
    return true;
  }

 private:
  const AxisKernel& kernel_;
  std::vector<RowPair<float>> pairs_;
};

/// Filters along one axis. Along j and k input and output rows have equal length, so that adjacent rows are
/// processed as one long row.
void filter_axis(const Block<float>& in, const ConstantRows& even_in, int axis, const AxisKernel& kernel,
                 RowOperation operation, Block<float>& out, ConstantRows& even_out) {
  const Span3& span = out.span();
  const auto length = static_cast<std::size_t>(span.size(0));
  const int shift = span.low[0] - in.span().low[0];
  const Index3 step{axis == 0, axis == 1, axis == 2};
  Neighbours neighbours(kernel);
  for (int k = span.low[2]; k < span.high[2]; ++k) {
    for (int j = span.low[1]; j < span.high[1];) {
      const auto even = [&](int t) { return &even_in.at(j + t * step[1], k + t * step[2]); };
      if (neighbours.all_even(even)) {
        float& value = even_out.at(j, k);
        operation(neighbours.rows(even), 1, &value);
        std::fill_n(out.row(j, k), length, value);
        ++j;
        continue;
      }
      const auto row = [&](int t) { return in.row(j + t * step[1], k + t * step[2]) + shift + t * step[0]; };
      const WeightedRows<float> rows = neighbours.rows(row);
      float* const from = out.row(j, k);
      std::size_t together = 0;
      do {
        even_out.at(j++, k) = ConstantRows::kUneven;
        together += length;
      } while (axis != 0 && j < span.high[1] && !neighbours.all_even(even));
      operation(rows, together, from);
    }
  }
}

/// Filters along the last two axes.
void filter_slices(const Block<float>& in, const ConstantRows& even_in, const BlockKernel& kernel,
                   RowOperation operation, Block<float>& out) {
  Block<float> along_j(out.span().grown({kernel.reach()[0], 0, 0}));
  ConstantRows even_j(along_j.span());
  filter_axis(in, even_in, 1, kernel.axis[1], operation, along_j, even_j);
  ConstantRows even_i(out.span());
  filter_axis(along_j, even_j, 0, kernel.axis[0], operation, out, even_i);
}

}  // namespace

BlockKernel gaussian_block_kernel(const Eigen::Vector3d& spacing_mm, double sigma_mm) {
  return block_kernel(spacing_mm, sigma_mm, 2.5, 1, 0);
}

BlockKernel quadratic_block_kernel(const Eigen::Vector3d& spacing_mm, double sigma_mm) {
  return block_kernel(spacing_mm, sigma_mm, 3, 2, -1);
}

void filter_block(const Block<float>& in, const BlockKernel& kernel, RowOperation operation,
                  Block<float>& out) {
  const Index3 reach = kernel.reach();
  const ConstantRows even_in(in);
  Block<float> along_k(out.span().grown({reach[0], reach[1], 0}));
  ConstantRows even_k(along_k.span());
  filter_axis(in, even_in, 2, kernel.axis[2], operation, along_k, even_k);
  filter_slices(along_k, even_k, kernel, operation, out);
}

void filter_slices(const Block<float>& in, const BlockKernel& kernel, RowOperation operation,
                   Block<float>& out) {
  filter_slices(in, ConstantRows(in), kernel, operation, out);
}

void filter_block(const Block<float>& in, const BlockKernel& kernel, Block<float>& out) {
  filter_block(in, kernel, sum_rows, out);
}

}  // namespace palpate::internal
