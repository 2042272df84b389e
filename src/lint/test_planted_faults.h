#pragma once

#include <functional>
#include <optional>
#include <random>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/lint/lint.h"

/// Generated label maps without faults, and faults planted into them.
namespace palpate::test {

/// A label map with its scan, as lint() takes it.
struct LintCase {
  LabelMap labels;
  Volume<float> scan;
  float air_below = -400;  ///< scan values of air

  Result<LintReport> report(double tool_radius_mm = kToolRadius_mm) const;
  /// Below the distance between the organs, above half a voxel.
  static constexpr double kToolRadius_mm = 1.9;
};

/// Organs (ellipsoids) in a trunk of a CT, apart from each other; size and place vary with the seed.
LintCase organs_case(unsigned seed);
/// The generated knee, coarse; its shape varies with the seed.
LintCase knee_case(unsigned seed);

/// A kind of fault that can be planted.
struct PlantedFault {
  LintKind kind;
  std::string_view name;
  /// Plants one; returns the structures that the finding must name (none: any), or nothing where this map has
  /// no room for it.
  std::function<std::optional<std::vector<LabelId>>(LintCase&, std::mt19937&)> plant;
};
const std::vector<PlantedFault>& planted_faults();

/// Whether a report has a finding of that kind and structures that the report before does not have.
bool is_found(const LintReport& after, const LintReport& before, LintKind kind,
              const std::vector<LabelId>& structures);

}  // namespace palpate::test
