#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "palpate/base/result.h"
#include "volume_io/dicom/dicom_identifiers.h"
#include "volume_io/dicom/dicom_segments.h"
#include "volume_io/dicom/dicom_structures.h"
#include "volume_io/dicom/dicom_study.h"
#include "volume_io/dicom/dicom_volumes.h"
#include "volume_io/dicom/dicom_write.h"

/// Interface to DCMTK without DCMTK's types. Untrusted bytes may compromise the process that reads them: call
/// it in a reader process (dicom.h).
///
/// DCMTK links libxml2 and ICU, which take longer to load than the program itself. The code that uses it
/// (dicom_library_entry.cc and the readers of dicom_readers.h) is therefore a library of its own,
/// libpalpate_dicom.so, which is loaded when DICOM is first needed.
namespace palpate::volume_io {

/// Images of one file. DicomFrame::series of its frames is 0.
struct DicomFile {
  std::string series_uid, sop_uid;  ///< SeriesInstanceUID and SOPInstanceUID, to distinguish series and to
                                    ///< detect copies; never displayed.
  int series_number = 0;
  std::vector<DicomFrame> frames;

  bool operator==(const DicomFile&) const = default;
};

/// Error::what for a file without an image.
inline constexpr const char* kNoDicomImage = "holds no image";

/// Decoder of the images of one file.
class DicomPixels {
 public:
  virtual ~DicomPixels() = default;
  /// Decodes a frame.
  /// @param values  rows x columns stored values, each sign-extended from its BitsStored bits (single bits if
  ///                one bit is allocated). Values within the padding range (DicomFrame::padding) retain all
  ///                allocated bits.
  /// Errors, without `where`: damaged; inconsistent with the frame's description.
  virtual Result<void> read(const DicomFrame& frame, std::span<std::int64_t> values) = 0;
};

class DicomLibrary {
 public:
  virtual ~DicomLibrary() = default;
  /// Loads DCMTK's data dictionary, once per program, for reader processes that are started afterwards; none
  /// may be started meanwhile. Errors: kUnavailable if it is missing.
  virtual Result<void> load_dictionary() = 0;
  /// Prepares a reader process before the functions below are called: registers decoders and disables
  /// logging.
  virtual void begin_reading() = 0;
  /// Reads the attributes of all images of a file.
  /// @param name        path by which the file is opened
  /// @param syntax_uid  TransferSyntaxUID of its header; empty if it has none
  /// Errors, without `where`: not readable as DICOM; no image.
  virtual Result<DicomFile> read_file(const std::filesystem::path& name, const std::string& syntax_uid) = 0;
  /// Reads the attributes of a segmentation. Errors, without `where`: damaged; unsupported type or
  /// compression.
  virtual Result<DicomSegmentation> read_segmentation(const std::filesystem::path& name,
                                                      const std::string& syntax_uid) = 0;
  /// Reads the structures of a structure set. Errors, without `where`: damaged; no closed contour.
  virtual Result<std::vector<DicomStructure>> read_structures(const std::filesystem::path& name) = 0;
  /// Images that a segmentation or a structure set references. Errors, without `where`: damaged.
  virtual Result<DicomReference> read_reference(const std::filesystem::path& name) = 0;
  /// See identifiers_of_dicom() and files_of_dicomdir() (dicom_identifiers.h).
  virtual Result<std::vector<DicomIdentifier>> read_identifiers(const std::filesystem::path& name) = 0;
  virtual Result<std::vector<std::vector<std::string>>> read_directory(const std::filesystem::path& name) = 0;
  /// See the functions of dicom_write.h.
  virtual Result<DicomIdentity> read_identity(const std::filesystem::path& name) = 0;
  virtual Result<void> write_segmentation(const std::filesystem::path& file,
                                          const SegmentationToWrite& segmentation,
                                          const std::optional<DicomIdentity>& identity) = 0;
  virtual Result<void> write_picture(const std::filesystem::path& file, const PictureToWrite& picture,
                                     const std::optional<DicomIdentity>& identity) = 0;
  /// Opens a file for decoding.
  /// @param name  path of the file; it is reopened during the lifetime of the returned object
  virtual Result<std::unique_ptr<DicomPixels>> open_pixels(const std::filesystem::path& name) = 0;
};

/// Loads the library once, by the search path of the dynamic linker. Errors: kUnavailable if the library or
/// one of its dependencies is missing.
Result<DicomLibrary*> load_dicom_library();

}  // namespace palpate::volume_io

/// Entry point of the library.
extern "C" __attribute__((visibility("default"))) palpate::volume_io::DicomLibrary* palpate_dicom_library();
