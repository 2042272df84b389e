#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <vector>

#include "palpate/reader/reader_process.h"
#include "palpate/volume_io/dicom_export.h"
#include "volume_io/dicom_write.h"
#include "volume_io/voxel_source.h"

/// DICOM files, one or a folder of them, read by a process of its own as other volumes are (volume_reader.h).
/// This process looks for the files and starts it; it may open what stands in the folder and below. It says
///
///   u32 n     file n is begun; their number: all are done                            as often as it takes
///   u32 ~0    and byte 1, or byte 0 with a refusal as in volume_message.h            what they hold is known
///   then what volume_message.h has of a volume and its voxels; of a list
///   u32 volumes, and of each text what, text fault, text remedy; u32 notes, texts
namespace palpate::volume_io {

/// A process that has understood a volume and waits for a word to send its voxels.
struct DicomReader {
  std::unique_ptr<reader::ReaderProcess> process;
  VolumeFile volume;
};
/// @param file    of which is_dicom() (volume_io.h) holds
/// @param number  of the volume, see choose_volume()
Result<DicomReader> open_dicom(const std::filesystem::path& file, std::optional<int> number,
                               const Progress& progress);

class DicomFiles;
/// What DICOM files are read and written by, with its dictionary. Error kUnavailable.
Result<DicomFiles*> ready_dicom_library();
/// Which patient and study the objects belong to that are attached to a study, and the images of its volume.
/// Errors: what is wrong with the study; those of choose_volume().
Result<DicomIdentity> identity_of_study(const DicomAttachment& attached, const Progress& progress);

/// The DICOM segmentations that a plain file or a folder without images holds, by their first bytes, in the
/// order of their names.
std::vector<std::filesystem::path> dicom_segmentation_files(const std::filesystem::path& file);
/// The same of a segmentation, which may be spread over several files: dicom_segmentation_files() finds one
/// at least. Segments that overlap come in layers.
Result<DicomReader> open_dicom_segmentation(const std::filesystem::path& file, const Progress& progress);

/// Whether a plain file is a DICOM structure set, by its first bytes.
bool is_dicom_structures(const std::filesystem::path& file);
/// The same of a structure set, of which is_dicom_structures() holds, on the grid of a scan.
Result<DicomReader> open_dicom_structures(const std::filesystem::path& file, const GridGeometry& grid,
                                          const Progress& progress);

}  // namespace palpate::volume_io
