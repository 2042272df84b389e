#include "verification/stability_theory.h"

#include <algorithm>
#include <cmath>

#include "palpate/device/simulated_device.h"
#include "palpate/stability/critical_stiffness.h"
#include "verification/figure_names.h"

namespace palpate {
namespace {

constexpr double kMass_kg = 0.225;
constexpr double kLimit_percent = 5;

// ratio of the peak-to-peak motion of the sixth second to that of the first
double growth(double stiffness_N_per_mm, double damping_N_s_per_m, double rate_hz, double delay_s) {
  const PlantDevice device{"free", kMass_kg, 0, 0, 0, 1e9, 1e9};
  const PlantHand hand{"damper", 0, damping_N_s_per_m, 0};
  SimulatedDevice plant(device, hand, delay_s);
  plant.reset(Point<Device>(1, 0, 0));
  const long second = std::lround(rate_hz);
  const auto swing_mm = [&] {
    double low = 0, high = 0;
    for (long n = 0; n < second; ++n) {
      plant.advance({Vector<Device>(-stiffness_N_per_mm * plant.read().tip.x(), 0, 0), {}}, 1 / rate_hz);
      low = std::min(low, plant.true_tip().x());
      high = std::max(high, plant.true_tip().x());
    }
    return high - low;
  };
  const double first_mm = swing_mm();
  for (int n = 0; n < 4; ++n) swing_mm();
  return swing_mm() / first_mm;
}

}  // namespace

double neutral_stiffness_N_per_mm(double damping_N_s_per_m, double rate_hz, double delay_s) {
  const double theory = theoretical_stiffness_N_per_mm(damping_N_s_per_m, rate_hz, delay_s);
  double dies = theory / 2, grows = theory * 2;
  while (grows / dies > 1.001) {
    const double midpoint = std::sqrt(dies * grows);
    (growth(midpoint, damping_N_s_per_m, rate_hz, delay_s) < 1 ? dies : grows) = midpoint;
  }
  return std::sqrt(dies * grows);
}

Result<std::vector<Figure>> theory_figures(const Progress& progress) {
  std::vector<Figure> figures;
  for (const double damping : {0.5, 1.0, 2.0}) {
    for (const double delay_s : {0.0, 1e-3, 3e-3}) {
      if (progress.stopped()) return Progress::interrupted();
      constexpr double kRate_hz = 1000;
      const double neutral = neutral_stiffness_N_per_mm(damping, kRate_hz, delay_s);
      const double theory = theoretical_stiffness_N_per_mm(damping, kRate_hz, delay_s);
      figures.push_back(
          {"stability/theory/b-" + short_number(damping) + "/" + loop_name(kRate_hz, delay_s) + "/off",
           100 * std::abs(neutral / theory - 1), "percent", 1, kLimit_percent});
    }
  }
  return figures;
}

}  // namespace palpate
