#pragma once

#include <filesystem>

#include "palpate/catalog/catalog.h"

namespace palpate {

/// Downloads what is missing or damaged of a data set in a folder that exists. A missing extra is a
/// warning, and so is an image on another grid than the label map's, which is removed.
/// Errors: as fetch().
Result<void> fetch_files(const CatalogEntry& entry, const std::filesystem::path& folder,
                         const FetchOptions& options, const Progress& progress, const Warn& warn);

}  // namespace palpate
