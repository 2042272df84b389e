#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "verification/accuracy.h"

// The whole suite, as run by `palpate verify accuracy`.
namespace palpate {
namespace {

void expect_mean_p99_max_in_order(const std::map<std::string, double>& values) {
  for (const auto& [name, p99] : values) {
    if (!name.ends_with("/p99")) continue;
    const std::string path = name.substr(0, name.size() - 3);
    EXPECT_LE(p99, values.at(path + "max")) << path;
    if (values.contains(path + "mean")) {
      EXPECT_LE(values.at(path + "mean"), p99) << path;
    }
  }
}

TEST(AccuracyGate, EveryFigureOccursOnceWithinItsLimit) {
  const auto figures = run_accuracy({});
  ASSERT_TRUE(figures.ok());
  std::map<std::string, double> values;
  for (const Figure& figure : *figures) {
    EXPECT_TRUE(values.emplace(figure.name, figure.value).second) << figure.name;
    EXPECT_TRUE(std::isfinite(figure.value) && figure.value >= 0) << figure.name;
    EXPECT_GE(figure.n, 300u) << figure.name;
    EXPECT_TRUE(figure.ok()) << figure.name << " " << figure.value << " > " << figure.limit.value_or(0);
    // limits have to be tight
    if (figure.limit) {
      EXPECT_LE(*figure.limit, 1.3 * figure.value + 0.02) << figure.name;
    }
    if (figure.name.find("/direction/") != std::string::npos) {
      EXPECT_EQ(figure.unit, "deg") << figure.name;
      EXPECT_EQ(figure.limit.has_value(), !figure.name.ends_with("/max")) << figure.name;
    }
    if (figure.name.find("/choppiness/") != std::string::npos) {
      EXPECT_EQ(figure.limit.has_value(), figure.name.ends_with("/p99")) << figure.name;
    }
  }
  // 22 variants with direction and magnitude or distance on 12 combinations of shape and spacing; 10 with
  // choppiness of two shapes on three spacings, for the Gaussian spheres also at and between half voxels
  EXPECT_EQ(values.size(), 22u * 12 * 6 + 10u * 6 * 2 + 2u * 6 * 4);
  expect_mean_p99_max_in_order(values);
}

}  // namespace
}  // namespace palpate
