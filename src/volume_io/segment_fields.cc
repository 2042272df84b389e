#include "volume_io/segment_fields.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>
#include <tuple>

#include "volume_io/label_text.h"
#include "volume_io/voxel_source.h"

namespace palpate {

using namespace volume_io;

namespace {

// what the fields of one SegmentN say
struct SegmentFields {
  std::string id, name;
  std::optional<Rgb> colour;
  std::optional<int> layer;
  std::optional<LabelId> value;
};

// "Segment12_Name" is (12, "Name"); nothing for other keys
std::optional<std::pair<int, std::string_view>> parse_key(std::string_view key) {
  constexpr std::string_view kPrefix = "Segment";
  if (key.substr(0, kPrefix.size()) != kPrefix) return std::nullopt;
  key.remove_prefix(kPrefix.size());
  const auto bar = key.find('_');
  if (bar == std::string_view::npos || bar == 0 || bar > 5) return std::nullopt;
  const auto number = parse_number<std::uint32_t>(key.substr(0, bar));
  if (!number) return std::nullopt;
  return std::pair(static_cast<int>(*number), key.substr(bar + 1));
}

// three numbers in [0,1]
std::optional<Rgb> parse_unit_colour(std::string_view text) {
  const auto parts = split_spaces(text);
  if (parts.size() != 3) return std::nullopt;
  std::uint8_t colour[3];
  for (std::size_t c = 0; c < 3; ++c) {
    const auto part = parse_number<double>(parts[c]);
    if (!part || !(*part >= 0 && *part <= 1)) return std::nullopt;
    colour[c] = static_cast<std::uint8_t>(std::lround(*part * 255));
  }
  return Rgb{colour[0], colour[1], colour[2]};
}

Result<void> read_field(std::string_view field, const std::string& text, int layers,
                        const std::string& source, const std::string& key, SegmentFields& fields) {
  if (field == "ID") fields.id = text;
  if (field == "Name") fields.name = text;
  if (field == "Color") {
    fields.colour = parse_unit_colour(text);
    if (!fields.colour) return bad_input(source, key + " is not three numbers in 0 ... 1");
  }
  if (field == "Layer") {
    fields.layer = parse_number<int>(trimmed(text));
    if (!fields.layer || *fields.layer < 0 || *fields.layer >= layers)
      return bad_input(source,
                       key + " is not one of the " + std::to_string(layers) + " layers, counted from 0");
  }
  if (field == "LabelValue") {
    fields.value = parse_number<LabelId>(trimmed(text));
    if (!fields.value || *fields.value == 0)
      return bad_input(source, key + " is not a whole number in 1 ... 65535");
  }
  return {};
}

}  // namespace

namespace volume_io {

bool number_segments(std::vector<Segment>& segments) {
  std::sort(segments.begin(), segments.end(), [](const Segment& a, const Segment& b) {
    return std::tie(a.layer, a.value) < std::tie(b.layer, b.value);
  });
  int highest = 0;
  for (const Segment& s : segments) highest = std::max<int>(highest, s.value);
  std::set<LabelId> taken;
  for (Segment& s : segments) {
    s.id = s.value;
    if (taken.insert(s.id).second) continue;
    if (++highest > 65535) return false;
    s.id = static_cast<LabelId>(highest);
    taken.insert(s.id);
  }
  std::sort(segments.begin(), segments.end(), [](const Segment& a, const Segment& b) { return a.id < b.id; });
  return true;
}

Rgb colour_for(LabelId id) {
  // the "Set2" and "Set3" colours of ColorBrewer that differ enough in lightness on grey
  static constexpr std::array<Rgb, 11> kColours{{{102, 194, 165},
                                                 {252, 141, 98},
                                                 {141, 160, 203},
                                                 {231, 138, 195},
                                                 {166, 216, 84},
                                                 {255, 217, 47},
                                                 {229, 196, 148},
                                                 {128, 177, 211},
                                                 {251, 128, 114},
                                                 {188, 128, 189},
                                                 {141, 211, 199}}};
  return kColours[id % kColours.size()];
}

}  // namespace volume_io

Result<std::vector<Segment>> parse_segment_fields(
    const std::vector<std::pair<std::string, std::string>>& fields, int layers, const std::string& source) {
  std::map<int, SegmentFields> by_number;
  for (const auto& [key, text] : fields) {
    const auto parsed = parse_key(key);
    static const std::set<std::string_view> kOurs{"ID", "Name", "Color", "Layer", "LabelValue"};
    if (!parsed || kOurs.count(parsed->second) == 0) continue;
    if (auto read = read_field(parsed->second, text, layers, source, key, by_number[parsed->first]); !read)
      return read.error();
  }

  std::vector<Segment> segments;
  std::set<std::pair<int, LabelId>> seen;
  for (const auto& [number, f] : by_number) {
    const std::string name = "Segment" + std::to_string(number);
    Segment segment;
    // Slicer before 4.11 wrote no layers and values: one binary layer for each segment, in order
    const bool each_its_layer = layers > 1 || by_number.size() == 1;
    if (!f.value && !each_its_layer)
      return bad_input(source, name + " has no LabelValue",
                       "save the segmentation again with a recent 3D Slicer");
    segment.layer = f.layer.value_or(layers > 1 ? number : 0);
    segment.value = f.value.value_or(1);
    if (segment.layer >= layers) return bad_input(source, name + " has no layer in the file");
    if (!seen.insert({segment.layer, segment.value}).second)
      return bad_input(source,
                       name + " repeats value " + std::to_string(segment.value) + " of layer " +
                           std::to_string(segment.layer),
                       "save the segmentation again");
    segment.name = f.name.empty() ? f.id : f.name;
    if (!segment.name.empty())
      if (auto fault = name_fault(segment.name))
        return bad_input(source, name + ": " + *fault, "rename the segment");
    segment.colour = f.colour.value_or(colour_for(segment.value));
    segments.push_back(std::move(segment));
  }
  if (!number_segments(segments)) return bad_input(source, "has more segments than there are numbers for");
  return segments;
}

}  // namespace palpate
