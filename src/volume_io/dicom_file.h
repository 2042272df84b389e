#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "volume_io/dicom_volumes.h"

/// All that meets DCMTK, which has no types here. The bytes may do anything to whoever reads them: for a
/// process of its own (dicom.h).
namespace palpate::volume_io {

/// Makes DCMTK ready for readers that start later, while they are kept from starting: its dictionary of tags,
/// once in a program. Error kUnavailable: the dictionary is missing.
Result<void> load_dicom_dictionary();
/// In the process that reads, before anything else here: its decoders, and no log.
void begin_reading_dicom();

/// What one file holds of images. The frames' series is 0.
struct DicomFile {
  std::string series_uid;  ///< to tell series apart, never shown
  int series_number = 0;
  std::vector<DicomFrame> frames;
};

/// Error::what of a file without an image.
inline constexpr const char* kNoDicomImage = "holds no image";
/// @param name   by which it is opened
/// @param front  its first bytes
/// Errors, without `where`: it is no DICOM file as far as can be read; no image.
Result<DicomFile> read_dicom_file(const std::filesystem::path& name, std::string_view front);

/// The images of one file, decoded one by one.
class DicomPixels {
 public:
  /// @param name  as above; is opened again as long as this lives
  static Result<DicomPixels> open(const std::filesystem::path& name);
  DicomPixels(DicomPixels&&) noexcept;
  DicomPixels& operator=(DicomPixels&&) noexcept;
  ~DicomPixels();

  /// The stored values of a frame: rows x columns, in the range of its bits stored, sign included.
  /// Errors, without `where`: damaged, not as the frame says any more.
  Result<void> read(const DicomFrame& frame, std::span<std::int64_t> values);

 private:
  struct Content;
  explicit DicomPixels(std::unique_ptr<Content> content);
  std::unique_ptr<Content> content_;
};

}  // namespace palpate::volume_io
