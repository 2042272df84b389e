#pragma once

#include <optional>
#include <set>
#include <string>
#include <vector>

#include "palpate/base/result.h"
#include "volume_io/dicom/dicom_volumes.h"

/// Determines on which volume of a study a segmentation was made. Plain data, as dicom_volumes.h; identifiers
/// are compared and never displayed.
namespace palpate::volume_io {

/// Images that a segmentation references.
struct DicomReference {
  std::set<std::string> series;               ///< SeriesInstanceUID of the images.
  std::set<std::string> images;               ///< SOPInstanceUID.
  std::set<std::string> frames_of_reference;  ///< FrameOfReferenceUID.
  std::string own_series = {};                ///< SeriesInstanceUID of the segmentation itself.
};

/// Identifiers to which DicomFrame refers by index.
struct DicomIdentifiers {
  std::vector<std::string> of_series;  ///< SeriesInstanceUID, indexed by DicomFrame::series.
  std::vector<std::string> of_file;    ///< SOPInstanceUID, indexed by DicomFrame::file.
};

/// Relation of a segmentation to a volume, the closest first.
enum class VolumeRelation {
  kImages,       ///< References to images of this volume.
  kSeries,       ///< Reference to the volume's series.
  kSpace,        ///< Both have the same frame of reference.
  kUnspecified,  ///< One of them does not state its frame of reference.
  kNone,         ///< Their frames of reference differ, so their relative position is unknown.
};
/// Relation of a segmentation to each volume.
std::vector<VolumeRelation> relations_of(const DicomReference& segmentation,
                                         const std::vector<DicomVolume>& volumes,
                                         const DicomIdentifiers& identifiers);

struct SegmentedVolume {
  std::size_t index = 0;
  std::vector<std::string> notes;  ///< Sentences about the segmentation: "was made on volume 2 (series 1: MR,
                                   ///< ...)".
  bool is_declared = true;         ///< The relation is stated by images, series or frame of reference.
};
/// Selects the volume of a segmentation: the one of the given number, from 1 on; without a number the only
/// one with the closest relation. Errors, without `where`, about the segmentation: made on none of the
/// volumes, or on one that cannot be used; several have the closest relation; and those of choose_volume().
Result<SegmentedVolume> choose_segmented(const std::vector<DicomVolume>& volumes,
                                         const std::vector<VolumeRelation>& relations,
                                         std::optional<int> number);

}  // namespace palpate::volume_io
