#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <vector>

#include "palpate/reader/reader_process.h"
#include "palpate/volume_io/dicom_export.h"
#include "volume_io/dicom/dicom_write.h"
#include "volume_io/voxel_source.h"

/// Reads DICOM files, one or a folder of them, in a confined process as for other volumes (volume_reader.h).
/// The parent process lists the files and starts the reader, which may open the folder and its contents only.
/// Protocol from the reader to the parent:
///
///   u32 n     reading of file n has started; n = number of files: all are read       repeated
///   u32 ~0    then byte 1, or byte 0 and a refusal as in volume_message.h            end of the analysis
///   then volume and voxels as in volume_message.h; or, for a list of volumes,
///   u32 volumes, and for each: text what, text fault, text remedy; u32 notes, texts
namespace palpate::volume_io {

/// Reader process that has parsed a volume and waits for a request to send its voxels.
struct DicomReader {
  std::unique_ptr<reader::ReaderProcess> process;
  VolumeFile volume;
};
/// Starts a reader process for a DICOM volume.
/// @pre is_dicom(file) (volume_io.h)
/// @param number  number of the volume, see choose_volume()
Result<DicomReader> open_dicom(const std::filesystem::path& file, std::optional<int> number,
                               const Progress& progress);

class DicomLibrary;
/// Library that reads and writes DICOM files, with its dictionary loaded. Errors: kUnavailable.
Result<DicomLibrary*> ready_dicom_library();
/// Patient, study and images of a volume, for objects that are attached to a study. Errors: an unusable
/// study; those of choose_volume().
Result<DicomIdentity> identity_of_study(const DicomAttachment& attached, const Progress& progress);

/// DICOM segmentations, recognised by their first bytes, of a regular file or of a folder without images,
/// ordered by name.
std::vector<std::filesystem::path> dicom_segmentation_files(const std::filesystem::path& file);
/// Starts a reader process for a segmentation, which may be spread over several files;
/// dicom_segmentation_files() must find at least one. Overlapping segments are distributed over layers.
Result<DicomReader> open_dicom_segmentation(const std::filesystem::path& file, const Progress& progress);

/// True if a regular file is a DICOM structure set, by its first bytes.
bool is_dicom_structures(const std::filesystem::path& file);
/// Starts a reader process that rasterises a structure set on the grid of a scan.
/// @pre is_dicom_structures(file)
Result<DicomReader> open_dicom_structures(const std::filesystem::path& file, const GridGeometry& grid,
                                          const Progress& progress);

}  // namespace palpate::volume_io
