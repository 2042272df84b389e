#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "palpate/scene/named_values.h"
#include "palpate/scene/new_scene.h"
#include "palpate/scene/scene.h"
#include "palpate/scene/tissue_presets.h"
#include "scene/keys.h"
#include "scene/toml_text.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

/// Path of a data file as written in the scene: relative if below the folder, otherwise absolute.
std::string written_path(const fs::path& file, const fs::path& folder) {
  std::error_code failed;
  const fs::path whole = fs::absolute(file, failed).lexically_normal();
  const fs::path base = fs::absolute(folder.empty() ? fs::path(".") : folder, failed).lexically_normal();
  const fs::path relative = whole.lexically_relative(base);
  return relative.empty() || *relative.begin() == ".." ? whole.string() : relative.string();
}

/// Reference to a structure in labels = [...]: its name if unique and valid UTF-8, otherwise its number.
std::string written_label(const Segment& segment, const std::map<std::string, int>& uses) {
  const bool by_name = !segment.name.empty() && is_utf8(segment.name) && uses.at(segment.name) == 1;
  return by_name ? toml_string(segment.name) : std::to_string(segment.id);
}

struct Group {
  const TissuePreset* preset = nullptr;  ///< Preset; null: no name suggested one
  std::string name;
  std::vector<const Segment*> segments;
  std::vector<PresetMatch> matches;  ///< Match of each segment's name
  bool is_touched_unknown = false;   ///< No name suggests a tissue, and touch_unknown is set
};

/// Stiffness of a structure of which nothing is known, N/mm.
constexpr const char* kUnknownStiffness = "1.0";

/// Returns a name that no tissue of the scene has.
std::string unused_name(const Segment& segment, std::set<std::string>& taken_names) {
  const std::string number = std::to_string(segment.id);
  std::string name = "label " + number;
  if (!segment.name.empty() && is_utf8(segment.name) && segment.name.find('\0') == std::string::npos)
    name = segment.name;
  while (!taken_names.insert(name).second) name += " (" + number + ")";
  return name;
}

std::vector<Group> group_structures(const LabelMap& labels, bool touch_unknown) {
  // one tissue per preset, in the order of the presets
  std::vector<Group> groups;
  Group others{nullptr, "other structures", {}, {}};
  for (const TissuePreset& preset : tissue_presets()) groups.push_back({&preset, preset.name, {}, {}});
  for (const Segment& segment : labels.segments) {
    const PresetMatch match = match_preset(segment.name);
    Group& group =
        match.preset ? groups[static_cast<std::size_t>(match.preset - tissue_presets().data())] : others;
    group.segments.push_back(&segment);
    group.matches.push_back(match);
  }
  std::erase_if(groups, [](const Group& group) { return group.segments.empty(); });
  const bool none_known = groups.empty();

  // the others individually, or in one tissue
  std::set<std::string> taken_names;
  for (const Group& group : groups) taken_names.insert(group.name);
  if (groups.size() + others.segments.size() <= kMaxTissues) {
    for (std::size_t n = 0; n < others.segments.size(); ++n)
      groups.push_back({nullptr,
                        unused_name(*others.segments[n], taken_names),
                        {others.segments[n]},
                        {others.matches[n]}});
  } else {
    groups.push_back(std::move(others));
  }
  // a name that is known but has no preset denotes air, a fluid, or contents of unpublished stiffness
  if (touch_unknown && none_known)
    for (Group& group : groups)
      group.is_touched_unknown =
          std::ranges::all_of(group.matches, [](const PresetMatch& m) { return m.term.empty(); });
  return groups;
}

/// Default law: elastic if any tissue has a modulus and no law was requested.
TissueLaw law_for(const NewSceneInput& input, const std::vector<Group>& groups) {
  const bool soft = std::any_of(groups.begin(), groups.end(), [](const Group& group) {
    return group.preset != nullptr && group.preset->values.elastic;
  });
  return input.law.value_or(soft ? TissueLaw::kElastic : TissueLaw::kLayers);
}

