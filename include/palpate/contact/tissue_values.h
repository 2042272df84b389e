#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/contact/model.h"

/// Permitted values of a tissue's parameters, in a scene and when changed at run time.
namespace palpate {

/// Description of an invalid value and its remedy.
struct TissueFault {
  std::string what, remedy;
};
/// Checks that static friction is at least the kinetic one.
std::optional<TissueFault> friction_fault(const ContactProperties& properties);

/// Values of a tissue needed to check its supports.
struct SupportValues {
  std::string_view name;
  double stiffness_N_per_mm = 0;
  bool touchable = true;
};
/// Checks that the field does not decrease from a tissue into its support; a decrease makes the force of the
/// direct methods point inward.
std::optional<TissueFault> support_fault(const SupportValues& tissue, const SupportValues& support);

/// Checks a tissue's values: ranges, friction and supports, with the messages used for a scene file.
/// @param tissues  all tissues
/// @param index    tissue whose values are new
/// Errors: kBadInput; Error::where is ContactProperty::name.
Result<void> check_tissue_values(const std::vector<Tissue>& tissues, std::size_t index);

}  // namespace palpate
