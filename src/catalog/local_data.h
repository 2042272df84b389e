#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "palpate/catalog/catalog.h"

namespace palpate {

/// The file of a data set that has this role; every data set has labels and a scan.
const CatalogFile& file_for(const CatalogEntry& entry, DataRole role);

/// The entry of a name that may have a phantom's parameters; with any, the files are named after them.
/// Errors: those of find_entry() and parse_phantom().
Result<CatalogEntry> entry_with_parameters(const std::string& name);

/// A data set's name as the name of a file or folder.
std::string file_stem(const std::string& name);

/// A data set's files in one folder, checked against the known hashes; nothing when a required file is
/// not there. Errors: as locate().
Result<std::optional<LocalData>> local_data_in(const CatalogEntry& entry,
                                               const std::filesystem::path& folder);

}  // namespace palpate