/// Default support: cartilage on bone, meniscus on cartilage, if the scene has both.
std::string support_of(const Group& group, const std::vector<Group>& groups) {
  if (!group.preset) return "";
  const std::string support = group.preset->name == "cartilage"  ? "bone"
                              : group.preset->name == "meniscus" ? "cartilage"
                                                                 : "";
  const bool present = std::any_of(groups.begin(), groups.end(), [&](const Group& other) {
    return other.preset && other.preset->name == support;
  });
  return present ? support : "";
}

std::string list_text(const std::vector<std::string>& items) {
  constexpr std::size_t kWidth = 100;
  std::string text = "[", line;
  for (const std::string& item : items) {
    if (!line.empty() && line.size() + item.size() > kWidth) {
      text += line + "\n          ";
      line.clear();
    }
    line += (line.empty() ? "" : " ") + item + (&item == &items.back() ? "" : ",");
  }
  return text + line + "]";
}

/// Comment that lists the terms by which the preset was chosen, each with its number of structures.
std::string source_of_preset(const Group& group) {
  std::vector<std::pair<std::string, int>> terms;
  for (const PresetMatch& match : group.matches) {
    const auto known = std::ranges::find(terms, match.term, &std::pair<std::string, int>::first);
    if (known == terms.end())
      terms.emplace_back(match.term, 1);
    else
      ++known->second;
  }
  constexpr std::size_t kWidth = 100;
  std::string text, line = group.segments.size() == 1 ? "# preset guessed from the name's term"
                                                      : "# preset guessed from terms of the names:";
  for (const auto& [term, count] : terms) {
    std::string item = " \"" + term + "\"";
    if (count > 1) item += " (" + std::to_string(count) + ")";
    if (&term != &terms.back().first) item += ",";
    if (line.size() + item.size() > kWidth) {
      text += line + "\n";
      line = "#  ";
    }
    line += item;
  }
  return text + line + "\n";
}

/// Comment that explains why a group has no preset.
std::string reason_for_no_preset(const Group& group) {
  if (group.segments.size() != 1)
    return "# names match no preset, and one tissue for each would be too many: group them\n";
  const auto& [preset, term, is_hollow] = group.matches.front();
  if (is_hollow)
    return "# guessed from its name's term \"" + term + "\": air or fluid, which does not resist\n";
  if (!term.empty())
    return "# no preset for its name's term \"" + term + "\": add a stiffness and remove touchable = false\n";
  return "# its name matches no preset: add one, or a stiffness, and remove touchable = false\n";
}

/// Whether a group is translucent, so that it hides enclosed structures less than a solid one, and may lie
/// within an embedding.
bool is_translucent_organ(const Group& group) {
  return group.preset && group.preset->values.opacity < 1 && group.preset->name != "skin" &&
         group.preset->name != "fat";
}

std::string tissue_text(const Group& group, const std::vector<Group>& groups,
                        const std::map<std::string, int>& uses, TissueLaw law, bool embedded) {
  std::string text = "\n[[tissue]]\nname = " + toml_string(group.name) + "\n";
  if (group.preset) {
    const TissueSettings& values = group.preset->values;
    text += "preset = \"" + group.preset->name + "\"  # stiffness " + number_text(values.stiffness_N_per_mm) +
            " N/mm, friction " + number_text(values.friction);
    if (is_elastic(law))
      text += values.elastic ? ", E " + number_text(values.elastic->youngs_modulus_kPa) + " kPa"
                             : std::string(", rigid");
    if (law == TissueLaw::kExponential && values.elastic && values.elastic->stiffening > 0)
      text += ", stiffening " + number_text(values.elastic->stiffening);
    text += "\n" + source_of_preset(group);
  } else if (group.is_touched_unknown) {
    text += "# no name of the label map is known: all structures feel alike\n";
  } else {
    text += reason_for_no_preset(group);
  }
  std::vector<std::string> labels;
  for (const Segment* segment : group.segments) labels.push_back(written_label(*segment, uses));
  text += "labels = " + list_text(labels) + "\n";
  if (group.is_touched_unknown)
    text += std::string("stiffness = ") + kUnknownStiffness + "\n";
  else if (!group.preset)
    text += "touchable = false\n";
  if (embedded && is_translucent_organ(group)) text += "opacity = 1  # seen through the embedding\n";
  if (const std::string support = support_of(group, groups); !support.empty())
    text += "rests_on = [\"" + support + "\"]\n";
  return text;
}

