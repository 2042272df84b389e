#pragma once

#include <iosfwd>
#include <string>
#include <vector>

namespace palpate::app {

/// Width of a UTF-8 text on a terminal, in columns.
std::size_t display_width(const std::string& text);

/// Pads the text with spaces, or truncates it with an ellipsis, to a width in columns.
std::string pad_or_truncate(std::string text, std::size_t width);

/// Prints a text broken at spaces so that no line passes 100 columns.
/// @param first   before the first line
/// @param others  before every other line
void print_wrapped(std::ostream& out, const std::string& text, const std::string& first,
                   const std::string& others);

/// The candidate of which a word is most likely a misspelling; empty if none is close. Close means at most
/// two letters inserted, removed, replaced or swapped, and less than half of the word.
std::string closest_match(const std::string& word, const std::vector<std::string>& candidates);

}  // namespace palpate::app
