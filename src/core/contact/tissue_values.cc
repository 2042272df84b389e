#include "palpate/contact/tissue_values.h"

#include <cmath>
#include <sstream>
#include <utility>

namespace palpate {
namespace {

template <class... Parts>
std::string text_of(const Parts&... parts) {
  std::ostringstream text;
  (text << ... << parts);
  return text.str();
}

SupportValues support_values(const Tissue& tissue) {
  return {tissue.name, tissue.stiffness_N_per_mm, tissue.touchable};
}

}  // namespace

std::optional<TissueFault> friction_fault(const ContactProperties& properties) {
  if (properties.static_friction >= properties.friction) return std::nullopt;
  return TissueFault{text_of("static_friction = ", properties.static_friction,
                             " is less than friction = ", properties.friction),
                     "static friction must be at least as large as sliding friction"};
}

std::optional<TissueFault> support_fault(const SupportValues& tissue, const SupportValues& support) {
  if (!support.touchable)
    return TissueFault{
        text_of("tissue \"", tissue.name, "\" rests on \"", support.name, "\", which is not touchable"),
        "the force would point inward where they meet; set both touchable, or remove it from rests_on"};
  if (tissue.stiffness_N_per_mm <= support.stiffness_N_per_mm) return std::nullopt;
  return TissueFault{
      text_of("tissue \"", tissue.name, "\" (", tissue.stiffness_N_per_mm, " N/mm) is stiffer than \"",
              support.name, "\" (", support.stiffness_N_per_mm, " N/mm), which it rests on"),
      "the force would point inward where they meet; make the upper one no stiffer than the lower one"};
}

Result<void> check_tissue_values(const std::vector<Tissue>& tissues, std::size_t index) {
  const auto error = [](TissueFault fault, std::string_view name) {
    return Error{ErrorKind::kBadInput, std::move(fault.what), std::string(name), std::move(fault.remedy)};
  };
  const Tissue& changed = tissues[index];
  for (const ContactProperty& property : kContactProperties) {
    const double value = changed.*property.value;
    const auto& [min, max] = property.range;
    const std::string range = text_of(min, " ... ", max, property.unit.empty() ? "" : " ", property.unit);
    const std::string remedy = text_of(property.key, " takes a number, ", range);
    if (!std::isfinite(value))
      return error({text_of(property.key, " is not a finite number"), remedy}, property.name);
    if (value < min || value > max)
      return error({text_of(property.key, " = ", value, " is outside ", range), remedy}, property.name);
  }
  if (auto fault = friction_fault(changed))
    return error(*std::move(fault), contact_property(&ContactProperties::static_friction).name);
  for (const Tissue& tissue : tissues) {
    if (!tissue.touchable) continue;
    for (const int support : tissue.rests_on)
      if (auto fault = support_fault(support_values(tissue),
                                     support_values(tissues[static_cast<std::size_t>(support)])))
        return error(*std::move(fault), contact_property(&ContactProperties::stiffness_N_per_mm).name);
  }
  return {};
}

}  // namespace palpate
