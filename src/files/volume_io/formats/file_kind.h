#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "volume_io/mesh/mesh.h"

namespace palpate::volume_io {

/// Kind of a file, and how to get from it to a volume.
struct FileKind {
  std::string what;    ///< Description: "a DICOM segmentation (SEG)".
  std::string remedy;  ///< Advice for the user, as an imperative.
  /// Name of the format if it is read by palpate, "NRRD"; otherwise empty.
  std::string_view readable_format;
  bool dicom_image = false;  ///< A slice of a series, or a whole series.
  bool dicom = false;        ///< Any DICOM file, image or not.
  bool dicom_segmentation = false;
  bool dicom_structures = false;                  ///< Contours, which need the grid of a scan.
  bool dicom_directory = false;                   ///< A DICOMDIR, which references files.
  std::optional<MeshFormat> mesh = std::nullopt;  ///< Set for a surface that is read by palpate.
};

/// Number of bytes at the beginning of a file that suffice to determine its kind.
constexpr std::size_t kKindBytes = 4096;

/// Kind of a file by its first bytes, which are untrusted; nullopt for text and unknown content.
/// @param name  file name: some formats are recognised only by it
/// @param size  size of the whole file; bytes, 0 if unknown
std::optional<FileKind> kind_of(std::string_view front, const std::string& name, std::uint64_t size);

/// TransferSyntaxUID of a DICOM file's meta header, from its first bytes; empty if it has none.
std::string dicom_transfer_syntax(std::string_view front);

}  // namespace palpate::volume_io
