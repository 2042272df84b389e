#include "text.h"

#include <algorithm>
#include <numeric>
#include <ostream>
#include <sstream>
#include <utility>

namespace palpate::app {
namespace {

// UTF-8 continuation bytes have no width
bool continues(char c) {
  return (static_cast<unsigned char>(c) & 0xC0) == 0x80;
}

// optimal string alignment distance (insert, remove, replace, swap neighbours), with three rows of the table
std::size_t edit_distance(const std::string& a, const std::string& b) {
  std::vector<std::size_t> before(b.size() + 1), above(b.size() + 1), row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 0; i < a.size(); ++i) {
    before = std::exchange(above, row);
    row[0] = i + 1;
    for (std::size_t j = 0; j < b.size(); ++j) {
      row[j + 1] = std::min({above[j] + (a[i] != b[j]), above[j + 1] + 1, row[j] + 1});
      if (i > 0 && j > 0 && a[i] == b[j - 1] && a[i - 1] == b[j])
        row[j + 1] = std::min(row[j + 1], before[j - 1] + 1);
    }
  }
  return row.back();
}

}  // namespace

std::size_t display_width(const std::string& text) {
  return text.size() - static_cast<std::size_t>(std::count_if(text.begin(), text.end(), continues));
}

std::string pad_or_truncate(std::string text, std::size_t width) {
  if (display_width(text) > width) {
    while (display_width(text) > width - 1) {
      while (continues(text.back())) text.pop_back();
      text.pop_back();
    }
    text += "…";
  }
  return text + std::string(width - display_width(text), ' ');
}

void print_wrapped(std::ostream& out, const std::string& text, const std::string& first,
                   const std::string& others) {
  constexpr std::size_t kColumns = 100;
  std::istringstream words(text);
  std::string line = first, word;
  bool begun = false;
  while (words >> word) {
    if (begun && line.size() + 1 + word.size() > kColumns) {
      out << line << '\n';
      line = others;
      begun = false;
    }
    line += (begun ? " " : "") + word;
    begun = true;
  }
  out << line << '\n';
}

std::string closest_match(const std::string& word, const std::vector<std::string>& candidates) {
  std::string best;
  std::size_t fewest = std::min<std::size_t>(3, (word.size() + 1) / 2);
  for (const std::string& candidate : candidates) {
    const std::size_t edits = edit_distance(word, candidate);
    if (edits >= fewest) continue;
    fewest = edits;
    best = candidate;
  }
  return best;
}

}  // namespace palpate::app
