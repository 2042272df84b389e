#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"
#include "palpate/volume/volume.h"

/// What palpate gives to a PACS: labels as a segmentation (SEG), pictures as Secondary Capture. Each with
/// identifiers of its own and without a patient, unless it is attached to a study. All say that they are not
/// for clinical use.
namespace palpate {

/// The study that an object is to belong to: its patient, its study and the frame of reference of one of its
/// volumes are then named in it, and so are that volume's images.
struct DicomAttachment {
  std::filesystem::path study;  ///< a file of DICOM, or a folder
  std::optional<int> volume;    ///< its number (list_volumes), where several can be used
};

/// Each segment that has a voxel becomes one of the SEG, numbered from 1 on in the order of their ids, with
/// its name, its colour and, where its name is one that palpate knows, its code of SNOMED CT. Binary; a frame
/// for each slice that a segment is in, and for the first and the last slice, so that the grid stays whole.
/// Left-handed grids are written with their slices in the other order. The file appears whole or not at all.
/// Errors: kOutput; kBadInput for axes that are not square to each other, which SEG cannot hold, for no voxel
/// in any segment, and what is wrong with the study; kUnavailable: DCMTK is missing.
Result<void> write_dicom_segmentation(const std::filesystem::path& file, const LabelMap& labels,
                                      const std::optional<DicomAttachment>& attached = {},
                                      const Progress& progress = {});

/// A picture in colours, 3 bytes a pixel, row by row.
/// @param description  of the series; says nothing of a patient
/// Errors: as above.
Result<void> write_secondary_capture(const std::filesystem::path& file, int width, int height,
                                     std::span<const std::uint8_t> rgb, const std::string& description,
                                     const std::optional<DicomAttachment>& attached = {},
                                     const Progress& progress = {});

}  // namespace palpate
