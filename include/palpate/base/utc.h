#pragma once

#include <string>

/// Wall-clock times in UTC as ISO 8601 text with whole seconds: "2026-03-01T12:34:56Z".
namespace palpate {

/// Current time.
std::string utc_now();
/// Time `after_s` seconds later, rounded down. A text of another form, or a number of seconds that is
/// negative or not finite, returns the text unchanged.
std::string utc_after(const std::string& utc, double after_s);

}  // namespace palpate
