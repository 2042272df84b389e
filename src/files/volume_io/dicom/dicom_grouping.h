#pragma once

#include <vector>

#include "volume_io/dicom/dicom_volumes.h"

/// Division of DICOM images into those of one volume, before the positions of its slices are examined. Plain
/// data, as dicom_volumes.h.
namespace palpate::volume_io {

/// Images whose distance along the normal is below this share a position; mm.
inline constexpr double kSamePosition_mm = 5e-3;

/// True if there are several frames of reference and each contains a single position. In LIDC-IDRI every
/// slice has its own: the anonymiser replaced the identifier in every file by a new one.
bool has_reference_per_position(const std::vector<DicomFrame>& frames);

/// Groups images by all attributes that are equal, or equal within a tolerance, in a volume
/// (sort_into_volumes). Images of a group may still share positions. Images without a position are grouped by
/// series, modality and fault.
std::vector<std::vector<DicomFrame>> grouped(std::vector<DicomFrame> frames);

/// Sorts a group by position along the normal and, if several of its images share a position, splits it by
/// the order of trigger times or by acquisition number; returns the whole group if neither separates them.
/// Resets trigger_time_ms and acquisition unless the split used them.
/// @param frames  a group of grouped(), not empty
std::vector<std::vector<DicomFrame>> split_duplicates(std::vector<DicomFrame> frames);

}  // namespace palpate::volume_io
