#include <algorithm>
#include <string>
#include <tuple>
#include <vector>

#include "palpate/scene/tissue_presets.h"

namespace palpate {
namespace {

bool is_upper(char c) {
  return c >= 'A' && c <= 'Z';
}
bool is_letter(char c) {
  return is_upper(c) || (c >= 'a' && c <= 'z');
}

/// Splits a name into runs of letters in lower case; "LeftFemur2" gives "left", "femur".
std::vector<std::string> words_of(const std::string& name) {
  std::vector<std::string> words;
  char before = ' ';
  for (const char c : name) {
    if (is_letter(c)) {
      if (!is_letter(before) || (is_upper(c) && !is_upper(before))) words.emplace_back();
      words.back() += static_cast<char>(is_upper(c) ? c - 'A' + 'a' : c);
    }
    before = c;
  }
  return words;
}

// Contents that are not tissue and do not resist, regardless of the structure they are in.
const std::vector<std::string> kHollowContents{"cyst", "fluid", "effusion", "lumen", "air", "gas", "csf"};
// Cavities that hold air or fluid.
const std::vector<std::string> kHollowStructures{"airway",
                                                 "trachea",
                                                 "bronchus",
                                                 "bronchi",
                                                 "bronchia",
                                                 "pharynx",
                                                 "nasopharynx",
                                                 "oropharynx",
                                                 "hypopharynx",
                                                 "nasal cavity",
                                                 "auditory canal",
                                                 "ear canal",
                                                 "maxillary sinus",
                                                 "sinus maxillary",
                                                 "frontal sinus",
                                                 "sinus frontal",
                                                 "sphenoid sinus",
                                                 "ethmoid sinus",
                                                 "paranasal sinus",
                                                 "lateral ventricle",
                                                 "third ventricle",
                                                 "fourth ventricle",
                                                 "ventricle frontal horn",
                                                 "ventricle occipital horn",
                                                 "ventricle temporal horn",
                                                 "ventricle body",
                                                 "ventricle trigone",
                                                 "subarachnoid space"};
// Solid contents without a sourced preset, regardless of the structure they are in.
const std::vector<std::string> kForeignContents{"implant",  "prosthesis", "endoprosthesis",
                                                "stent",    "hemorrhage", "haemorrhage",
                                                "hematoma", "haematoma",  "thrombus"};
// Tissues that would otherwise match the cavity they enclose.
const std::vector<std::string> kUnsourcedStructures{"airway wall"};

/// Precedence of a term, ascending: enclosing structure, kind of tissue, contents.
enum class TermRank { kStructure, kKind, kContent };

struct Term {
  std::string text;
  std::vector<std::string> words;
  TermRank rank;
  const TissuePreset* preset;  ///< Preset; null: none
  bool is_hollow;
};

std::vector<Term> make_terms() {
  std::vector<Term> terms;
  const auto add = [&](const std::vector<std::string>& texts, TermRank rank, const TissuePreset* preset,
                       bool is_hollow) {
    for (const std::string& text : texts) terms.push_back({text, words_of(text), rank, preset, is_hollow});
  };
  for (const TissuePreset& preset : tissue_presets()) {
    add(preset.kind_words, TermRank::kKind, &preset, false);
    add(preset.structure_names, TermRank::kStructure, &preset, false);
  }
  add(kHollowContents, TermRank::kContent, nullptr, true);
  add(kForeignContents, TermRank::kContent, nullptr, false);
  add(kHollowStructures, TermRank::kStructure, nullptr, true);
  add(kUnsourcedStructures, TermRank::kStructure, nullptr, false);
  return terms;
}

/// A match of a term in a name: words [begin, end).
struct TermMatch {
  const Term* term;
  std::size_t begin, end;

  bool is_within(const TermMatch& other) const {
    return other.begin <= begin && end <= other.end && other.end - other.begin > end - begin;
  }
  auto precedence() const { return std::tuple(term->rank, end, end - begin); }
};

std::vector<TermMatch> find_terms(const std::vector<std::string>& words) {
  static const std::vector<Term> terms = make_terms();
  const auto is_same = [](const std::string& word, const std::string& of_term) {
    return word == of_term || word == of_term + "s";
  };
  std::vector<TermMatch> matches;
  for (const Term& term : terms)
    for (std::size_t n = 0; n + term.words.size() <= words.size(); ++n)
      if (std::equal(
              term.words.begin(), term.words.end(), words.begin() + static_cast<std::ptrdiff_t>(n),
              [&](const std::string& of_term, const std::string& word) { return is_same(word, of_term); }))
        matches.push_back({&term, n, n + term.words.size()});
  return matches;
}

}  // namespace

PresetMatch match_preset(const std::string& structure_name) {
  const std::vector<TermMatch> matches = find_terms(words_of(structure_name));
  const TermMatch* best = nullptr;
  for (const TermMatch& match : matches) {
    // a word counts only in the longest term that contains it: the thyroid of "sterno thyroid" is not a gland
    if (std::ranges::any_of(matches, [&](const TermMatch& other) { return match.is_within(other); }))
      continue;
    if (!best || match.precedence() > best->precedence()) best = &match;
  }
  if (!best) return {};
  return {best->term->preset, best->term->text, best->term->is_hollow};
}

}  // namespace palpate
