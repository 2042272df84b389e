#include "palpate/device/bounds.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "base/test_seed.h"
#include "palpate/device/device_parameters.h"

namespace palpate {
namespace {

DeviceInfo physical(std::optional<double> declared_N_per_mm = {}) {
  DeviceInfo info;
  info.name = "arm";
  info.stiffness_N_per_mm = declared_N_per_mm;
  return info;
}

TEST(ConservativeBounds, AreTheTheoryForTheWorstUnknownValues) {
  // 0.6 b / (T/2 + t_d) with the light grip's 2 N s/m, 250 Hz and 4 ms
  const ConservativeBounds nothing_known = conservative_bounds(physical());
  EXPECT_NEAR(nothing_known.stiffness_N_per_mm, 0.6 * 2 / (0.002 + 0.004) * 1e-3, 1e-12);
  EXPECT_NEAR(nothing_known.damping_N_s_per_mm, 0.6 * neutral_damping_N_s_per_mm(0.045, 250, 4e-3), 1e-12);
  EXPECT_NEAR(nothing_known.damping_N_s_per_mm, 0.0042, 0.0001);

  DeviceInfo known = physical();
  known.rate_hz = 1000;
  known.delay_s = 0;
  known.damping_N_s_per_m = 1;
  known.mass_kg = 0.2;
  EXPECT_NEAR(conservative_bounds(known).stiffness_N_per_mm, 0.6 * 3 / 0.0005 * 1e-3, 1e-12);
  EXPECT_NEAR(conservative_bounds(known).damping_N_s_per_mm, 0.6 * neutral_damping_N_s_per_mm(0.2, 1000, 0),
              1e-12);
  // non-finite or implausible values count as unknown
  for (const double odd : {0.0, -3.0, 1e-300, 1e300, std::nan(""), std::numeric_limits<double>::infinity()}) {
    DeviceInfo info = physical();
    info.rate_hz = info.mass_kg = odd;
    // an undamped arm and one without delay are plausible
    if (odd != 0 && odd != 1e-300) info.damping_N_s_per_m = info.delay_s = odd;
    EXPECT_EQ(conservative_bounds(info).stiffness_N_per_mm, nothing_known.stiffness_N_per_mm) << odd;
    EXPECT_EQ(conservative_bounds(info).damping_N_s_per_mm, nothing_known.damping_N_s_per_mm) << odd;
  }
}

TEST(ConservativeBounds, AssumeALongDelayIfNoneIsStated) {
  DeviceInfo info = physical();
  EXPECT_EQ(conservative_delay_s(info), 4e-3);
  EXPECT_EQ(device_parameters(info, {}).delay_s, 4e-3);
  for (const double declared_s : {0.0, 1e-3, 0.02}) {
    info.delay_s = declared_s;
    EXPECT_EQ(device_parameters(info, {}).delay_s, declared_s);
  }
  info.delay_s = std::nan("");
  EXPECT_EQ(conservative_delay_s(info), 4e-3);
  info.simulated = true;
  EXPECT_EQ(conservative_delay_s(info), 0);
}

TEST(ConservativeBounds, ApplyToEveryPhysicalDevice) {
  const double careful = conservative_bounds(physical()).stiffness_N_per_mm;
  EXPECT_EQ(stiffness_bound_N_per_mm(physical()), careful);
  EXPECT_EQ(stiffness_bound_N_per_mm(physical(std::numeric_limits<double>::infinity())), careful);
  EXPECT_EQ(stiffness_bound_N_per_mm(physical(2)), 2);
  EXPECT_EQ(stiffness_bound_N_per_mm(physical(-1)), 0);
  EXPECT_EQ(stiffness_bound_N_per_mm(physical(std::nan(""))), 0);
  EXPECT_NE(conservative_bound_message(physical()).find("0.2 N/mm"), std::string::npos)
      << conservative_bound_message(physical());
  EXPECT_EQ(conservative_bound_message(physical(2)), "");
  // a simulated device exerts no physical force
  DeviceInfo simulated = physical();
  simulated.simulated = true;
  EXPECT_EQ(stiffness_bound_N_per_mm(simulated), std::numeric_limits<double>::infinity());
  EXPECT_EQ(conservative_bound_message(simulated), "");

  // independent of the other properties
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  const double odd[] = {
      std::nan(""), -1, 0, 1e-300, 0.01, 1, 1000, 1e300, std::numeric_limits<double>::infinity()};
  const auto any = [&]() -> std::optional<double> {
    const std::size_t n = random() % (std::size(odd) + 1);
    return n < std::size(odd) ? std::optional(odd[n]) : std::nullopt;
  };
  for (int n = 0; n < 2000; ++n) {
    DeviceInfo info = physical(any());
    info.rate_hz = any();
    info.delay_s = any();
    info.mass_kg = any();
    info.damping_N_s_per_m = any();
    const DeviceParameters parameters = device_parameters(info, {});
    ASSERT_TRUE(std::isfinite(parameters.max_stiffness_N_per_mm) && parameters.max_stiffness_N_per_mm >= 0);
    ASSERT_GT(parameters.max_damping_N_s_per_mm, 1e-8);
    ASSERT_TRUE(parameters.delay_s >= 0 && parameters.delay_s <= 1);
  }
}

}  // namespace
}  // namespace palpate
