#pragma once

#include <optional>

#include "palpate/base/result.h"
#include "palpate/volume_io/dicom_export.h"

namespace palpate {
struct LoadedScene;
}

namespace palpate::app {

/// DICOM study that an export of the scene attaches to; empty unless `keep_identifiers`. Errors: the scene
/// has no scan, or the scan is not DICOM.
Result<std::optional<DicomAttachment>> attachment_of(const LoadedScene& loaded, bool keep_identifiers);

}  // namespace palpate::app
