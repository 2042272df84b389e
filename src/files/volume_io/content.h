#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>

#include "palpate/volume_io/volume_io.h"
#include "volume_io/value_statistics.h"

/// Classification of a volume as scan or labels.
namespace palpate::volume_io {

/// Whether a volume next to a table may be the label map of that table.
bool may_be_labels(const std::filesystem::path& file);
/// Whether a file is declared to be labels: by segments or the intent in the file, or by names for more than
/// half of the labels.
bool is_declared_as_labels(const LabelFile& file);
/// Content of a volume that was read as a scan.
/// @param names  a given table of label names
VolumeContent classify_content(const ScanFile& scan, const std::filesystem::path& file,
                               const std::optional<std::filesystem::path>& names);
/// Error for labels that resemble a scan.
/// @param values  number of different values
Error looks_like_scan(const std::filesystem::path& file, std::size_t values);
/// Error for a volume that may be either.
Error unclear_content(const std::filesystem::path& file, const std::string& evidence);
/// Error of a read for which the memory did not suffice.
Error out_of_memory(const std::filesystem::path& file);

}  // namespace palpate::volume_io