/// Threshold by Otsu's method (IEEE Trans SMC 9:62, 1979) on 256 bins, and the means of the values below and
/// above it.
struct Split {
  double threshold = 0, mean_below = 0, mean_above = 0, bin_width = 0;
};
std::optional<Split> otsu_split(const Volume<float>& scan) {
  constexpr std::size_t kBins = 256;
  double low = HUGE_VAL, high = -HUGE_VAL;
  for (const float value : scan.voxels()) {
    if (!std::isfinite(value)) continue;
    low = std::min(low, static_cast<double>(value));
    high = std::max(high, static_cast<double>(value));
  }
  if (!(low < high)) return std::nullopt;

  // number and sum of the values of each bin
  std::array<double, kBins> count{}, sum{};
  double total = 0, total_sum = 0;
  for (const float value : scan.voxels()) {
    if (!std::isfinite(value)) continue;
    const auto bin = static_cast<std::size_t>((value - low) / (high - low) * (kBins - 1));
    count[bin] += 1;
    sum[bin] += value;
    total += 1;
    total_sum += value;
  }

  // bin boundary with the greatest between-class variance
  Split best{.bin_width = (high - low) / (kBins - 1)};
  double below = 0, below_sum = 0, best_variance = -1;
  for (std::size_t bin = 0; bin + 1 < kBins; ++bin) {
    below += count[bin];
    below_sum += sum[bin];
    const double above = total - below;
    if (below == 0 || above == 0) continue;
    const double gap = (total_sum - below_sum) / above - below_sum / below;
    const double variance = below * above * gap * gap;
    if (variance <= best_variance) continue;
    best_variance = variance;
    best.threshold = low + static_cast<double>(bin + 1) * best.bin_width;
    best.mean_below = below_sum / below;
    best.mean_above = (total_sum - below_sum) / above;
  }
  return best;
}

/// Ramp from the threshold to halfway to the mean of the bright class, so that most of that class has full
/// weight. Both ends are rounded to a hundredth of the width, below the precision of the threshold.
std::array<double, 2> ramp_of(const Split& split) {
  const double width = 0.5 * std::max(split.mean_above - split.threshold, split.bin_width);
  const double step = std::pow(10.0, std::floor(std::log10(width)) - 2);
  const double low = std::round(split.threshold / step), high = std::round((split.threshold + width) / step);
  // division by an integer gives the nearest double to the decimal fraction; multiplication does not
  return step < 1 ? std::array{low / std::round(1 / step), high / std::round(1 / step)}
                  : std::array{low * step, high * step};
}

Result<std::string> threshold_text(const Volume<float>& scan) {
  const auto split = otsu_split(scan);
  if (!split) {
    return Error{ErrorKind::kBadInput, "all voxels of the scan have the same value", "",
                 "check the scan, or give a label map"};
  }
  const auto [low, high] = ramp_of(*split);
  const KeySpec& key = *scene_key_tables().tissue.find("threshold");
  if (!(low >= key.min && high <= key.max && low < high)) {
    return Error{ErrorKind::kBadInput,
                 "the scan's values need a threshold of " + number_text(split->threshold) +
                     ", which a scene cannot state",
                 "", "scale the scan's values to the order of one to a million"};
  }
  return std::string("\n[[tissue]]\nname = \"surface\"\n") +
         "# separates dark from bright by Otsu's method; for bone in a CT try [150, 400]\n" +
         "threshold = [" + number_text(low) + ", " + number_text(high) + "]\nstiffness = 1.0\n";
}

