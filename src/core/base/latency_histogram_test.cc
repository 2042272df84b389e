#include "palpate/base/latency_histogram.h"

#include <gtest/gtest.h>

#include <limits>
#include <random>
#include <thread>
#include <vector>

namespace palpate {
namespace {

constexpr double kBucket = 1.0 / 64;

// typical distribution of lateness: most of it small, a tail over many octaves
std::vector<std::int64_t> random_samples(std::uint64_t seed, std::size_t count) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> octave(0, 33.9);
  std::normal_distribution<double> usual(20e3, 3e3);
  std::vector<std::int64_t> samples(count);
  for (std::int64_t& sample : samples)
    sample = random() % 3 == 0 ? std::llround(std::exp2(octave(random))) : std::llround(usual(random));
  return samples;
}

// nearest rank
double quantile_of_sorted(const std::vector<std::int64_t>& sorted, double q) {
  const double n = static_cast<double>(sorted.size());
  const auto rank = static_cast<std::size_t>(std::clamp(std::ceil(q * n), 1.0, n));
  return static_cast<double>(sorted[rank - 1]);
}

TEST(LatencyHistogram, QuantilesMatchSortedSamplesWithinABucket) {
  for (const std::uint64_t seed : {20240704, 20240705, 20240706})
    for (const std::size_t count : {1, 2, 3, 100, 1001, 50000}) {
      SCOPED_TRACE(::testing::Message() << "seed " << seed << ", " << count << " samples");
      std::vector<std::int64_t> samples = random_samples(seed, count);
      LatencyHistogram histogram;
      double sum = 0;
      for (const std::int64_t sample : samples) {
        histogram.add(sample);
        sum += static_cast<double>(sample);
      }
      std::sort(samples.begin(), samples.end());
      const auto expect_quantile = [&](double q, double us) {
        const double exact_ns = quantile_of_sorted(samples, q);
        EXPECT_GE(us * 1e3, exact_ns * (1 - 1e-12)) << q;
        EXPECT_LE(us * 1e3, exact_ns * (1 + kBucket)) << q;
        EXPECT_LE(us * 1e3, static_cast<double>(samples.back()) * (1 + 1e-12)) << q;
      };
      for (const double q : {0.0, 0.01, 0.25, 0.5, 0.75, 0.9, 0.99, 0.999, 0.9999, 1.0})
        expect_quantile(q, histogram.quantile_us(q));
      const LatencyHistogram::Summary summary = histogram.summary();
      expect_quantile(0.5, summary.p50_us);
      expect_quantile(0.99, summary.p99_us);
      expect_quantile(0.999, summary.p999_us);
      EXPECT_EQ(summary.n, count);
      EXPECT_DOUBLE_EQ(summary.max_us * 1e3, static_cast<double>(samples.back()));
      EXPECT_NEAR(summary.mean_us * 1e3, sum / static_cast<double>(count), 1e-9 * sum);
    }
}

TEST(LatencyHistogram, FractionAtMostIsConservativeWithinABucket) {
  std::vector<std::int64_t> samples = random_samples(20240707, 5000);
  std::sort(samples.begin(), samples.end());
  LatencyHistogram histogram;
  for (const std::int64_t sample : samples) histogram.add(sample);
  const auto exact = [&](double ns) {
    const auto end = std::upper_bound(samples.begin(), samples.end(), std::llround(std::floor(ns)));
    return static_cast<double>(end - samples.begin()) / static_cast<double>(samples.size());
  };
  for (const std::int64_t ns : samples) {
    const double fraction = histogram.fraction_at_most(ns);
    ASSERT_LE(fraction, exact(static_cast<double>(ns)));
    ASSERT_GE(fraction, exact(static_cast<double>(ns) * (1 - kBucket) - 1)) << ns;
  }
  EXPECT_EQ(histogram.fraction_at_most(samples.back()), 1);
  EXPECT_EQ(histogram.fraction_at_most(-1), 0);
}

TEST(LatencyHistogram, BucketsAreNarrowAtEveryPowerOfTwo) {
  for (int bits = 0; bits <= 34; ++bits)
    for (const std::int64_t step : {-1, 0, 1}) {
      const std::int64_t ns = (std::int64_t{1} << bits) + step;
      // the larger sample raises the cap that the maximum imposes on a bucket
      LatencyHistogram histogram;
      histogram.add(ns);
      histogram.add(std::int64_t{1} << 40);
      const double p50_ns = histogram.quantile_us(0.5) * 1e3;
      if (bits == 34) {
        EXPECT_DOUBLE_EQ(p50_ns, std::exp2(40)) << "in the last bucket it is the largest that is said";
      } else {
        EXPECT_GE(p50_ns, static_cast<double>(ns) * (1 - 1e-12)) << ns;
        EXPECT_LE(p50_ns, static_cast<double>(ns) * (ns < 128 ? 1 + 1e-12 : 1 + kBucket)) << ns;
      }
    }
}

TEST(LatencyHistogram, AcceptsExtremeAndNegativeSamples) {
  LatencyHistogram histogram;
  EXPECT_EQ(histogram.summary().n, 0u);
  EXPECT_EQ(histogram.summary().p99_us, 0);
  EXPECT_EQ(histogram.summary().mean_us, 0);
  EXPECT_EQ(histogram.fraction_at_most(5), 0);
  histogram.add(std::numeric_limits<std::int64_t>::min());
  histogram.add(-1);
  EXPECT_EQ(histogram.summary().n, 2u);
  EXPECT_EQ(histogram.summary().max_us, 0);
  EXPECT_EQ(histogram.fraction_at_most(0), 1);
  histogram.add(std::numeric_limits<std::int64_t>::max());
  EXPECT_DOUBLE_EQ(histogram.summary().max_us, 9223372036854775.807);
  EXPECT_DOUBLE_EQ(histogram.quantile_us(1), 9223372036854775.807);
  EXPECT_EQ(histogram.quantile_us(0.5), 0);
}

TEST(LatencyHistogram, MergeAddsAndClearEmpties) {
  const std::vector<std::int64_t> samples = random_samples(20240708, 3000);
  LatencyHistogram whole, first, second;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    whole.add(samples[i]);
    (i < 1000 ? first : second).add(samples[i]);
  }
  first.merge(second);
  const auto expect_same = [](const LatencyHistogram& a, const LatencyHistogram& b) {
    EXPECT_EQ(a.summary().n, b.summary().n);
    EXPECT_EQ(a.summary().max_us, b.summary().max_us);
    EXPECT_EQ(a.summary().mean_us, b.summary().mean_us);
    for (double q = 0; q <= 1; q += 0.01) EXPECT_EQ(a.quantile_us(q), b.quantile_us(q));
  };
  expect_same(first, whole);
  second.clear();
  expect_same(second, LatencyHistogram());
  first.merge(second);
  expect_same(first, whole);
}

TEST(LatencyHistogram, ConcurrentReadsAreConsistent) {
  constexpr std::uint64_t kSamples = 300000;
  LatencyHistogram histogram;
  std::thread writer([&] {
    for (std::uint64_t n = 0; n < kSamples; ++n) histogram.add(static_cast<std::int64_t>(1000 + n % 1000));
  });
  std::uint64_t last = 0;
  while (last < kSamples) {
    const LatencyHistogram::Summary summary = histogram.summary();
    EXPECT_GE(summary.n, last);
    EXPECT_TRUE(summary.n == 0 || (summary.p50_us >= 1 && summary.p50_us < 2 * (1 + kBucket)));
    last = summary.n;
  }
  writer.join();
  EXPECT_NEAR(histogram.summary().mean_us, 1.4995, 1e-9);
}

}  // namespace
}  // namespace palpate
