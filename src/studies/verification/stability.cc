#include "verification/stability.h"

#include "palpate/stability/critical_stiffness.h"
#include "verification/figure_names.h"
#include "verification/stability_buzz.h"
#include "verification/stability_contact.h"
#include "verification/stability_dropout.h"
#include "verification/stability_energy.h"
#include "verification/stability_following.h"
#include "verification/stability_grip.h"
#include "verification/stability_no_go.h"
#include "verification/stability_theory.h"

namespace palpate {
namespace {

constexpr const char* kDevices[] = {"premium-1.5", "touch"};
constexpr std::uint64_t kTouches = 3;  // impact speeds per case

StabilityCase case_of(const char* device, const char* grip, double rate_hz, double delay_s) {
  return {*find_plant_device(device), *find_plant_hand(grip), rate_hz, delay_s};
}

// Every grip that is covered by the recommended stiffness: at 1 kHz with each delay, then at each other rate
// with a delay of one sample.
std::vector<StabilityCase> all_cases() {
  std::vector<StabilityCase> cases;
  for (const char* device : kDevices)
    for (const PlantHand& grip : recommending_grips()) {
      const PlantDevice plant = *find_plant_device(device);
      for (const double delay_s : {0.0, 1e-3, 3e-3}) cases.push_back({plant, grip, 1000, delay_s});
      for (const double rate_hz : {500.0, 2000.0, 4000.0, 10000.0})
        cases.push_back({plant, grip, rate_hz, 1 / rate_hz});
    }
  return cases;
}

// Independent simulation of the same plant: stiffness in N/m at which a limit cycle first appeared, in steps
// of 5 to 10 %.
struct Reference {
  StabilityCase stability_case;
  double critical_N_per_m;
};

std::vector<Reference> references() {
  return {{case_of("premium-1.5", "light-grip", 1000, 0), 7289},
          {case_of("premium-1.5", "light-grip", 1000, 1e-3), 1919},
          {case_of("premium-1.5", "light-grip", 1000, 3e-3), 740},
          {case_of("premium-1.5", "firm-grip", 1000, 0), 18906},
          {case_of("premium-1.5", "firm-grip", 1000, 1e-3), 5476},
          {case_of("premium-1.5", "firm-grip", 1000, 3e-3), 2111},
          {case_of("touch", "light-grip", 1000, 1e-3), 8820},
          {case_of("touch", "light-grip", 1000, 3e-3), 2323},
          {case_of("premium-1.5", "light-grip", 500, 2e-3), 856},
          {case_of("premium-1.5", "light-grip", 2000, 0.5e-3), 4495},
          {case_of("premium-1.5", "light-grip", 4000, 0.25e-3), 10819}};
}

// signed deviation of the critical stiffnesses from the reference
std::vector<Figure> reference_figures(const std::vector<Figure>& found) {
  std::vector<Figure> figures;
  for (const Reference& reference : references()) {
    const std::string path = "stability/" + name_of(reference.stability_case);
    for (const Figure& figure : found)
      if (figure.name == path + "/critical")
        figures.push_back({path + "/from-reference",
                           100 * (figure.value * 1e3 / reference.critical_N_per_m - 1),
                           "percent",
                           figure.n,
                           {}});
  }
  return figures;
}

}  // namespace

std::string name_of(const StabilityCase& stability_case) {
  return stability_case.device.name + "/" + stability_case.hand.name + "/" +
         loop_name(stability_case.rate_hz, stability_case.delay_s);
}

Result<std::vector<Figure>> stiffness_figures(const StabilityCase& stability_case, const Progress& progress) {
  const auto critical = critical_stiffness_N_per_mm(stability_case, progress);
  if (!critical) return critical.error();
  const auto settling = settling_stiffness_N_per_mm(stability_case, progress);
  if (!settling) return settling.error();
  const std::string path = "stability/" + name_of(stability_case);
  const auto figure = [&](const char* what, double value) {
    return Figure{path + "/" + what, value, "N/mm", kTouches, {}};
  };
  return std::vector{
      figure("critical", *critical), figure("margin", kStiffnessMargin * *critical),
      figure("settling", *settling),
      figure("passive", passivity_bound_N_per_mm(stability_case.device, stability_case.rate_hz))};
}

Result<SuiteReport> run_stability(const Progress& progress) {
  SuiteReport report;
  progress.report("comparing the plant model with theory", 0);
  auto theory = theory_figures(progress);
  if (!theory) return theory.error();
  report.figures = *std::move(theory);

  const auto cases = all_cases();
  for (std::size_t n = 0; n < cases.size(); ++n) {
    progress.report("critical stiffness: " + name_of(cases[n]),
                    static_cast<double>(n) / static_cast<double>(cases.size()));
    const auto figures = stiffness_figures(cases[n], progress);
    if (!figures) return figures.error();
    report.figures.insert(report.figures.end(), figures->begin(), figures->end());
  }
  progress.report("critical stiffness", 1);
  const auto deviations = reference_figures(report.figures);
  report.figures.insert(report.figures.end(), deviations.begin(), deviations.end());
  const auto buzz = buzz_figures(progress);
  if (!buzz) return buzz.error();
  report.figures.insert(report.figures.end(), buzz->begin(), buzz->end());
  const auto energies = energy_figures(progress);
  if (!energies) return energies.error();
  report.figures.insert(report.figures.end(), energies->begin(), energies->end());
  const auto dropouts = dropout_figures(progress);
  if (!dropouts) return dropouts.error();
  report.figures.insert(report.figures.end(), dropouts->begin(), dropouts->end());
  const auto no_go = no_go_figures(progress);
  if (!no_go) return no_go.error();
  report.figures.insert(report.figures.end(), no_go->begin(), no_go->end());
  const auto following = following_figures(progress);
  if (!following) return following.error();
  report.figures.insert(report.figures.end(), following->begin(), following->end());
  const auto grips = grip_figures(progress);
  if (!grips) return grips.error();
  report.figures.insert(report.figures.end(), grips->begin(), grips->end());
  const auto contact = contact_figures(progress);
  if (!contact) return contact.error();
  report.figures.insert(report.figures.end(), contact->begin(), contact->end());
  report.notes = {
      {"hold", "1 N on a single wall, touched at 0, 0.1 and 0.5 m/s; the least of them"},
      {"limit cycle", "above two encoder steps in the 2nd second of the hold, and not dying down"},
      {"random", "seed " + std::to_string(Exploration{}.seed) + " of energy, seed " +
                     std::to_string(kContactSeed) + " of friction, drift and pop-through"}};
  return report;
}

}  // namespace palpate
