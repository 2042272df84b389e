#include "server/error_json.h"

#include <algorithm>
#include <array>

#include "palpate/base/contact_properties.h"
#include "palpate/base/force_method.h"
#include "palpate/base/printable.h"

namespace palpate::server {
namespace {

constexpr std::array<std::string_view, 40> kWords{
    "role",
    // keys of requests (docs/reference/viewer-requests.md)
    "at_s", "back_to", "begin", "code", "end", "entry_mm", "friction", "id", "law", "learner", "max_force_N",
    "method", "motor", "name", "names", "near", "navigation", "passivity", "patient_mm", "paused", "plan",
    "playing", "poses_hz", "protocol", "remove", "rotation_wxyz", "save", "speed", "stop", "take",
    "target_mm", "task", "tissue", "token", "trajectory", "type", "version", "viscosity", "yielded"};
constexpr std::array<std::string_view, 4> kLaws{"chainmail", "elastic", "layers", "neo-hookean"};

}  // namespace

bool is_word_of_protocol(std::string_view place) {
  return std::ranges::find(kWords, place) != kWords.end() ||
         std::ranges::find(kContactProperties, place, &ContactProperty::name) != kContactProperties.end() ||
         std::ranges::find(kLaws, place) != kLaws.end() || find_force_method(place).has_value();
}

Json error_json(const Error& error) {
  const std::string_view place = is_word_of_protocol(error.where) ? std::string_view(error.where) : "";
  return {{"what", printable_name(error.what)}, {"where", place}, {"how", printable(error.remedy)}};
}

}  // namespace palpate::server