/// Stiffness of an embedding as a fraction of the softest structure's, at most.
constexpr double kSofter = 0.5;

/// Text of the tissue of the unlabelled voxels inside the body. Errors: no space for another tissue; a scan
/// of a single value.
Result<std::string> embedding_text(const NewSceneInput& input, const std::vector<Group>& groups,
                                   TissueLaw law) {
  if (groups.size() == kMaxTissues)
    return Error{
        ErrorKind::kBadInput,
        "a scene has " + std::to_string(kMaxTissues) + " tissues at most, and the labels use all of them",
        input.labels->string(), "leave out --embed"};
  std::set<std::string> taken_names;
  for (const Group& group : groups) taken_names.insert(group.name);
  const TissueSettings& fat = find_preset("fat")->values;
  double stiffness_N_per_mm = fat.stiffness_N_per_mm, modulus_kPa = fat.elastic->youngs_modulus_kPa;
  for (const Group& group : groups) {
    if (!group.preset) continue;
    const TissueSettings& values = group.preset->values;
    stiffness_N_per_mm = std::min(stiffness_N_per_mm, kSofter * values.stiffness_N_per_mm);
    if (values.elastic) modulus_kPa = std::min(modulus_kPa, kSofter * values.elastic->youngs_modulus_kPa);
  }
  std::string text =
      "\n# unlabelled tissue between the structures, as a soft medium of its own\n[[tissue]]\nname = " +
      toml_string(unused_name({0, "embedding", {}, 0, 0}, taken_names)) +
      "\npreset = \"fat\"\nembedding = true\n";
  text +=
      "# as soft as fat, and softer than the embedded structures, so that they are felt through it\n"
      "stiffness = " +
      number_text(stiffness_N_per_mm) + "\n";
  if (is_elastic(law)) text += "youngs_modulus = " + number_text(modulus_kPa) + "\n";
  if (input.scan_volume) {
    const auto split = otsu_split(*input.scan_volume);
    if (!split)
      return Error{ErrorKind::kBadInput,
                   "all voxels of the scan have the same value, so air cannot be separated from the body",
                   input.scan->string(), "leave out the scan: then voxels enclosed by labels are inside"};
    // if there is a gap between the two classes, Otsu's threshold lies at its lower end
    const double midpoint = 0.5 * (split->mean_below + split->mean_above);
    const double step = std::max(1.0, std::pow(10.0, std::floor(std::log10(split->bin_width))));
    text += "# between the means of air and body by Otsu's method; of a CT about -400 HU\nair_below = " +
            number_text(split->mean_above - split->mean_below < 100 ? midpoint
                                                                    : std::round(midpoint / step) * step) +
            "\n";
  }
  return text + "colour = \"#e6cd96\"\nopacity = 0.15\n";
}

/// Text of the preparation. Its sigma is 1 mm, or the largest voxel spacing if that is wider: a narrower
/// Gaussian does not smooth the steps between slices, and the force is normal to these instead of to the
/// surface (docs/results/accuracy.md).
std::string preparation_text(const GridGeometry* labels, const GridGeometry* scan) {
  const KeySpec& key = *scene_key_tables().preparation.find("sigma");
  const double widest_mm = largest_spacing_mm(labels, scan);
  // round up to a tenth, tolerating the rounding of a direction matrix
  const double sigma_mm = std::clamp(std::ceil(10 * widest_mm - 1e-6) / 10, 1.0, key.max);
  std::string text = "\n[preparation]\n";
  if (sigma_mm > 1) {
    text += "# voxels are up to " + number_text(std::round(1000 * widest_mm) / 1000) +
            " mm wide: with a smaller sigma the steps between them are felt\n";
  }
  return text + "sigma = " + number_text(sigma_mm) + "  # mm, of the union Gaussian and the smooth sphere\n";
}

}  // namespace

