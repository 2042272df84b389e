#include <set>

#include "volume_io/labels/label_text.h"
#include "volume_io/voxel_source.h"

namespace palpate {

using namespace volume_io;

Result<std::vector<NamedLabel>> parse_colour_table(std::string_view text, const std::string& source) {
  constexpr const char* kRemedy = "a line is: value name red green blue alpha, e.g. 95 femur 197 189 177 255";
  std::vector<NamedLabel> labels;
  std::set<LabelId> used_labels;
  for (int number = 1; !text.empty(); ++number) {
    const std::string_view line = trimmed(read_line(text));
    if (line.empty() || line.front() == '#') continue;
    const std::string where = source + ":" + std::to_string(number);

    const auto fields = split_spaces(line);
    if (fields.size() != 6)
      return bad_input(where, "has " + std::to_string(fields.size()) + " words instead of 6", kRemedy);
    const auto value = parse_number<LabelId>(fields[0]);
    if (!value) return bad_input(where, "the value is not a whole number in 0 ... 65535", kRemedy);
    if (!used_labels.insert(*value).second)
      return bad_input(where, "value " + std::to_string(*value) + " is named a second time",
                       "keep one of the lines");
    if (auto fault = name_fault(fields[1])) return bad_input(where, *fault, "rename the structure");
    std::uint8_t colour[4];
    for (std::size_t c = 0; c < 4; ++c) {
      const auto part = parse_number<std::uint8_t>(fields[2 + c]);
      if (!part) return bad_input(where, "a colour is not a whole number in 0 ... 255", kRemedy);
      colour[c] = *part;
    }
    labels.push_back({*value, std::string(fields[1]), Rgb{colour[0], colour[1], colour[2]}});
  }
  return labels;
}

}  // namespace palpate
