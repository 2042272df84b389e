#include "palpate/device/session_settings.h"

namespace palpate {
namespace {

bool are_same(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b) {
  return a.coeffs() == b.coeffs();
}
template <class Value>
bool are_same(const Value& a, const Value& b) {
  return a == b;
}

}  // namespace

void apply_changes(const SettingsChanges& changes, Settings& settings) {
  for (const SwitchInfo& info : kSwitches)
    settings.*info.value = (changes.*info.change).value_or(settings.*info.value);
  settings.max_force_N = changes.max_force_N.value_or(settings.max_force_N);
  if (!changes.rotation_wxyz) return;
  const auto& [w, x, y, z] = *changes.rotation_wxyz;
  settings.rotation_target = Eigen::Quaterniond(w, x, y, z).normalized();
}

std::uint16_t changed_settings(const Settings& before, const Settings& after) {
  unsigned changed = 0;
  visit_settings([&](const auto& setting) {
    if (!are_same(before.*setting.value, after.*setting.value)) changed |= setting.changed;
  });
  return static_cast<std::uint16_t>(changed);
}

}  // namespace palpate
