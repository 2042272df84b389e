#pragma once

#include <filesystem>
#include <optional>

#include "palpate/catalog.h"

namespace palpate {

/// The file of a data set that has this role; every data set has labels and a scan.
const CatalogFile& file_for(const CatalogEntry& entry, DataRole role);

/// A data set's files in one folder, checked against the known hashes; nothing when a required file is
/// not there. Errors: as locate().
Result<std::optional<LocalData>> local_data_in(const CatalogEntry& entry,
                                               const std::filesystem::path& folder);

}  // namespace palpate
