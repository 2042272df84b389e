#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <set>

#include "volume_io/formats/headers.h"
#include "volume_io/labels/label_text.h"

namespace palpate::volume_io {
namespace {

constexpr const char* kRemedy = "name the labels in a table (--names)";

// text of an element: CDATA unchanged, otherwise with XML's five entities replaced
std::optional<std::string> element_text(std::string_view text) {
  text = trimmed(text);
  constexpr std::string_view kOpen = "<![CDATA[", kClose = "]]>";
  if (text.starts_with(kOpen)) {
    if (!text.ends_with(kClose) || text.size() < kOpen.size() + kClose.size()) return std::nullopt;
    return std::string(text.substr(kOpen.size(), text.size() - kOpen.size() - kClose.size()));
  }
  static constexpr std::array<std::pair<std::string_view, char>, 5> kEntities{
      {{"&amp;", '&'}, {"&lt;", '<'}, {"&gt;", '>'}, {"&quot;", '"'}, {"&apos;", '\''}}};
  std::string plain;
  while (!text.empty()) {
    const auto entity =
        std::ranges::find_if(kEntities, [&](const auto& one) { return text.starts_with(one.first); });
    if (text.front() == '<' || (text.front() == '&' && entity == kEntities.end())) return std::nullopt;
    plain += entity == kEntities.end() ? text.front() : entity->second;
    text.remove_prefix(entity == kEntities.end() ? 1 : entity->first.size());
  }
  return plain;
}

// value of name="value" or name='value' in a tag; empty if it is missing
std::string_view attribute(std::string_view tag, std::string_view name) {
  for (auto at = tag.find(name); at != std::string_view::npos; at = tag.find(name, at + 1)) {
    const std::size_t equals = at + name.size();
    const bool begins = at > 0 && (tag[at - 1] == ' ' || tag[at - 1] == '\t' || tag[at - 1] == '\n');
    if (!begins || equals + 1 >= tag.size() || tag[equals] != '=') continue;
    const char quote = tag[equals + 1];
    const auto end = tag.find(quote, equals + 2);
    if ((quote != '"' && quote != '\'') || end == std::string_view::npos) return {};
    return tag.substr(equals + 2, end - equals - 2);
  }
  return {};
}

std::uint32_t word_at(std::string_view bytes, std::size_t at, bool swap) {
  std::array<char, 4> field{};
  std::copy_n(bytes.begin() + static_cast<std::ptrdiff_t>(at), 4, field.begin());
  if (swap) std::ranges::reverse(field);
  return std::bit_cast<std::uint32_t>(field);
}

}  // namespace

std::string_view find_caret_extension(std::string_view bytes, std::size_t header_bytes, bool swap) {
  // four bytes, the first of which is non-zero if extensions follow; each extension begins with its size and
  // code
  constexpr std::size_t kFlag = 4, kSizeAndCode = 8;
  if (bytes.size() < header_bytes + kFlag || bytes[header_bytes] == 0) return {};
  for (std::size_t at = header_bytes + kFlag; at + kSizeAndCode <= bytes.size();) {
    const std::uint32_t size = word_at(bytes, at, swap);
    if (size < kSizeAndCode || size > bytes.size() - at) return {};
    const std::string_view data = bytes.substr(at + kSizeAndCode, size - kSizeAndCode);
    // identified by content: TotalSegmentator uses code 0, Connectome Workbench 30
    if (data.find("<CaretExtension") != std::string_view::npos) return data;
    at += size;
  }
  return {};
}

Result<SegmentFieldPairs> parse_caret_labels(std::string_view xml, const std::string& source) {
  SegmentFieldPairs fields;
  const auto table = xml.find("<LabelTable");
  if (table == std::string_view::npos) return fields;
  xml = xml.substr(table, xml.find("</LabelTable>", table) - table);
  const auto fault = [&](const std::string& why) {
    return bad_input(source, "its label table (CaretExtension) " + why, kRemedy);
  };
  std::set<LabelId> labels;
  for (auto at = xml.find("<Label "); at != std::string_view::npos; at = xml.find("<Label ", at)) {
    const auto tag_end = xml.find('>', at);
    const auto end = xml.find("</Label>", at);
    if (tag_end == std::string_view::npos || end == std::string_view::npos || end < tag_end)
      return fault("is cut short");
    const std::string_view tag = xml.substr(at, tag_end - at);
    const auto name = element_text(xml.substr(tag_end + 1, end - tag_end - 1));
    const auto key = parse_number<LabelId>(attribute(tag, "Key"));
    at = end;
    if (!key) return fault("has a key that is not a whole number in 0 ... 65535");
    if (*key == 0) continue;
    if (!labels.insert(*key).second) return fault("names label " + std::to_string(*key) + " a second time");
    if (!name) return fault("has a name that is not a text");
    const std::string shown(trimmed(*name));
    if (const auto wrong = name_fault(shown))
      return fault("at label " + std::to_string(*key) + ": " + *wrong);
    const std::string segment = "Segment" + std::to_string(labels.size() - 1);
    fields.emplace_back(segment + "_LabelValue", std::to_string(*key));
    fields.emplace_back(segment + "_Name", shown);
    std::string colour;
    for (const char* part : {"Red", "Green", "Blue"}) {
      const auto value = parse_number<double>(attribute(tag, part));
      if (!value || !(*value >= 0 && *value <= 1)) break;
      colour += (colour.empty() ? "" : " ") + std::string(attribute(tag, part));
    }
    if (std::ranges::count(colour, ' ') == 2) fields.emplace_back(segment + "_Color", colour);
  }
  return fields;
}

}  // namespace palpate::volume_io
