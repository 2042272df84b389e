#pragma once

#include <algorithm>
#include <array>
#include <optional>
#include <string_view>

/// Contact properties of a tissue that may change while it is rendered, with their description. Checks,
/// consent texts, viewer messages and recordings are derived from the table below.
namespace palpate {

/// Closed range of values.
struct ValueRange {
  double min, max;
};

struct ContactProperties {
  double stiffness_N_per_mm = 1.0;  ///< Force per depth below the surface
  /// Coefficient up to which the proxy sticks; at least `friction`. The direct methods do not stick.
  double static_friction = 0.1;
  double friction = 0.1;  ///< Kinetic friction coefficient: tangential over normal force while sliding
  double viscosity_N_s_per_mm = 0.001;  ///< Viscous force inside the tissue per velocity

  /// Sets both coefficients, without a difference between sticking and sliding.
  void set_friction(double coefficient) { static_friction = friction = coefficient; }

  friend bool operator==(const ContactProperties&, const ContactProperties&) = default;
};

/// Description of one contact property.
struct ContactProperty {
  double ContactProperties::*value;
  std::string_view name;          ///< With its unit: viewer messages, recordings
  std::string_view key;           ///< In scene files
  std::string_view display_name;  ///< In texts for users
  std::string_view unit;          ///< In texts for users; empty: dimensionless
  std::string_view ascii_unit;    ///< In recordings; "1": dimensionless
  ValueRange range;               ///< Permitted values
  std::string_view about;         ///< In the manual of scene files
};

/// All contact properties, in the order of the members of ContactProperties.
inline constexpr std::array<ContactProperty, 4> kContactProperties{
    {{&ContactProperties::stiffness_N_per_mm,
      "stiffness_N_per_mm",
      "stiffness",
      "stiffness",
      "N/mm",
      "N/mm",
      {0.001, 20},
      "Force per mm of depth. With inward ramps it applies from the surface on; with a union Gaussian, whose "
      "slope varies with depth, at the surface, where the field is steepest "
      "([scene.md](../guide/scene.md#what-stiffness-means))."},
     {&ContactProperties::static_friction,
      "static_friction",
      "static_friction",
      "static friction",
      "",
      "1",
      {0, 2},
      "For the proxy: coefficient of static friction, at least `friction`. Default: `friction`."},
     {&ContactProperties::friction,
      "friction",
      "friction",
      "friction",
      "",
      "1",
      {0, 2},
      "Kinetic friction coefficient: maximum ratio of the tangential to the normal force."},
     {&ContactProperties::viscosity_N_s_per_mm,
      "viscosity_N_s_per_mm",
      "viscosity",
      "viscosity",
      "N·s/mm",
      "N s/mm",
      {0, 0.1},
      "Resistance per mm/s inside the tissue."}}};

/// Whether the table lists all members in their order, so that member n lies n doubles behind the first.
constexpr bool lists_every_contact_property() {
  constexpr ContactProperties kNumbered{0, 1, 2, 3};
  for (std::size_t n = 0; n < kContactProperties.size(); ++n)
    if (kNumbered.*kContactProperties[n].value != static_cast<double>(n)) return false;
  return sizeof(ContactProperties) == kContactProperties.size() * sizeof(double);
}
static_assert(lists_every_contact_property());

/// Description of a property by its member.
constexpr const ContactProperty& contact_property(double ContactProperties::*value) {
  return *std::find_if(kContactProperties.begin(), kContactProperties.end(),
                       [&](const ContactProperty& property) { return property.value == value; });
}

/// Requested values of some contact properties.
class ContactPropertyChanges {
 public:
  std::optional<double>& operator[](double ContactProperties::*value) {
    return values_[static_cast<std::size_t>(&contact_property(value) - kContactProperties.data())];
  }
  bool empty() const { return values_ == std::array<std::optional<double>, kContactProperties.size()>(); }
  ContactProperties applied_to(ContactProperties properties) const {
    for (std::size_t n = 0; n < values_.size(); ++n)
      if (values_[n]) properties.*kContactProperties[n].value = *values_[n];
    return properties;
  }

 private:
  std::array<std::optional<double>, kContactProperties.size()> values_;
};

}  // namespace palpate
