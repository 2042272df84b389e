#include "verification/stability.h"

#include <gtest/gtest.h>

#include <atomic>
#include <map>

#include "verification/stability_theory.h"

namespace palpate {
namespace {

TEST(Stability, StabilityLimitMatchesTheory) {
  for (const double delay_s : {0.0, 3e-3}) {
    const double theory = 2 / (0.5e-3 + delay_s) * 1e-3;
    EXPECT_NEAR(neutral_stiffness_N_per_mm(2, 1000, delay_s) / theory, 1, 0.05) << "delay " << delay_s;
  }
}

TEST(Stability, ACaseHasItsStiffnessesByName) {
  const StabilityCase stability_case{*find_plant_device("premium-1.5"), *find_plant_hand("light-grip"), 500,
                                     2e-3};
  const auto figures = stiffness_figures(stability_case, {});
  ASSERT_TRUE(figures.ok());
  std::map<std::string, double> values;
  for (const Figure& figure : *figures) {
    EXPECT_EQ(figure.unit, "N/mm");
    values[figure.name] = figure.value;
  }
  const std::string path = "stability/premium-1.5/light-grip/0.5kHz/delay-2ms/";
  ASSERT_EQ(values.size(), 4u);
  const double critical = values.at(path + "critical");
  EXPECT_DOUBLE_EQ(values.at(path + "margin"), 0.6 * critical);
  EXPECT_GT(values.at(path + "settling"), 0);
  EXPECT_LE(values.at(path + "settling"), critical);
  EXPECT_DOUBLE_EQ(values.at(path + "passive"), passivity_bound_N_per_mm(stability_case.device, 500));
}

TEST(Stability, CanBeInterrupted) {
  const std::atomic<bool> stop = true;
  const auto report = run_suite("stability", {}, Progress({}, &stop));
  ASSERT_FALSE(report.ok());
  EXPECT_EQ(report.error().kind, ErrorKind::kInterrupted);
}

}  // namespace
}  // namespace palpate
