#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/volume_io/identifiers.h"

/// Patient identifiers of a DICOM file. Uses DCMTK, in libpalpate_dicom.so.
namespace palpate::volume_io {

/// An element with a value.
struct DicomIdentifier {
  IdentifierKind kind{};
  std::string what;   ///< "PatientName (0010,0010)", "private (0029,1001)"
  std::string value;  ///< Value as text, truncated to a length that fits a line; for binary values the number
                      ///< of bytes.
};

/// Identifiers of a file in the order of their tags, including those in sequences, and BurnedInAnnotation
/// (0028,0301) with any value. Errors, without `where`: not readable as DICOM.
Result<std::vector<DicomIdentifier>> identifiers_of_dicom(const std::filesystem::path& name);

/// Files that a DICOMDIR references, as the components of paths relative to its folder (ReferencedFileID
/// (0004,1500)). Errors, without `where`: damaged; no file.
Result<std::vector<std::vector<std::string>>> files_of_dicomdir(const std::filesystem::path& name);

}  // namespace palpate::volume_io
