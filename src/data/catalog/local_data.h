#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "palpate/catalog/catalog.h"

namespace palpate {

/// File of a data set with this role; every data set has labels and a scan.
const CatalogFile& file_for(const CatalogEntry& entry, DataRole role);

/// Entry for a name that may include parameters of a phantom, in which case the files are named after them.
/// Errors: those of find_entry() and parse_phantom().
Result<CatalogEntry> entry_with_parameters(const std::string& name);

/// File or folder name derived from a data set's name.
std::string file_stem(const std::string& name);

/// Files of a data set in one folder, verified against the known hashes; nullopt if a required file is
/// missing. Errors: as locate().
Result<std::optional<LocalData>> local_data_in(const CatalogEntry& entry,
                                               const std::filesystem::path& folder);

}  // namespace palpate
