#include "attachment.h"

#include "palpate/loading/loading.h"
#include "palpate/volume_io/volume_io.h"

namespace palpate::app {

Result<std::optional<DicomAttachment>> attachment_of(const LoadedScene& loaded, bool keep_identifiers) {
  using Attachment = std::optional<DicomAttachment>;
  if (!keep_identifiers) return Attachment();
  const Scene& scene = loaded.scene;
  if (!scene.scan || !is_dicom(scene.resolve(*scene.scan)))
    return Error{ErrorKind::kUsage, "the scan is not DICOM, so there is no study to attach the result to",
                 "--keep-identifiers", "leave it out"};
  return Attachment(DicomAttachment{scene.resolve(*scene.scan), scene.scan_volume});
}

}  // namespace palpate::app
