#pragma once

#include <optional>

#include "palpate/base/result.h"
#include "palpate/volume_io/dicom_export.h"

namespace palpate {
struct LoadedScene;
}

namespace palpate::app {

/// DICOM study of the scan of a scene, if identifiers are to be kept; empty otherwise. Errors: the scene has
/// no scan, or the scan is not DICOM.
Result<std::optional<DicomAttachment>> attachment_of(const LoadedScene& loaded, bool keep_identifiers);

}  // namespace palpate::app
