#pragma once

#include <optional>
#include <set>
#include <string>
#include <vector>

#include "palpate/base/result.h"
#include "volume_io/dicom_volumes.h"

/// Which volume of a study a segmentation was made on. Plain data, as dicom_volumes.h; identifiers are
/// compared and never shown.
namespace palpate::volume_io {

/// What a segmentation says of the images that it was made on.
struct DicomReference {
  std::set<std::string> series;               ///< SeriesInstanceUID of the images
  std::set<std::string> images;               ///< SOPInstanceUID
  std::set<std::string> frames_of_reference;  ///< FrameOfReferenceUID
  std::string own_series = {};                ///< SeriesInstanceUID of the segmentation itself
};

/// The identifiers of what frames name by index.
struct DicomIdentifiers {
  std::vector<std::string> of_series;  ///< by DicomFrame::series
  std::vector<std::string> of_file;    ///< SOPInstanceUID, by DicomFrame::file
};

/// How a segmentation belongs to a volume, the closest first.
enum class Bond {
  kImages,  ///< it was made on images of this volume
  kSeries,  ///< of its series
  kSpace,   ///< it lies in the same frame of reference
  kUnsaid,  ///< one of them does not say
  kNone,    ///< they lie in different frames of reference, so nobody knows how they lie to each other
};
std::vector<Bond> bonds_of(const DicomReference& segmentation, const std::vector<DicomVolume>& volumes,
                           const DicomIdentifiers& identifiers);

struct SegmentedVolume {
  std::size_t index = 0;
  std::vector<std::string> notes;  ///< of the segmentation: "was made on volume 2 (series 1: MR, ...)"
  bool is_said = true;             ///< that they belong together, by images, series or frame of reference
};
/// Which of them is meant: the one of that number, from 1 on; without a number the only one with the closest
/// bond. Errors, without `where`, about the segmentation: it was made on none of them, or on one that cannot
/// be used; several have the closest bond; and those of choose_volume().
Result<SegmentedVolume> choose_segmented(const std::vector<DicomVolume>& volumes,
                                         const std::vector<Bond>& bonds, std::optional<int> number);

}  // namespace palpate::volume_io
