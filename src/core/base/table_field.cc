#include "palpate/base/table_field.h"

#include <string_view>

#include "palpate/base/printable.h"

namespace palpate {
namespace {

std::string no_formula(const std::string& text) {
  constexpr std::string_view kBegins = "=+-@\t\r\n";
  return !text.empty() && kBegins.find(text[0]) != kBegins.npos ? "'" + text : text;
}

}  // namespace

std::string csv_field(const std::string& plain) {
  const std::string text = no_formula(plain);
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) quoted += c == '"' ? "\"\"" : std::string(1, c);
  return quoted + "\"";
}

std::string tsv_field(const std::string& text) {
  return printable_name(no_formula(text));
}

}  // namespace palpate
