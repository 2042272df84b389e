#pragma once

#include <optional>

#include "palpate/base/result.h"
#include "palpate/volume_io/dicom_export.h"

namespace palpate {
struct LoadedScene;
}

namespace palpate::app {

/// The study of a scene's scan, where identifiers are to be kept. Errors: there is no scan, or it is no
/// DICOM.
Result<std::optional<DicomAttachment>> attachment_of(const LoadedScene& loaded, bool keep_identifiers);

}  // namespace palpate::app
