#pragma once

#include <string>
#include <vector>

namespace palpate::app {

/// Columns that a UTF-8 text takes on a terminal.
std::size_t columns_of(const std::string& text);

/// The text padded with spaces, or cut with an ellipsis, to a width in columns.
std::string fitted(std::string text, std::size_t width);

/// The candidate that a mistyped word most likely meant, or an empty text when none is near: at most two
/// letters inserted, removed, replaced or swapped, and less than half of the word.
std::string nearest(const std::string& word, const std::vector<std::string>& candidates);

}  // namespace palpate::app
