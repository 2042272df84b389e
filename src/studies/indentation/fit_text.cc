#include <algorithm>

#include "indentation/format.h"
#include "palpate/indentation/indentation.h"
#include "palpate/scene/named_values.h"

namespace palpate {
namespace {

std::string interval(const FittedValue& value) {
  return printed("%.4g (%.4g ... %.4g)", value.value, value.low, value.high);
}

std::string key(const char* name, const FittedValue& value, const char* unit) {
  return printed("%s = %.4g  # %.4g ... %.4g%s\n", name, value.value, value.low, value.high, unit);
}

}  // namespace

std::string tissue_toml(const TissueFit& fit) {
  const LawFit& best = fit.best();
  std::string text =
      printed("# fitted by palpate fit to %zu samples, residuals %.2g %% of the greatest force\n",
              fit.samples, best.rms_percent);
  text += key("youngs_modulus", best.youngs_modulus_kPa, " kPa");
  text += printed("poissons_ratio = %.4g  # given, not fitted\n", fit.poissons_ratio);
  if (best.law == TissueLaw::kExponential) text += key("stiffening", best.stiffening, "");
  if (!best.relaxation.empty()) {
    std::string terms, intervals;
    for (const auto& [fraction, time] : best.relaxation) {
      terms += printed("%s[%.4g, %.4g]", terms.empty() ? "" : ", ", fraction.value, time.value);
      intervals += printed("%s%.3g ... %.3g in %.3g ... %.3g s", intervals.empty() ? "" : "; ", fraction.low,
                           fraction.high, time.low, time.high);
    }
    text += "relaxation = [" + terms + "]  # " + intervals + "\n";
  }
  text += "\n[yielding]\nlaw = \"" + std::string(name_of(best.law, kTissueLaws)) + "\"\n";
  return text;
}

std::string fit_table(const TissueFit& fit) {
  std::string text = printed("%-12s  %-28s  %-24s  residuals\n", "law", "E kPa", "stiffening");
  for (std::size_t n = 0; n < fit.laws.size(); ++n) {
    const LawFit& law = fit.laws[n];
    text += printed("%-12s  %-28s  %-24s  %.2g %%%s\n", std::string(name_of(law.law, kTissueLaws)).c_str(),
                    interval(law.youngs_modulus_kPa).c_str(),
                    law.law == TissueLaw::kExponential ? interval(law.stiffening).c_str() : "",
                    law.rms_percent, n == fit.chosen ? "  chosen" : "");
    for (const auto& [fraction, time] : law.relaxation)
      text +=
          printed("%-12s  relaxes by %s in %s s\n", "", interval(fraction).c_str(), interval(time).c_str());
    if (!law.undetermined.empty())
      text += printed("%-12s  not determined: %s\n", "", law.undetermined.c_str());
  }
  text += printed("%zu samples; intervals are two standard errors; residuals over the greatest force\n",
                  fit.samples);
  for (const std::string& note : fit.notes) text += note + "\n";
  return text;
}

}  // namespace palpate
