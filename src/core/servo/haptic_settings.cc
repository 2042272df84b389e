#include "palpate/servo/haptic_settings.h"

#include <charconv>
#include <map>
#include <sstream>

namespace palpate {
namespace {

std::string shortest(double value) {
  char text[40];
  return {text, std::to_chars(text, text + sizeof text, value).ptr};
}

}  // namespace

std::string haptic_settings_text() {
  std::string text;
  visit_haptic_settings([&](const std::string& group, const char* name, double value) {
    text += group + "." + name + " " + shortest(value) + "\n";
  });
  return text;
}

std::string first_haptic_difference(const std::string& text) {
  std::map<std::string, std::string> was;
  std::istringstream lines(text);
  for (std::string name, value; lines >> name >> value;) was[name] = value;
  std::string other;
  visit_haptic_settings([&](const std::string& group, const char* name, double value) {
    const auto found = was.find(group + "." + name);
    const std::string before = found == was.end() ? "absent" : found->second;
    if (other.empty() && before != shortest(value))
      other = group + "." + name + " " + before + ", here " + shortest(value);
    if (found != was.end()) was.erase(found);
  });
  if (other.empty() && !was.empty()) other = was.begin()->first + " " + was.begin()->second + ", absent here";
  return other;
}

}  // namespace palpate
