#pragma once

#include <string>
#include <string_view>

namespace palpate {

/// Text that is safe to show on a terminal, in a log or on a page. Escaped as in JSON ("\u001b"): control
/// characters (C0 except tab and line feed, DEL, C1), invisible characters that change the writing direction
/// or end a line (U+061C, U+200E, U+200F, U+2028 to U+202E, U+2066 to U+2069), the byte order mark,
/// interlinear annotations and tags. Bytes that are not valid UTF-8 become "\x9b". All other text is
/// unchanged.
std::string printable(std::string_view text);
/// Same as printable(), with line feeds and tabs escaped too: for a name that appears within a line.
std::string printable_name(std::string_view name);

/// Same as printable(), for text that arrives in pieces, which may end within a character.
class PrintableStream {
 public:
  /// Printable text of this piece, preceded by an incomplete character left from the previous one.
  std::string next(std::string_view piece);

 private:
  std::string begun_;
};

}  // namespace palpate
