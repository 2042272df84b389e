#include "palpate/haptics/tissue_values.h"

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
  return {tissue.name, tissue.stiffness_N_per_mm, tissue.felt};
}

}  // namespace

std::optional<TissueFault> friction_fault(double static_friction, double friction) {
  if (static_friction >= friction) return std::nullopt;
  return TissueFault{text_of("static_friction = ", static_friction, " is less than friction = ", friction),
                     "what sticks holds at least as much as what slides"};
}

std::optional<TissueFault> support_fault(const SupportValues& tissue, const SupportValues& support) {
  if (!support.felt)
    return TissueFault{
        text_of("tissue \"", tissue.name, "\" rests on \"", support.name, "\", which is not felt"),
        "the force would point inward where they meet; let both be felt, or take it out of rests_on"};
  if (tissue.stiffness_N_per_mm <= support.stiffness_N_per_mm) return std::nullopt;
  return TissueFault{
      text_of("tissue \"", tissue.name, "\" (", tissue.stiffness_N_per_mm, " N/mm) is stiffer than \"",
              support.name, "\" (", support.stiffness_N_per_mm, " N/mm), which it rests on"),
      "the force would point inward where they meet; make the upper one at most as stiff"};
}

Result<void> check_tissue_values(const std::vector<Tissue>& tissues, std::size_t index) {
  const auto error = [](TissueFault fault, const char* key) {
    return Error{ErrorKind::kBadInput, std::move(fault.what), key, std::move(fault.remedy)};
  };
  const Tissue& changed = tissues[index];
  struct Number {
    const char* key;
    double value;
    ValueRange range;
    const char* unit;
  };
  const Number numbers[] = {
      {"stiffness", changed.stiffness_N_per_mm, kStiffnessRange_N_per_mm, " N/mm"},
      {"friction", changed.friction_coefficient, kFrictionRange, ""},
      {"static_friction", changed.static_friction, kFrictionRange, ""},
      {"viscosity", changed.viscosity_N_s_per_mm, kViscosityRange_N_s_per_mm, " N·s/mm"}};
  for (const Number& number : numbers) {
    const auto& [min, max] = number.range;
    const std::string range = text_of(min, " ... ", max, number.unit);
    const std::string remedy = text_of(number.key, " takes a number, ", range);
    if (!std::isfinite(number.value))
      return error({text_of(number.key, " is not a finite number"), remedy}, number.key);
    if (number.value < min || number.value > max)
      return error({text_of(number.key, " = ", number.value, " is outside ", range), remedy}, number.key);
  }
  if (auto fault = friction_fault(changed.static_friction, changed.friction_coefficient))
    return error(*std::move(fault), "static_friction");
  for (const Tissue& tissue : tissues) {
    if (!tissue.felt) continue;
    for (const int support : tissue.rests_on)
      if (auto fault = support_fault(support_values(tissue),
                                     support_values(tissues[static_cast<std::size_t>(support)])))
        return error(*std::move(fault), "stiffness");
  }
  return {};
}

}  // namespace palpate
