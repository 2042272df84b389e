#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/volume_io/identifiers.h"

/// What of a DICOM file says who the patient is. By DCMTK, in libpalpate_dicom.so.
namespace palpate::volume_io {

/// One element of a file that has a value.
struct DicomIdentifier {
  IdentifierKind kind{};
  std::string what;   ///< "PatientName (0010,0010)", "private (0029,1001)"
  std::string value;  ///< as text, cut to what a line bears; of bytes their number
};

/// Those of one file, and BurnedInAnnotation (0028,0301) whatever it says, in sequences too, in the order of
/// their tags. Errors, without `where`: it is no DICOM file as far as can be read.
Result<std::vector<DicomIdentifier>> identifiers_of_dicom(const std::filesystem::path& name);

/// The files that a DICOMDIR names, each from its folder on, part by part (ReferencedFileID (0004,1500)).
/// Errors, without `where`: damaged; without a file.
Result<std::vector<std::vector<std::string>>> files_of_dicomdir(const std::filesystem::path& name);

}  // namespace palpate::volume_io
