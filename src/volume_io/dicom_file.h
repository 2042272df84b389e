#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "palpate/base/result.h"
#include "volume_io/dicom_identifiers.h"
#include "volume_io/dicom_segments.h"
#include "volume_io/dicom_structures.h"
#include "volume_io/dicom_study.h"
#include "volume_io/dicom_volumes.h"
#include "volume_io/dicom_write.h"

/// All that meets DCMTK, which has no types here. The bytes may do anything to whoever reads them: for a
/// process of its own (dicom.h).
///
/// DCMTK brings libxml2 and ICU, which take longer to load than the program itself. So what meets it
/// (dicom_file.cc) is a library of its own, libpalpate_dicom.so, which is loaded when DICOM is to be read.
namespace palpate::volume_io {

/// What one file holds of images. The frames' series is 0.
struct DicomFile {
  std::string series_uid, sop_uid;  ///< to tell series and copies of a file apart, never shown
  int series_number = 0;
  std::vector<DicomFrame> frames;

  bool operator==(const DicomFile&) const = default;
};

/// Error::what of a file without an image.
inline constexpr const char* kNoDicomImage = "holds no image";

/// The images of one file, decoded one by one.
class DicomPixels {
 public:
  virtual ~DicomPixels() = default;
  /// The words of a frame, rows x columns (of 1 bit allocated: its bits), each cut to its bits stored, sign
  /// included; numbers of padding (DicomFrame::padding) may be kept as they are in all their bits. Errors,
  /// without `where`: damaged, not as the frame says any more.
  virtual Result<void> read(const DicomFrame& frame, std::span<std::int64_t> values) = 0;
};

class DicomFiles {
 public:
  virtual ~DicomFiles() = default;
  /// DCMTK's dictionary of tags, for readers that start later, while they are kept from starting; once in a
  /// program. Error kUnavailable: it is missing.
  virtual Result<void> load_dictionary() = 0;
  /// In the process that reads, before anything below: decoders, and no log.
  virtual void begin_reading() = 0;
  /// @param name        by which it is opened
  /// @param syntax_uid  the TransferSyntaxUID of its header, empty where it has none
  /// Errors, without `where`: it is no DICOM file as far as can be read; no image.
  virtual Result<DicomFile> read_file(const std::filesystem::path& name, const std::string& syntax_uid) = 0;
  /// The same of a segmentation. Errors, without `where`: damaged, of a type or packed as is not read.
  virtual Result<DicomSegmentation> read_segmentation(const std::filesystem::path& name,
                                                      const std::string& syntax_uid) = 0;
  /// The structures of a structure set. Errors, without `where`: damaged, without a closed contour.
  virtual Result<std::vector<DicomStructure>> read_structures(const std::filesystem::path& name) = 0;
  /// What a segmentation, or a structure set, says of the images that it was made on. Errors, without
  /// `where`: damaged.
  virtual Result<DicomReference> read_reference(const std::filesystem::path& name) = 0;
  /// As identifiers_of_dicom() and files_of_dicomdir() (dicom_identifiers.h).
  virtual Result<std::vector<DicomIdentifier>> read_identifiers(const std::filesystem::path& name) = 0;
  virtual Result<std::vector<std::vector<std::string>>> read_directory(const std::filesystem::path& name) = 0;
  /// As the functions of dicom_write.h.
  virtual Result<DicomIdentity> read_identity(const std::filesystem::path& name) = 0;
  virtual Result<void> write_segmentation(const std::filesystem::path& file,
                                          const SegmentationToWrite& segmentation,
                                          const std::optional<DicomIdentity>& identity) = 0;
  virtual Result<void> write_picture(const std::filesystem::path& file, const PictureToWrite& picture,
                                     const std::optional<DicomIdentity>& identity) = 0;
  /// @param name  as above; is opened again as long as what is returned lives
  virtual Result<std::unique_ptr<DicomPixels>> open_pixels(const std::filesystem::path& name) = 0;
};

/// The library, loaded once. It is looked for as the dynamic linker looks for what a program needs.
/// Error kUnavailable: it, or what it brings, is not there.
Result<DicomFiles*> load_dicom_files();

}  // namespace palpate::volume_io

/// What the library has to offer.
extern "C" __attribute__((visibility("default"))) palpate::volume_io::DicomFiles* palpate_dicom_files();
