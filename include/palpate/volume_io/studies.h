#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"

/// Volumes in DICOM files, and the relation between a scan and its segmentation. Reading starts processes, as
/// volume_io.h describes.
namespace palpate {

/// Volumes in a DICOM file or in a folder of DICOM files. Contains no text from the files: no name, no date,
/// no identifier.
struct VolumeList {
  struct Item {
    std::string what;         ///< Description: "series 1: CT, axial, 512 x 512 x 90, 0.7 x 0.7 x 1.25 mm".
    std::string fault;        ///< Why it cannot be used, naming the slice; empty if it can.
    std::string remedy = {};  ///< Remedy, as an imperative.
  };
  std::vector<Item> volumes;       ///< Numbered from 1.
  std::vector<std::string> notes;  ///< Other contents, and files that were left out.
};
/// Lists the volumes of a DICOM file or folder.
/// @pre is_dicom(file) (volume_io.h)
/// Errors: no readable image; interrupted.
Result<VolumeList> list_volumes(const std::filesystem::path& file, const Progress& progress = {});

/// A scan and the labels that were made on it.
struct Study {
  std::filesystem::path scan;
  std::optional<int> volume;                    ///< Number of the scan's volume, if it is DICOM.
  std::optional<std::filesystem::path> labels;  ///< Unset: a scan without labels.
  std::vector<std::string> notes;               ///< Relation of the two, and what is unknown about it.
  /// True if DICOM labels reference images, series or frame of reference of the scan, or if the labels are in
  /// a format that cannot reference a scan.
  bool is_declared = true;
};
/// Finds the volume among DICOM images on which a DICOM segmentation was made, by the images, the series and
/// the frame of reference that it references; identifiers are compared in the reader process. Files of other
/// formats are returned as given.
/// @param scan    any volume
/// @param labels  unset: if `scan` is a DICOM folder, the only segmentation in it or below it
/// @param volume  number of the scan's volume, which overrides the search
/// Errors: a folder with several segmentations; a segmentation of other images, of a volume that cannot be
/// used or of several equally related ones; interrupted.
Result<Study> find_study(const std::filesystem::path& scan,
                         const std::optional<std::filesystem::path>& labels, std::optional<int> volume,
                         const Progress& progress = {});

/// A scan and its segmentation.
struct ScanAndLabels {
  std::filesystem::path scan, labels;
};
/// Identifies the scan and the segmentation among two volumes, named in either order. DICOM images are a
/// scan; surfaces, folders of masks, DICOM segmentations and structure sets are segmentations. Other files
/// are classified by their header, else by the first 2^20 voxel values that are not 0, with the criteria of
/// read_volume(). Where both remain unclear, and where read_as() is set, `first` is the scan.
/// @param names  a table for the labels; whole numbers are then enough, as for read_volume()
/// Errors: kUsage, one file given twice; kBadInput, a file that is missing or no volume, two scans, two label
/// maps.
Result<ScanAndLabels> identify_scan_and_labels(const std::filesystem::path& first,
                                               const std::filesystem::path& second,
                                               const std::optional<std::filesystem::path>& names = {});

}  // namespace palpate
