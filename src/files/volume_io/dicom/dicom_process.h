#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/reader/reader_process.h"
#include "volume_io/dicom/dicom.h"
#include "volume_io/dicom/dicom_library.h"
#include "volume_io/dicom/dicom_volumes.h"
#include "volume_io/formats/file_kind.h"
#include "volume_io/volume_message.h"
#include "volume_io/volume_reader.h"

/// Steps that all readers of DICOM share: the parent process finds the files and starts a reader process for
/// them; the reader process parses them and reports its progress (dicom.h has the protocol).
namespace palpate::volume_io {

inline constexpr std::size_t kMaxDicomFiles = 200'000;

/// Files for a reader process.
struct FoundFiles {
  std::vector<std::filesystem::path> files;  ///< Ordered by name; the order has no effect
  /// Files and folders that the process may open, with their contents.
  std::vector<std::filesystem::path> roots;
  std::vector<std::string> notes;
};

// ---- in the parent process

/// First kKindBytes of a file, fewer at its end; empty if it cannot be read.
std::string front_of(const std::filesystem::path& file);
/// Kind of a DICOM file by its first bytes; nullopt for other files.
/// @param front  result of front_of(file)
std::optional<FileKind> dicom_kind_of(const std::filesystem::path& file, std::string_view front);
/// Kind of a DICOM file; nullopt for a path that is not a regular file, and for other files.
std::optional<FileKind> kind_of_dicom_file(const std::filesystem::path& file);
bool is_dicom_directory(const std::filesystem::path& file);

/// Files to be read for a named file, DICOMDIR or folder. Errors: interrupted; a damaged DICOMDIR, or one
/// that references a file elsewhere.
Result<FoundFiles> find_files(const std::filesystem::path& named, const Progress& progress);

/// Starts a reader process that may open the roots and their contents.
Result<std::unique_ptr<reader::ReaderProcess>> start_dicom_reader(const FoundFiles& found,
                                                                  std::size_t shared_bytes,
                                                                  const Progress& progress,
                                                                  const reader::ReaderProcess::Work& work);
/// Waits until the process has read all files. Errors: those of the process, about `named` or the file that
/// it was reading.
Result<void> wait_for_files(reader::ReaderProcess& process, const FoundFiles& found, Files named,
                            const Progress& progress);

/// The error with this file as its location.
Error at_file(const std::filesystem::path& file, const Error& error);
/// "1 file", "2 files".
std::string counted(std::size_t count, const std::string& singular, const std::string& plural);

// ---- in the reader process

/// Everything that the files hold, sorted into volumes.
struct DicomContent {
  std::vector<DicomVolume> volumes;
  std::vector<std::string> notes;   ///< About data that may be missing in a volume
  std::vector<std::string> others;  ///< Descriptions of other contents
  DicomIdentifiers identifiers;
};
/// Parses all files, and sends the number of each as it is begun. Errors: no readable image.
Result<DicomContent> find_content(DicomLibrary& library, reader::ParentEnd& parent, const FoundFiles& found);

}  // namespace palpate::volume_io
