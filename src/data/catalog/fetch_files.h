#pragma once

#include <filesystem>

#include "palpate/catalog/catalog.h"

namespace palpate {

/// Downloads the missing or damaged files of a data set into an existing folder. A missing optional file
/// causes a warning, and so does an image on another grid than the label map's, which is removed. Errors: as
/// fetch().
Result<void> fetch_files(const CatalogEntry& entry, const std::filesystem::path& folder,
                         const FetchOptions& options, const Progress& progress, const Warn& warn);

}  // namespace palpate
