#include "report/decimate.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

namespace palpate::report {
namespace {

PlotData random_data(std::size_t samples, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  PlotData data;
  data.series.resize(2);
  for (std::size_t i = 0; i < samples; ++i) {
    data.x.push_back(0.001 * static_cast<double>(i));
    for (auto& series : data.series) series.push_back(normal(random));
  }
  return data;
}

PlotData decimate(const PlotData& data, std::size_t max_points) {
  Decimator decimator(data.x.size(), data.series.size(), max_points);
  std::vector<double> values(data.series.size());
  for (std::size_t i = 0; i < data.x.size(); ++i) {
    for (std::size_t s = 0; s < values.size(); ++s) values[s] = data.series[s][i];
    decimator.add(data.x[i], values);
  }
  return decimator.finish();
}

TEST(Decimate, FewSamplesStayAsTheyAre) {
  const PlotData data = random_data(100, 1), same = decimate(data, 100);
  EXPECT_EQ(same.x, data.x);
  EXPECT_EQ(same.series, data.series);
}

TEST(Decimate, KeepsExtremesOfEveryInterval) {
  for (const std::size_t samples : {101, 1000, 12345}) {
    const PlotData data = random_data(samples, 2), drawn = decimate(data, 100);
    ASSERT_EQ(drawn.x.size(), 100u);
    EXPECT_TRUE(std::is_sorted(drawn.x.begin(), drawn.x.end(), std::less_equal<>())) << "strictly rising";
    for (std::size_t s = 0; s < 2; ++s) {
      ASSERT_EQ(drawn.series[s].size(), 100u);
      for (std::size_t run = 0; run < 50; ++run) {
        const auto first = data.series[s].begin() + static_cast<std::ptrdiff_t>(run * samples / 50);
        const auto end = data.series[s].begin() + static_cast<std::ptrdiff_t>((run + 1) * samples / 50);
        const auto [low, high] = std::minmax_element(first, end);
        const std::pair expected = low < high ? std::pair{*low, *high} : std::pair{*high, *low};
        EXPECT_EQ(std::pair(drawn.series[s][2 * run], drawn.series[s][2 * run + 1]), expected);
      }
    }
  }
}

TEST(Decimate, GapsStayGaps) {
  PlotData data = random_data(1000, 3);
  std::fill(data.series[0].begin() + 200, data.series[0].begin() + 400, kGap);
  data.series[0][500] = std::numeric_limits<double>::infinity();
  const PlotData drawn = decimate(data, 100);
  for (std::size_t i = 0; i < 100; ++i) {
    EXPECT_EQ(std::isnan(drawn.series[0][i]), i >= 20 && i < 40) << i;
    EXPECT_FALSE(std::isinf(drawn.series[0][i]));
    EXPECT_FALSE(std::isnan(drawn.series[1][i]));
  }
}

}  // namespace
}  // namespace palpate::report
