#pragma once

#include <string>
#include <string_view>

namespace palpate {

/// Text that is safe to show on a terminal, in a log or in a page: what would command it instead of being
/// read is spelled out, everything else stays. Spelled out as in JSON, "\u001b", are control characters (C0
/// but for tab and line end, DEL, C1), what turns the direction of writing or ends a line unseen (U+061C,
/// U+200E, U+200F, U+2028 to U+202E, U+2066 to U+2069), the byte order mark, annotations and tags; bytes that
/// are no UTF-8 become "\x9b".
std::string printable(std::string_view text);
/// The same, with line ends and tabs spelled out too: for a name, which stands within a line.
std::string printable_name(std::string_view name);

/// The same for text that comes in pieces, which may end within a character.
class PrintableStream {
 public:
  /// What can be shown of this piece and what was left of the one before.
  std::string next(std::string_view piece);

 private:
  std::string begun_;
};

}  // namespace palpate
