#include <set>

#include "volume_io/labels/label_text.h"
#include "volume_io/voxel_source.h"

namespace palpate {

using namespace volume_io;

Result<std::vector<NamedLabel>> parse_snap_labels(std::string_view text, const std::string& source) {
  constexpr const char* kRowRemedy =
      "a line is: value red green blue opacity visible mesh \"name\", e.g. 5 255 0 0 1 1 1 \"Left femur\"";
  std::vector<NamedLabel> labels;
  std::set<LabelId> used_labels;
  for (int number = 1; !text.empty(); ++number) {
    const std::string_view line = trimmed(read_line(text));
    if (line.empty() || line.front() == '#') continue;
    const std::string where = source + ":" + std::to_string(number);

    const auto quote = line.find('"');
    if (quote == std::string_view::npos || line.size() < quote + 2 || line.back() != '"')
      return bad_input(where, "has no name in quotation marks", kRowRemedy);
    const auto fields = split_spaces(line.substr(0, quote));
    if (fields.size() != 7)
      return bad_input(where,
                       "has " + std::to_string(fields.size()) + " numbers before the name instead of 7",
                       kRowRemedy);
    const auto value = parse_number<LabelId>(fields[0]);
    if (!value) return bad_input(where, "the value is not a whole number in 0 ... 65535", kRowRemedy);
    if (!used_labels.insert(*value).second)
      return bad_input(where, "value " + std::to_string(*value) + " is named a second time",
                       "keep one of the lines");
    std::uint8_t colour[3];
    for (std::size_t c = 0; c < 3; ++c) {
      const auto part = parse_number<std::uint8_t>(fields[1 + c]);
      if (!part) return bad_input(where, "a colour is not a whole number in 0 ... 255", kRowRemedy);
      colour[c] = *part;
    }
    const std::string_view name = trimmed(line.substr(quote + 1, line.size() - quote - 2));
    if (auto fault = name_fault(name)) return bad_input(where, *fault, "rename the structure");
    labels.push_back({*value, std::string(name), Rgb{colour[0], colour[1], colour[2]}});
  }
  return labels;
}

}  // namespace palpate
