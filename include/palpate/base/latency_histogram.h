#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>

namespace palpate {

/// Histogram of latencies or durations, 15 kB for any number of samples: every octave has 64 buckets of equal
/// width, from 1 ns to 17 s (the scheme of HdrHistogram).
///
///      ns        0 1 2 ... 127 | 128 130 ... 254 | 256 260 ... 508 | ... | 8.6e9 ... 17.2e9 and above
///      width           1       |        2        |        4        |     |
///
/// Single writer. Other threads may read concurrently; each bucket is then read at a slightly different time.
class LatencyHistogram {
 public:
  /// Statistics of all samples; all 0 if n is 0. Percentiles are nearest-rank: the largest value of the
  /// bucket that holds the sample of that rank, limited to the largest sample. They are never too small and
  /// at most 1.6 % too large (exact below 128 ns; max_us if the rank falls into the last bucket, above 17 s).
  struct Summary {
    std::uint64_t n = 0;
    double p50_us = 0, p99_us = 0, p999_us = 0;
    double max_us = 0;   ///< Largest sample, exact.
    double mean_us = 0;  ///< Mean of all samples, exact.
  };

  /// Adds a sample. Writer only; wait-free. A negative `ns` counts as 0.
  void add(std::int64_t ns) noexcept {
    const std::uint64_t value = ns > 0 ? static_cast<std::uint64_t>(ns) : 0;
    bump(buckets_[bucket_of(value)], 1);
    bump(sum_ns_, value);
    if (value > get(max_ns_)) max_ns_.store(value, std::memory_order_relaxed);
  }

  Summary summary() const;

  /// Quantile q, 0 <= q <= 1, in microseconds, as described at Summary.
  double quantile_us(double q) const { return quantile_us(q, count()); }

  /// Fraction of all samples, 0 ... 1, that are certainly at most `ns`: a bucket that contains larger values
  /// too does not count. 0 without samples.
  double fraction_at_most(std::int64_t ns) const;

  /// Removes all samples. Only by the writer, or while nothing is added.
  void clear() noexcept;

  /// Adds all samples of `other`. Only by the writer, or while nothing is added.
  void merge(const LatencyHistogram& other) noexcept;

 private:
  // 2 * 64 exact values, then 64 buckets for each octave up to 2^34 ns
  static constexpr int kOctaveBits = 6, kLargestBits = 34;
  static constexpr std::size_t kBuckets = std::size_t{kLargestBits - kOctaveBits + 1} << kOctaveBits;
  static constexpr double kUs_per_ns = 1e-3;
  using Counter = std::atomic<std::uint64_t>;

  static std::size_t bucket_of(std::uint64_t value) {
    const int shift = std::max(0, static_cast<int>(std::bit_width(value)) - kOctaveBits - 1);
    return std::min<std::size_t>((std::size_t(shift) << kOctaveBits) + std::size_t(value >> shift),
                                 kBuckets - 1);
  }
  // largest value of a bucket
  static std::uint64_t top_of(std::size_t bucket) {
    const std::uint64_t octave = bucket >> kOctaveBits;
    const std::uint64_t shift = octave > 0 ? octave - 1 : 0;
    return ((bucket - (shift << kOctaveBits) + 1) << shift) - 1;
  }

  static std::uint64_t get(const Counter& counter) { return counter.load(std::memory_order_relaxed); }
  // single writer: no atomic addition needed
  static void bump(Counter& counter, std::uint64_t by) {
    counter.store(get(counter) + by, std::memory_order_relaxed);
  }

  std::uint64_t count() const;
  double quantile_us(double q, std::uint64_t n) const;

  std::array<Counter, kBuckets> buckets_{};
  Counter sum_ns_{0}, max_ns_{0};
};

inline std::uint64_t LatencyHistogram::count() const {
  std::uint64_t n = 0;
  for (const Counter& bucket : buckets_) n += get(bucket);
  return n;
}

inline double LatencyHistogram::quantile_us(double q, std::uint64_t n) const {
  if (n == 0) return 0;
  const double rank = std::clamp(std::ceil(q * static_cast<double>(n)), 1.0, static_cast<double>(n));
  const std::uint64_t max_ns = get(max_ns_);
  std::uint64_t count = 0;
  for (std::size_t i = 0; i + 1 < kBuckets; ++i) {
    count += get(buckets_[i]);
    if (static_cast<double>(count) >= rank)
      return static_cast<double>(std::min(top_of(i), max_ns)) * kUs_per_ns;
  }
  return static_cast<double>(max_ns) * kUs_per_ns;
}

inline LatencyHistogram::Summary LatencyHistogram::summary() const {
  Summary summary;
  summary.n = count();
  if (summary.n == 0) return summary;
  summary.p50_us = quantile_us(0.5, summary.n);
  summary.p99_us = quantile_us(0.99, summary.n);
  summary.p999_us = quantile_us(0.999, summary.n);
  summary.max_us = static_cast<double>(get(max_ns_)) * kUs_per_ns;
  summary.mean_us = static_cast<double>(get(sum_ns_)) / static_cast<double>(summary.n) * kUs_per_ns;
  return summary;
}

inline double LatencyHistogram::fraction_at_most(std::int64_t ns) const {
  const std::uint64_t n = count();
  if (n == 0 || ns < 0) return 0;
  if (static_cast<std::uint64_t>(ns) >= get(max_ns_)) return 1;
  std::uint64_t within = 0;
  for (std::size_t i = 0; i + 1 < kBuckets && top_of(i) <= static_cast<std::uint64_t>(ns); ++i)
    within += get(buckets_[i]);
  return static_cast<double>(within) / static_cast<double>(n);
}

inline void LatencyHistogram::clear() noexcept {
  for (Counter& bucket : buckets_) bucket.store(0, std::memory_order_relaxed);
  sum_ns_.store(0, std::memory_order_relaxed);
  max_ns_.store(0, std::memory_order_relaxed);
}

inline void LatencyHistogram::merge(const LatencyHistogram& other) noexcept {
  for (std::size_t i = 0; i < kBuckets; ++i) bump(buckets_[i], get(other.buckets_[i]));
  bump(sum_ns_, get(other.sum_ns_));
  max_ns_.store(std::max(get(max_ns_), get(other.max_ns_)), std::memory_order_relaxed);
}

}  // namespace palpate
