#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"
#include "palpate/volume/label_map.h"
#include "palpate/volume/volume.h"

/// Export of DICOM objects for a PACS: labels as a segmentation (SEG), images as Secondary Capture. Unless an
/// object is attached to a study it gets new identifiers and no patient. Every object states that it is not
/// for clinical use.
namespace palpate {

/// Study to which an exported object belongs. The object then names that study, its patient, and the frame of
/// reference and the images of one of its volumes.
struct DicomAttachment {
  std::filesystem::path study;  ///< DICOM file or folder.
  std::optional<int> volume;    ///< Number of the volume as in list_volumes(); required if several can be
                                ///< used.
};

/// Writes labels as a binary DICOM segmentation (SEG). Each segment with at least one voxel becomes a segment
/// of the file, numbered from 1 in order of ascending id, with its name, its colour and, if palpate knows the
/// name, its SNOMED CT code. One frame is written for each slice that a segment occupies, and for the first
/// and the last slice, so that the extent of the grid is preserved. For left-handed grids the slice dimension
/// runs against k. The file appears complete or not at all. Errors: kOutput; kBadInput for axes that are not
/// orthogonal, which SEG cannot represent, for labels without any voxel, and for an unusable study;
/// kUnavailable if DCMTK is missing.
Result<void> write_dicom_segmentation(const std::filesystem::path& file, const LabelMap& labels,
                                      const std::optional<DicomAttachment>& attached = {},
                                      const Progress& progress = {});

/// Writes a colour image as Secondary Capture.
/// @param rgb          3 bytes per pixel, row by row
/// @param description  series description; must not contain patient data
/// Errors: as for write_dicom_segmentation().
Result<void> write_secondary_capture(const std::filesystem::path& file, int width, int height,
                                     std::span<const std::uint8_t> rgb, const std::string& description,
                                     const std::optional<DicomAttachment>& attached = {},
                                     const Progress& progress = {});

}  // namespace palpate
