#include <algorithm>
#include <limits>

#include "palpate/base/printable.h"
#include "palpate/indentation/indentation.h"
#include "palpate/scene/tissue_presets.h"

namespace palpate {

Result<PresetComparison> compare_with_preset(const IndentationCurve& curve) {
  const TissuePreset* preset = find_preset(curve.preset);
  const auto error = [&](std::string what, std::string remedy) {
    return Error{ErrorKind::kBadInput, std::move(what), curve.name, std::move(remedy)};
  };
  if (preset == nullptr)
    return error("there is no preset \"" + printable_name(curve.preset) + "\"",
                 "palpate scene presets lists them; name one in the column preset, or with --preset");
  if (!preset->values.elastic)
    return error("the preset " + preset->name + " is rigid", "compare the curve with a soft tissue");
  const double limit_mm = indentation_limit_mm(curve.setup);
  const auto [low_kPa, high_kPa] = preset->range_kPa;
  const auto force_N = [&](double kPa, double depth_mm) {
    ElasticConstants constants = *preset->values.elastic;
    constants.youngs_modulus_kPa = kPa;
    return indentation_force_N(constants, TissueLaw::kExponential, curve.setup, depth_mm);
  };
  std::size_t inside = 0, all = 0;
  double max_N = 0, at_mm = 0;
  for (std::size_t n = 0; n < curve.depth_mm.size(); ++n) {
    const double depth_mm = curve.depth_mm[n], measured_N = curve.force_N[n];
    if (!(depth_mm > 0) || depth_mm > limit_mm) continue;
    ++all;
    inside += measured_N >= force_N(low_kPa, depth_mm) && measured_N <= force_N(high_kPa, depth_mm);
    if (depth_mm < at_mm) continue;
    at_mm = depth_mm;
    max_N = measured_N;
  }
  if (all == 0)
    return error("no sample is in contact and within the depth for which the model is valid",
                 "depths begin at first contact, in millimetres");
  const double preset_N = force_N(preset->values.elastic->youngs_modulus_kPa, at_mm);
  return PresetComparison{static_cast<double>(inside) / static_cast<double>(all), max_N / preset_N};
}

}  // namespace palpate
