#pragma once

#include <filesystem>
#include <functional>
#include <vector>

#include "volume_io/dicom/dicom_process.h"

/// Shared by the readers of DICOM segmentations and structure sets.
namespace palpate::volume_io {

/// Sends the labels of files to the parent, in the reader process; returns as ReaderProcess::Work does.
using ServeLabels =
    std::function<bool(DicomLibrary&, reader::ParentEnd&, const std::vector<std::filesystem::path>& files)>;

/// Starts a reader process for the labels of one file, or of several files of a folder.
/// @param file   file that the user named
/// @param files  files that the process reads
/// @param serve  called in the process
Result<DicomReader> open_dicom_labels(const std::filesystem::path& file,
                                      std::vector<std::filesystem::path> files, const Progress& progress,
                                      const ServeLabels& serve);

}  // namespace palpate::volume_io