Result<std::string> new_scene_text(const NewSceneInput& input, const fs::path& folder) {
  if (!(input.labels && input.label_map) && !(input.scan && input.scan_volume)) {
    return Error{ErrorKind::kUsage, "a scene needs a label map or a scan", "",
                 "name a file of labels, or a scan"};
  }
  std::string text = "# Every key with default, unit and range: palpate scene keys\n";
  if (!input.title.empty()) {
    if (!is_utf8(input.title))
      return Error{ErrorKind::kUsage, "the title is not valid UTF-8", "--title", "write it in UTF-8"};
    text += "title = " + toml_string(input.title) + "\n";
  }
  if (input.side != Side::kUnknown) text += "side = \"" + std::string(name_of(input.side, kSides)) + "\"\n";
  if (input.modality != Modality::kUnknown)
    text += "modality = \"" + std::string(name_of(input.modality, kModalities)) + "\"\n";

  // data files
  text += "\n[data]\n";
  for (const auto& [key, file] :
       {std::pair{"scan", &input.scan}, {"labels", &input.labels}, {"names", &input.names}}) {
    if (!*file) continue;
    const std::string path = written_path(**file, folder);
    if (!is_utf8(path)) {
      return Error{ErrorKind::kBadInput, "the path is not valid UTF-8, so no scene file can name it",
                   (*file)->string(), "rename the file or its folder"};
    }
    text += std::string(key) + " = " + toml_string(path) + "\n";
    if (file == (input.names ? &input.names : &input.labels) && !input.names_from.empty())
      text += "# names of the labels are from " + input.names_from + "\n";
    if (file == &input.scan && input.volume_of_scan)
      text += "scan_volume = " + std::to_string(*input.volume_of_scan) + "\n";
    if (file == &input.labels && input.mesh_space)
      text += "mesh_space = \"" + std::string(name_of(*input.mesh_space, kSurfaceAxes)) + "\"\n";
    if (file == &input.labels && input.mesh_unit)
      text += "mesh_unit = \"" + std::string(name_of(*input.mesh_unit, kSurfaceUnits)) + "\"\n";
  }
  if (input.image_spacing_mm) {
    char spacing[120];
    std::snprintf(spacing, sizeof spacing, "image_spacing = [%.9g, %.9g, %.9g]\n",
                  input.image_spacing_mm->x(), input.image_spacing_mm->y(), input.image_spacing_mm->z());
    text += spacing;
  }
  if (input.nifti_form)
    text += "nifti_form = \"" + std::string(name_of(*input.nifti_form, kHeaderForms)) + "\"\n";
  if (input.scan_is_cropped) text += "cropped_scan = true\n";

  // tissues
  TissueLaw law = input.law.value_or(TissueLaw::kLayers);
  if (!input.labels) {
    const auto tissue = threshold_text(*input.scan_volume);
    if (!tissue) return tissue.error();
    text += *tissue;
  } else {
    if (input.label_map->segments.empty()) {
      return Error{ErrorKind::kBadInput, "the label map is empty", input.labels->string(),
                   "give one with structures"};
    }
    std::map<std::string, int> uses;
    for (const Segment& segment : input.label_map->segments) ++uses[segment.name];
    const std::vector<Group> groups = group_structures(*input.label_map, input.touch_unknown);
    law = law_for(input, groups);
    for (const Group& group : groups) text += tissue_text(group, groups, uses, law, input.embed);
    if (input.embed) {
      const auto embedding = embedding_text(input, groups, law);
      if (!embedding) return embedding.error();
      text += *embedding;
    }
  }
  if (law != TissueLaw::kLayers)
    text += "\n[yielding]\nlaw = \"" + std::string(name_of(law, kTissueLaws)) + "\"\n";
  return text + preparation_text(input.labels ? &input.label_map->geometry() : nullptr,
                                 input.scan_volume ? &input.scan_volume->geometry() : nullptr);
}

}  // namespace palpate
