#pragma once

#include <string>
#include <string_view>

namespace palpate {

/// Whether the text is well-formed UTF-8 (no overlong forms, no surrogates), as TOML requires.
bool is_utf8(std::string_view text);
/// Quotes and escapes a text as a TOML basic string. `text` is UTF-8.
std::string toml_string(std::string_view text);

}  // namespace palpate
