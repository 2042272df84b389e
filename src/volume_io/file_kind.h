#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "volume_io/mesh.h"

namespace palpate::volume_io {

/// What a file is, and the way from it to a volume.
struct FileKind {
  std::string what;          ///< "a DICOM segmentation (SEG)"
  std::string remedy;        ///< what to do with it, in an imperative
  std::string_view volume;   ///< of a format that is read here its name, "NRRD"; else empty
  bool dicom_image = false;  ///< a slice of a series, or a whole one
  bool dicom = false;        ///< of DICOM, image or not
  bool dicom_segmentation = false;
  bool dicom_structures = false;                  ///< contours, which take the grid of a scan
  bool dicom_directory = false;                   ///< a DICOMDIR, which names files
  std::optional<MeshFormat> mesh = std::nullopt;  ///< of a surface that is read here
};

/// How many bytes at the front of a file tell its kind.
constexpr std::size_t kKindBytes = 4096;

/// What the first bytes of a file tell, or nothing for a text or what is not known. Untrusted bytes.
/// @param name  of the file: some formats show it only there
/// @param size  of the whole file; 0 where it is not known
std::optional<FileKind> kind_of(std::string_view front, const std::string& name, std::uint64_t size);

/// The TransferSyntaxUID of a DICOM file's own header, from its first bytes; empty where it has none.
std::string dicom_transfer_syntax(std::string_view front);

}  // namespace palpate::volume_io
