#pragma once

#include <string>

namespace palpate {

/// A field of a table that people open in a spreadsheet. Text that a spreadsheet would take for a formula (it
/// begins with = + - @, a tab or a line end) is preceded by an apostrophe; numbers are written without these.
/// csv_field: of RFC 4180. tsv_field: what would end it or command a terminal is spelled out
/// (printable_name).
std::string csv_field(const std::string& text);
std::string tsv_field(const std::string& text);

}  // namespace palpate
