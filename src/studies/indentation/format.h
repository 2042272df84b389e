#pragma once

#include <cstdio>
#include <string>

namespace palpate {

/// Text by printf's pattern, at most 400 characters.
template <class... Values>
std::string printed(const char* pattern, Values... values) {
  char text[400];
  std::snprintf(text, sizeof text, pattern, values...);
  return text;
}

}  // namespace palpate
