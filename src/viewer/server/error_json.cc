#include "server/error_json.h"

#include <algorithm>
#include <array>

#include "palpate/base/contact_properties.h"
#include "palpate/base/force_method.h"
#include "palpate/base/printable.h"
#include "palpate/device/session_settings.h"

namespace palpate::server {
namespace {

constexpr std::array<std::string_view, 34> kWords{
    "role",
    // keys of requests (docs/reference/viewer-requests.md) other than settings and contact properties
    "at_s", "back_to", "begin", "code", "end", "entry_mm", "id", "learner", "name", "names", "near",
    "navigation", "patient_mm", "plan", "playing", "pointer", "poses_hz", "protocol", "remove", "save",
    "speed", "stop", "take", "target_mm", "task", "ticks", "tissue", "token", "trajectory", "type", "version",
    "yielded", kLawSetting};
constexpr std::array<std::string_view, 5> kLaws{"chainmail", "elastic", "exponential", "layers",
                                                "neo-hookean"};

bool is_setting(std::string_view context) {
  bool found = false;
  visit_settings([&](const auto& setting) { found = found || setting.name == context; });
  return found;
}

}  // namespace

bool is_word_of_protocol(std::string_view context) {
  return std::ranges::find(kWords, context) != kWords.end() || is_setting(context) ||
         std::ranges::find(kContactProperties, context, &ContactProperty::name) != kContactProperties.end() ||
         std::ranges::find(kLaws, context) != kLaws.end() || find_force_method(context).has_value();
}

Json error_json(const Error& error) {
  const std::string_view context = is_word_of_protocol(error.where) ? std::string_view(error.where) : "";
  return {{"what", printable_name(error.what)}, {"where", context}, {"how", printable(error.remedy)}};
}

}  // namespace palpate::server
