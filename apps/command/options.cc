#include <charconv>
#include <cstdlib>

#include "options.h"

namespace palpate::app {
namespace {

// shortest decimal: 0.1 as "0.1", 1e9 as "1000000000"
std::string shortest(double value) {
  char text[400];
  return {text, std::to_chars(text, text + sizeof text, value, std::chars_format::fixed).ptr};
}

}  // namespace

CLI::Validator number_between(double low, double high) {
  const std::string range = shortest(low) + " and " + shortest(high);
  return {[=](std::string& text) -> std::string {
            char* end = nullptr;
            const double value = std::strtod(text.c_str(), &end);
            // false for NaN as well
            const bool inside = value >= low && value <= high;
            return !text.empty() && *end == '\0' && inside ? "" : text + " is not a number between " + range;
          },
          shortest(low) + " ... " + shortest(high)};
}

CLI::Validator whole_between(std::uint64_t low, std::uint64_t high) {
  return {[=](std::string& text) -> std::string {
            std::uint64_t value = 0;
            const char* last = text.data() + text.size();
            const auto [end, failed] = std::from_chars(text.data(), last, value);
            const bool whole = failed == std::errc() && end == last;
            return whole && value >= low && value <= high
                       ? ""
                       : text + " is not a whole number between " + std::to_string(low) + " and " +
                             std::to_string(high);
          },
          std::to_string(low) + " ... " + std::to_string(high)};
}

CLI::Option* add_numbers(CLI::App& verb, const std::string& name, std::vector<double>& numbers, int count,
                         double largest, const std::string& help) {
  return verb.add_option(name, numbers, help)
      ->delimiter(',')
      ->expected(count)
      ->check(number_between(-largest, largest));
}

}  // namespace palpate::app
