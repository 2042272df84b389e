#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "palpate/json/json.h"
#include "volume_io/labels/label_text.h"
#include "volume_io/voxel_source.h"

namespace palpate {

using namespace volume_io;

namespace {

// Deepest nesting of any supported table; deeper text is rejected before it is parsed.
constexpr int kDeepest = 12;

bool nests_too_deep(std::string_view text) {
  int depth = 0;
  bool quoted = false;
  for (std::size_t n = 0; n < text.size(); ++n) {
    const char c = text[n];
    if (quoted) {
      n += c == '\\';
      quoted = c != '"';
    } else {
      quoted = c == '"';
      depth += (c == '{' || c == '[') - (c == '}' || c == ']');
      if (depth > kDeepest) return true;
    }
  }
  return false;
}

constexpr const char* kRemedy =
    R"(give numbers with names, {"1": "femur"} or {"femur": 1}, or a segment description from dcmqi or 3D Slicer)";

/// Collects names, at most one per label.
class Names {
 public:
  explicit Names(const std::string& source) : source_(source) {}

  void add(LabelId value, const std::string& name, const std::optional<Rgb>& colour) {
    if (fault_) return;
    const std::string_view shown = trimmed(name);
    const std::string where = source_ + ", value " + std::to_string(value);
    if (auto fault = name_fault(shown)) {
      fault_ = bad_input(where, *fault, "rename the structure");
    } else if (!values_.insert(value).second) {
      fault_ = bad_input(where, "is named a second time", "keep one of the names");
    } else {
      labels_.push_back({value, std::string(shown), colour});
    }
  }
  void refuse(const std::string& why) {
    if (!fault_) fault_ = bad_input(source_, why, "give each label of this map a name");
  }
  void add_unless_known(LabelId value, const std::string& name) {
    if (!values_.contains(value)) add(value, name, std::nullopt);
  }
  Result<std::vector<NamedLabel>> take() && {
    if (fault_) return *std::move(fault_);
    if (labels_.empty()) return bad_input(source_, "names no label", kRemedy);
    return std::move(labels_);
  }
  bool any() const { return fault_ || !labels_.empty(); }

