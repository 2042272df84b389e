#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "palpate/rendering/markup.h"

/// Text that is safe to put into a page.
namespace palpate::report {

using markup::base64, markup::css_colour, markup::escape;

/// A quoted JSON string that may stand inside a script element.
std::string json_string(std::string_view text);
/// A JSON number, rounded, without trailing zeros; null when not finite.
std::string json_number(double value, int decimals);

/// Fixed decimals and a point whatever the locale; "-" when not finite; never "-0".
std::string number(double value, int decimals);
/// Three significant digits, "1230", "12.3", "0.0123"; "0" for 0, "-" when not finite.
std::string three_digits(double value);
/// "0.63 mm", "-0.63 mm, 0.63 mm in front of the segmented surface"; "not measured" when not finite.
std::string depth_text(double depth_mm);
/// Digits in groups of three.
std::string grouped(std::uint64_t value);
/// 16 lower-case hexadecimal digits.
std::string hex(std::uint64_t value);

/// A cell of a table; `value` is HTML.
std::string cell(const std::string& value);
/// A term and its value in a list of them; nothing when the value is empty. `value` is text.
std::string entry(const std::string& term, const std::string& value, bool code = false);

/// The content-security-policy source for an inline script or style: 'sha256-...', from the hash in
/// hexadecimal.
std::string csp_hash(std::string_view sha256_hex);

}  // namespace palpate::report
