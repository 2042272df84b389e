#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "volume_io/dicom/dicom_library.h"

/// Readers of DICOM files behind DicomLibrary, one source each. They throw std::bad_alloc for a length in the
/// file, which is untrusted; their errors are those of the members of DicomLibrary.
namespace palpate::volume_io {

/// DicomLibrary::read_file (dicom_images.cc)
Result<DicomFile> read_images(const std::filesystem::path& name, const std::string& syntax_uid);
/// DicomLibrary::read_segmentation (dicom_segment_file.cc)
Result<DicomSegmentation> read_segments(const std::filesystem::path& name, const std::string& syntax_uid);
/// DicomLibrary::read_structures (dicom_structure_file.cc)
Result<std::vector<DicomStructure>> read_structure_set(const std::filesystem::path& name);
/// DicomLibrary::read_reference (dicom_references.cc)
Result<DicomReference> read_references(const std::filesystem::path& name);
/// DicomLibrary::open_pixels (dicom_pixels.cc)
Result<std::unique_ptr<DicomPixels>> open_file_pixels(const std::filesystem::path& name);

}  // namespace palpate::volume_io