 private:
  const std::string& source_;
  std::vector<NamedLabel> labels_;
  std::set<LabelId> values_;
  std::optional<Error> fault_;
};

const Json* find(const Json& object, std::initializer_list<const char*> keys) {
  if (!object.is_object()) return nullptr;
  for (const char* key : keys)
    if (const Json* found = object.find(key)) return found;
  return nullptr;
}

// integer in 0 ... 65535, given as a number or as a string of digits
std::optional<LabelId> value_of(const Json& json) {
  if (json.is_string()) return parse_number<LabelId>(json.text());
  if (!json.is_number()) return std::nullopt;
  const double value = json.get<double>();
  if (!(value >= 0 && value <= 65535) || value != std::floor(value)) return std::nullopt;
  return static_cast<LabelId>(value);
}

// [r, g, b] in 0 ... 255, or in 0 ... 1 if a component is not an integer
std::optional<Rgb> colour_of(const Json* json) {
  if (json == nullptr || !json->is_array() || json->size() < 3) return std::nullopt;
  double part[3];
  bool fraction = false;
  for (std::size_t c = 0; c < 3; ++c) {
    const Json& number = (*json)[c];
    if (!number.is_number()) return std::nullopt;
    part[c] = number.get<double>();
    if (!(part[c] >= 0 && part[c] <= 255)) return std::nullopt;
    fraction = fraction || part[c] != std::floor(part[c]);
  }
  const double scale = fraction && std::max({part[0], part[1], part[2]}) <= 1 ? 255 : 1;
  const auto byte = [&](double value) { return static_cast<std::uint8_t>(std::lround(value * scale)); };
  return Rgb{byte(part[0]), byte(part[1]), byte(part[2])};
}

std::string text_of(const Json* json) {
  return json != nullptr && json->is_string() ? json->get<std::string>() : "";
}

// meaning of a coded concept: "Kidney" of {"CodeValue": "64033007", "CodeMeaning": "Kidney", ...}
std::string meaning_of(const Json* concept_code) {
  return concept_code == nullptr ? "" : text_of(find(*concept_code, {"CodeMeaning"}));
}

// segment as described by dcmqi, 3D Slicer and others
void add_segment(const Json& segment, Names& names) {
  const Json* number = find(segment, {"labelID", "3dSlicerIntegerLabel", "labelValue", "LabelValue",
                                      "label_value", "value", "index", "label", "id"});
  const auto value = number ? value_of(*number) : std::nullopt;
  if (!value) return;
  std::string name = text_of(
      find(segment, {"SegmentLabel", "3dSlicerLabel", "name", "Name", "label_name", "SegmentDescription"}));
  if (name.empty()) {
    // name from its codes: type and laterality
    name = meaning_of(find(segment, {"SegmentedPropertyTypeCodeSequence"}));
    if (name.empty()) name = text_of(find(segment, {"CodeMeaning"}));
    const std::string side = meaning_of(find(segment, {"SegmentedPropertyTypeModifierCodeSequence"}));
    if (!name.empty() && !side.empty()) name = side + " " + name;
  }
  if (name.empty()) return;
  names.add(*value, name, colour_of(find(segment, {"recommendedDisplayRGBValue", "color", "colour", "rgb"})));
}

void add_segments(const Json& json, Names& names) {
  if (json.is_object()) return add_segment(json, names);
  if (!json.is_array()) return;
  for (const Json& item : json) add_segments(item, names);
}

// terminology of 3D Slicer: categories of types, some with modifiers
void add_terminology(const Json& codes, Names& names) {
  const auto each = [](const Json* list, const auto& body) {
    if (list != nullptr && list->is_array())
      for (const Json& item : *list) body(item);
  };
  each(find(codes, {"Category"}), [&](const Json& category) {
    each(find(category, {"Type"}), [&](const Json& type) {
      add_segment(type, names);
      each(find(type, {"Modifier"}), [&](const Json& modifier) {
        // "Left" alone does not name a structure
        if (!text_of(find(modifier, {"3dSlicerLabel"})).empty()) return add_segment(modifier, names);
        Json whole = modifier;
        const std::string side = text_of(find(modifier, {"CodeMeaning"})),
                          of = text_of(find(type, {"CodeMeaning"}));
        if (!whole.is_object() || side.empty() || of.empty()) return;
        whole["CodeMeaning"] = side + " " + of;
        add_segment(whole, names);
      });
    });
  });
}

// {"1": "femur"} or {"femur": 1}
void add_pairs(const Json& object, Names& names) {
  if (!object.is_object()) return;
  for (const auto& [key, value] : object.items()) {
    if (const auto number = parse_number<LabelId>(key); number && value.is_string())
      names.add(*number, value.text(), std::nullopt);
    else if (const auto of_name = value.is_number() ? value_of(value) : std::nullopt)
      names.add(*of_name, key, std::nullopt);
  }
}

// nnU-Net's regions, {"whole": [1, 2, 3], "tumour": [2]}: a label is named by the smallest region that
// contains it, for training maps and for predicted maps alike. If regions_class_order does not ascend,
// predicted maps use other values, which is an error. Labels with names of their own keep them.
void add_regions(const Json& regions, const Json* order, Names& names) {
  if (!regions.is_object()) return;
  std::map<LabelId, std::pair<std::size_t, std::string>> smallest;
  for (const auto& [name, values] : regions.items()) {
    if (!values.is_array()) continue;
    for (const Json& item : values) {
      const auto value = value_of(item);
      if (!value || *value == 0) continue;
      const auto known = smallest.find(*value);
      if (known == smallest.end() || values.size() < known->second.first)
        smallest[*value] = {values.size(), name};
    }
  }
  if (smallest.empty()) return;
  if (order != nullptr && order->is_array()) {
    std::vector<LabelId> values;
    for (const Json& item : *order) values.push_back(value_of(item).value_or(0));
    if (!std::ranges::is_sorted(values))
      return names.refuse(
          "its regions_class_order is not ascending, so label values differ between predicted maps and "
          "training maps");
  }
  for (const auto& [value, region] : smallest) names.add_unless_known(value, region.second);
}

// niivue's label colour maps: {"R": [...], "G": [...], "B": [...], "I": [0, 5], "labels": ["air", "liver"]},
// numbered from 0 without "I"
void add_list(const Json& map, const Json& list, Names& names) {
  const Json* indices = find(map, {"I"});
  const auto at = [](const Json* array, std::size_t n) -> const Json* {
    return array != nullptr && array->is_array() && n < array->size() ? &(*array)[n] : nullptr;
  };
  for (std::size_t n = 0; n < list.size(); ++n) {
    if (!list[n].is_string() || trimmed(list[n].text()).empty()) continue;
    const Json* index = at(indices, n);
    const auto value = index != nullptr ? value_of(*index) : std::optional<LabelId>();
    if (indices != nullptr && !value) continue;
    std::uint8_t part[3] = {};
    bool coloured = true;
    for (std::size_t c = 0; c < 3; ++c) {
      const Json* level = at(find(map, {c == 0 ? "R" : c == 1 ? "G" : "B"}), n);
      const auto number = level != nullptr ? value_of(*level) : std::optional<LabelId>();
      coloured = coloured && number && *number <= 255;
      if (coloured) part[c] = static_cast<std::uint8_t>(*number);
    }
    if (n > 65535) return;
    names.add(value.value_or(static_cast<LabelId>(n)), list[n].get<std::string>(),
              coloured ? std::optional(Rgb{part[0], part[1], part[2]}) : std::nullopt);
  }
}

bool is_list_of_texts(const Json& list) {
  return list.is_array() && list.size() > 0 && list[0].is_string();
}

// the only table in an object of tasks, {"total": {"1": "spleen", ...}}
const Json* only_table(const Json& json) {
  const Json* table = nullptr;
  for (const auto& [key, value] : json.items()) {
    if (!value.is_object()) continue;
    if (table != nullptr) return nullptr;
    table = &value;
  }
  return table;
}

}  // namespace

Result<std::vector<NamedLabel>> parse_label_json(std::string_view text, const std::string& source) {
  if (nests_too_deep(text)) return bad_input(source, "is nested too deeply for a table of names", kRemedy);
  const std::optional<Json> parsed = Json::parse(text);
  if (!parsed) return bad_input(source, "is not valid JSON", kRemedy);

  const Json& json = *parsed;
  Names names(source);
  if (const Json* attributes = find(json, {"segmentAttributes", "segments", "Segments"})) {
    add_segments(*attributes, names);
  } else if (const Json* codes = find(json, {"SegmentationCodes"})) {
    add_terminology(*codes, names);
  } else if (const Json* labels = find(json, {"labels", "class_map", "label_names"})) {
    if (is_list_of_texts(*labels)) {
      add_list(json, *labels, names);
    } else if (labels->is_array()) {
      add_segments(*labels, names);
    } else {
      add_pairs(*labels, names);
      add_regions(*labels, find(json, {"regions_class_order"}), names);
    }
  } else if (json.is_array()) {
    add_segments(json, names);
  } else {
    add_pairs(json, names);
  }
  if (!names.any() && json.is_object())
    if (const Json* table = only_table(json)) add_pairs(*table, names);
  return std::move(names).take();
}

}  // namespace palpate
