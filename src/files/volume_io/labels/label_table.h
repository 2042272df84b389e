#pragma once

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <optional>
#include <vector>

#include "palpate/volume_io/volume_io.h"
#include "volume_io/labels/label_names.h"
#include "volume_io/volume_message.h"

/// Names of labels by a table, and whether a table belongs to a label map.
namespace palpate::volume_io {

/// Names that may belong to a label map, with their source.
struct FoundNames {
  std::vector<NamedLabel> names;
  NameSource source = NameSource::kNone;
  std::optional<std::filesystem::path> table = {};
  std::vector<std::filesystem::path> others = {};  ///< Other volumes to which the table may belong
};

/// Table that may name the labels: a given one, or one in the folder of the file.
Result<FoundNames> find_names(const VolumeFile& file, const std::filesystem::path& labels,
                              const std::optional<std::filesystem::path>& supplied,
                              const std::optional<std::filesystem::path>& scan, const Warn& warn);
/// True if a table belongs to the label map. Warns about a table that is not used; a given table that names
/// none of the labels is an error.
Result<bool> check_belongs(const FoundNames& found, const std::vector<Segment>& segments, bool by_colour,
                           const std::filesystem::path& labels, const Warn& warn);
/// Applies the names of a table, which override those of the file.
void apply_names(const std::vector<NamedLabel>& names, bool by_colour, std::vector<Segment>& segments);
/// Number of rows of a table whose value is present; 0 is the background and does not count.
/// @param is_present  predicate of a value
template <class IsPresent>
std::size_t count_named(const std::vector<NamedLabel>& names, const IsPresent& is_present) {
  return static_cast<std::size_t>(std::ranges::count_if(
      names, [&](const NamedLabel& named) { return named.value != 0 && is_present(named.value); }));
}

}  // namespace palpate::volume_io
