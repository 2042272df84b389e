#pragma once

#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/scene/scene.h"

/// Default mechanical properties of the kinds of tissue, with their sources.
namespace palpate {

/// Default mechanical properties of a kind of tissue, with their source.
struct TissuePreset {
  std::string name;  ///< Name, a choice of the key `preset`: bone, cartilage, muscle, liver, ...
  TissueSettings values;
  std::array<double, 2> range_kPa{};  ///< Range of Young's modulus; 0 for a preset without elastic constants
  std::string source;                 ///< Publication, its value, and the derivation of ours
  std::vector<std::string> kind_words;       ///< Lower-case words that denote the material of a structure
  std::vector<std::string> structure_names;  ///< Lower-case names of structures made of it
};
/// All presets.
const std::vector<TissuePreset>& tissue_presets();
/// Preset by name, or nullptr.
const TissuePreset* find_preset(std::string_view name);
/// Preset suggested by a structure's name.
struct PresetMatch {
  const TissuePreset* preset = nullptr;  ///< Preset; null: none
  std::string term;        ///< Term of the name that decided, e.g. "sterno thyroid"; empty: no known term
  bool is_hollow = false;  ///< Whether the term denotes air, fluid or a cavity: no resistance
};
/// Matches a structure's name against whole terms of one or more words. Words are compared ignoring case,
/// plural s, numbers and separators ("Left-Cerebral-White-Matter"); a word counts only as part of the longest
/// matching term that contains it ("sterno_thyroid" is a muscle). Precedence: contents (cyst, air, implant),
/// then kinds of tissue ("patellar_cartilage" is cartilage), then names of structures; among equals the last
/// term in the name, then the longest.
PresetMatch match_preset(const std::string& structure_name);

/// The presets with their values and sources as a Markdown table.
std::string tissue_preset_table();
/// Elastic constants of each preset with range and source, as a Markdown table.
std::string elastic_preset_table();
/// Relaxation of each preset with range and source, as a Markdown table.
std::string relaxation_preset_table();

}  // namespace palpate
