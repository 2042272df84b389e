#include "session/setting_changes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <optional>
#include <utility>

#include "palpate/device/session_settings.h"
#include "palpate/palpation/plain_vectors.h"
#include "palpate/scene/named_values.h"

namespace palpate {
namespace {

/// Text that lists changes, joined by "and".
class ChangeList {
 public:
  ChangeList& add(const std::string& what) {
    text_ += (text_.empty() ? "" : ", and ") + what;
    return *this;
  }
  const std::string& text() const { return text_; }

 private:
  std::string text_;
};

// names come from files: control characters are replaced so that none can move a terminal's cursor
std::string plain_name(std::string name) {
  for (char& c : name)
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = '?';
  return name;
}

std::string consent_part(const SwitchInfo& info, bool requested, bool /*now*/) {
  return std::string(info.consent[requested ? 1 : 0]);
}
std::string consent_part(const SettingInfo<ForceMethod, std::string>& /*info*/, const std::string& requested,
                         ForceMethod /*now*/) {
  return "use the method " + requested;
}
std::string consent_part(const SettingInfo<double, double>& /*info*/, double target_N, double now_N) {
  return "set the force limit to " + rounded_text(target_N) + " N, now " + rounded_text(now_N);
}
std::string consent_part(const SettingInfo<Eigen::Quaterniond, std::array<double, 4>>& /*info*/,
                         const std::array<double, 4>& requested, const Eigen::Quaterniond& now) {
  constexpr double kDegrees = 180 / std::numbers::pi;
  const double by = now.angularDistance(quaternion(requested).normalized());
  return "turn the object by " + rounded_text(std::round(by * kDegrees * 10) / 10) + " degrees";
}

}  // namespace

std::string rounded_text(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.4g", value);
  return text;
}

SettingsRequest changes_of(SettingsRequest request, const Parameters& now, TissueLaw law, bool is_law_awaited,
                           bool is_method_awaited) {
  const std::optional<std::string> method = request.method;
  visit_settings([&](const auto& setting) {
    auto& requested = request.*setting.change;
    if (requested && *requested == message_value(now.*setting.value)) requested.reset();
  });
  if (is_method_awaited) request.method = method;
  if (!is_law_awaited && request.law == name_of(law, kTissueLaws)) request.law.reset();
  return request;
}

bool could_increase_force(const SettingsRequest& request, const Parameters& now) {
  return request.law || (request.max_force_N && *request.max_force_N > now.max_force_N) ||
         std::ranges::any_of(
             kSwitches, [&](const SwitchInfo& info) { return request.*info.change == info.riskier_value; });
}

std::string consent_text(const SettingsRequest& request, const Parameters& now) {
  ChangeList changes;
  visit_settings([&](const auto& setting) {
    if (const auto& change = request.*setting.change)
      changes.add(consent_part(setting, *change, now.*setting.value));
  });
  if (request.law) changes.add("use the soft-tissue law " + *request.law);
  return changes.text();
}

std::string consent_text(const std::string& tissue, const ContactProperties& before,
                         const ContactProperties& after) {
  ChangeList changes;
  for (const ContactProperty& property : kContactProperties) {
    const double from = before.*property.value, to = after.*property.value;
    if (from == to) continue;
    const std::string whose = changes.text().empty() ? plain_name(tissue) + "'s " : std::string("its ");
    changes.add("change " + whose + std::string(property.display_name) + " from " + rounded_text(from) +
                " to " + rounded_text(to) + (property.unit.empty() ? "" : " ") + std::string(property.unit));
  }
  return changes.text();
}

}  // namespace palpate
