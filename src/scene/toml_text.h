#pragma once

#include <string>
#include <string_view>

namespace palpate {

/// True for well-formed UTF-8 (no overlong forms, no surrogates): all that TOML can hold.
bool is_utf8(std::string_view text);
/// A TOML basic string with its quotes, everything that needs it escaped. `text` is UTF-8.
std::string toml_string(std::string_view text);

}  // namespace palpate
