#pragma once

#include <string>

namespace palpate {

/// Field of a table that people open in a spreadsheet. Text that a spreadsheet would take for a formula (it
/// begins with = + - @, a tab or a line end) is preceded by an apostrophe; numbers are written without these
/// functions. csv_field: quoted as in RFC 4180. tsv_field: tabs, line ends and terminal control characters
/// are escaped (printable_name).
std::string csv_field(const std::string& text);
std::string tsv_field(const std::string& text);

}  // namespace palpate
