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

/// A label map with its scan, as passed to lint().
struct LintCase {
  LabelMap labels;
  Volume<float> scan;
  float air_below = -400;  ///< Scan values below this are air

  Result<LintReport> report(double tool_radius_mm = kToolRadius_mm) const;
  /// Below the distance between the organs, above half a voxel.
  static constexpr double kToolRadius_mm = 1.9;
};

/// Organs (ellipsoids) in the trunk of a CT, separated from each other; size and position vary with the
/// seed.
LintCase organs_case(unsigned seed);
/// The generated knee at a coarse resolution; its shape varies with the seed.
LintCase knee_case(unsigned seed);

/// A kind of fault that can be planted.
struct PlantedFault {
  LintKind kind;
  std::string_view name;
  /// Plants one fault and returns the structures that the finding must name (empty: any), or nothing if
  /// there is no space for it in this map.
  std::function<std::optional<std::vector<LabelId>>(LintCase&, std::mt19937&)> plant;
};
const std::vector<PlantedFault>& planted_faults();

/// Whether a report has a finding of that kind and those structures that the previous report does not have.
bool is_found(const LintReport& after, const LintReport& before, LintKind kind,
              const std::vector<LabelId>& structures);

}  // namespace palpate::test
