#pragma once

#include <cstdio>
#include <string>

namespace palpate {

/// Number with the fewest digits: "0.5", "1", "10".
inline std::string short_number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%g", value);
  return text;
}

/// Name of a control loop, e.g. "1kHz/delay-0.5ms"
inline std::string loop_name(double rate_hz, double delay_s) {
  return short_number(rate_hz / 1000) + "kHz/delay-" + short_number(delay_s * 1000) + "ms";
}

}  // namespace palpate
