#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "palpate/rendering/markup.h"

/// Formatting and escaping of text for HTML pages.
namespace palpate::report {

using markup::base64, markup::css_colour, markup::escape;

/// Quoted JSON string that is safe within a script element.
std::string json_string(std::string_view text);
/// JSON number, rounded, without trailing zeros; null if not finite.
std::string json_number(double value, int decimals);

/// Fixed number of decimals, with a decimal point in any locale; "-" if not finite; never "-0".
std::string number(double value, int decimals);
/// Three significant digits: "1230", "12.3", "0.0123"; "0" for 0, "-" if not finite.
std::string three_digits(double value);
/// "0.63 mm", "-0.63 mm, 0.63 mm in front of the segmented surface"; "not measured" if not finite.
std::string depth_text(double depth_mm);
/// Integer with digits grouped by three.
std::string grouped(std::uint64_t value);
/// 16 lower-case hexadecimal digits.
std::string hex(std::uint64_t value);

/// Table cell; `value` is HTML.
std::string cell(const std::string& value);
/// Term and value of a description list; empty if the value is empty. `value` is text.
std::string entry(const std::string& term, const std::string& value, bool code = false);

/// Content-security-policy source of an inline script or style, 'sha256-...'. The argument is the hash in
/// hexadecimal.
std::string csp_hash(std::string_view sha256_hex);

}  // namespace palpate::report
