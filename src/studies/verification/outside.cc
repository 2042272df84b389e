#include "verification/outside.h"

#include <string>
#include <utility>

#include "palpate/base/file.h"
#include "palpate/indentation/indentation.h"

namespace palpate {

Result<SuiteReport> run_outside(const SuiteOptions& options, const Progress& progress, const Warn& warn) {
  if (!options.curves)
    return Error{ErrorKind::kUsage, "the suite 'outside' needs measured curves", "",
                 "palpate verify outside CURVES.csv; docs/guide/fit.md describes the file"};
  const auto text = read_file(*options.curves, kMaxCurveBytes);
  if (!text) return text.error();
  const auto curves = read_indentation_curves(*text, {}, options.curves->string());
  if (!curves) return curves.error();
  SuiteReport report;
  for (std::size_t n = 0; n < curves->size(); ++n) {
    if (progress.stopped()) return Progress::interrupted();
    const IndentationCurve& curve = (*curves)[n];
    const std::string name = curve.name.empty() ? "curve" : curve.name;
    const auto add = [&](const char* what, double value, const char* unit) {
      report.figures.push_back({"outside/" + name + "/" + what, value, unit, curve.depth_mm.size(), {}});
    };
    if (!curve.preset.empty()) {
      const auto compared = compare_with_preset(curve);
      if (!compared) return compared.error();
      add("inside-band", 100 * compared->inside_fraction, "percent");
      add("end-force-over-preset", compared->end_force_ratio, "1");
    }
    const auto fit = fit_tissue({&curve, 1});
    if (!fit) {
      warn(name + ": " + fit.error().what);
      continue;
    }
    add("modulus", fit->best().youngs_modulus_kPa.value, "kPa");
    add("stiffening", fit->best().stiffening.value, "1");
    add("residuals", fit->best().rms_percent, "percent");
  }
  return report;
}

}  // namespace palpate
