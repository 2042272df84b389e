#include "volume_io/labels/label_table.h"

#include <algorithm>

#include "palpate/base/reading.h"
#include "volume_io/content.h"
#include "volume_io/formats/formats.h"
#include "volume_io/image/image_stack.h"

namespace palpate {

using namespace volume_io;

namespace {

// True if a row of a table names the segment.
// @param by_colour  labels are the colours of images, which have no numbers of their own
bool names_segment(const NamedLabel& named, const Segment& segment, bool by_colour) {
  return by_colour && named.colour ? segment.colour == *named.colour : segment.id == named.value;
}

// "1, 2, 3 and 7 more"
std::string some_of(const std::vector<LabelId>& values) {
  constexpr std::size_t kNamed = 3;
  std::string text;
  for (std::size_t n = 0; n < std::min(kNamed, values.size()); ++n)
    text += (n == 0 ? "" : ", ") + std::to_string(values[n]);
  if (values.size() > kNamed) text += " and " + std::to_string(values.size() - kNamed) + " more";
  return text;
}

}  // namespace

void volume_io::apply_names(const std::vector<NamedLabel>& names, bool by_colour,
                            std::vector<Segment>& segments) {
  for (const NamedLabel& named : names)
    for (Segment& s : segments) {
      if (!names_segment(named, s, by_colour)) continue;
      s.name = named.name;
      if (named.colour) s.colour = *named.colour;
    }
}

Result<FoundNames> volume_io::find_names(const VolumeFile& file, const std::filesystem::path& labels,
                                         const std::optional<std::filesystem::path>& supplied,
                                         const std::optional<std::filesystem::path>& scan, const Warn& warn) {
  if (supplied) {
    auto names = read_label_names(*supplied);
    if (!names) return names.error();
    return FoundNames{*std::move(names), NameSource::kSuppliedTable, supplied};
  }
  if (file.header.has_segments && file.header.format != kColouredPictures) return FoundNames{};
  const auto table = find_adjacent_table(labels, scan);
  if (!table) return FoundNames{};
  const auto stays = check_stays_in(labels.parent_path(), table->file);
  auto names = stays ? read_label_names(table->file) : stays.error();
  if (names)
    return FoundNames{*std::move(names), table->has_own_name ? NameSource::kOwnTable : NameSource::kOnlyTable,
                      table->file, table->others};
  // the user did not ask for this table, which may belong to something else
  if (warn && table->others.empty())
    warn(names.error().message() + "\n  the table was not used, the labels stay without names");
  return FoundNames{};
}

Result<bool> volume_io::check_belongs(const FoundNames& found, const std::vector<Segment>& segments,
                                      bool by_colour, const std::filesystem::path& labels, const Warn& warn) {
  if (!found.table || segments.empty()) return found.table.has_value();
  const auto named = static_cast<std::size_t>(std::ranges::count_if(found.names, [&](const NamedLabel& line) {
    return line.value != 0 && std::ranges::any_of(segments, [&](const Segment& segment) {
             return names_segment(line, segment, by_colour);
           });
  }));
  std::vector<LabelId> in_map, in_table;
  for (const Segment& segment : segments) in_map.push_back(segment.id);
  for (const NamedLabel& label : found.names)
    if (label.value != 0) in_table.push_back(label.value);
  const std::string table = found.table->string();
  const auto not_used = [&](const std::string& why) {
    if (warn)
      warn(table + " was not used for " + labels.string() + ": " + why + "; --names " + table + " uses it");
    return false;
  };
  if (named == 0) {
    const std::string why = "it names none of its labels, which are " + some_of(in_map) + ", but " +
                            (in_table.empty() ? std::string("0 alone") : some_of(in_table));
    if (found.source == NameSource::kSuppliedTable)
      return bad_input(table,
                       "names none of the labels of " + labels.string() + ", which are " + some_of(in_map) +
                           ", but " + (in_table.empty() ? std::string("0 alone") : some_of(in_table)),
                       "give the table of this label map");
    return not_used(why);
  }
  if (found.source != NameSource::kOnlyTable) return true;
  if (10 * named < 9 * segments.size())
    return not_used("it names " + std::to_string(named) + " of its " + std::to_string(segments.size()) +
                    " labels, and may belong to another map");
  const auto rival = std::ranges::find_if(found.others, may_be_labels);
  if (rival != found.others.end()) return not_used("it may also belong to " + rival->filename().string());
  return true;
}

std::string_view description_of(NameSource source) {
  switch (source) {
    case NameSource::kNone:
      return "nowhere";
    case NameSource::kFile:
      return "the file itself";
    case NameSource::kFileName:
      return "anatomical words in its file names";
    case NameSource::kSuppliedTable:
      return "the given table";
    case NameSource::kOwnTable:
      return "a table next to it with the same name";
    case NameSource::kOnlyTable:
      return "the only table next to it, which names its values";
  }
  return "";
}

std::string origin_of_names(const LabelFile& labels) {
  const std::size_t all = labels.labels.segments.size(), unnamed = labels.unnamed.size();
  const std::string many = std::to_string(all) + (all == 1 ? " label" : " labels");
  if (all == unnamed) return "no name for its " + many;
  return (unnamed == 0 ? many : std::to_string(all - unnamed) + " of " + many) +
         (all - unnamed == 1 ? " has its name from " : " have their names from ") +
         (labels.names_table ? labels.names_table->string() + ", " : "") +
         std::string(description_of(labels.name_source));
}

}  // namespace palpate
