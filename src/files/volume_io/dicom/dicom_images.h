#pragma once

#include "volume_io/dicom/dicom_elements.h"
#include "volume_io/dicom/dicom_library.h"

/// Description of the images of a DICOM file: size, values, position and compression.
namespace palpate::volume_io {

inline constexpr const char* kHighThroughput = "High-Throughput JPEG 2000 (HTJ2K)";

bool is_jpeg2000(E_TransferSyntax syntax);
/// Fault if the compression is not supported.
/// @param uid  TransferSyntaxUID; empty if the file has none
std::optional<Fault> unsupported_syntax(E_TransferSyntax syntax, const std::string& uid);
/// Reads size and layout of the values, which may be single bits; returns a fault if they are not supported.
std::optional<Fault> read_bits(DcmItem& root, DicomFrame& frame);
/// Value of a word's stored bits, sign-extended if it is signed.
std::int64_t stored_value(std::uint64_t word, const DicomFrame& frame);
/// Value of a padding element, accepted as a signed or an unsigned number, because old files confuse the two.
/// If the frame's values are signed, it is sign-extended from bits_allocated instead of bits_stored, because
/// padding may use bits above the stored ones. nullopt if the element is missing or has an implausible
/// length.
std::optional<std::int64_t> padding_of(DcmItem& root, const DcmTagKey& tag, const DicomFrame& frame);
/// Lossy compression, as far as the attributes or the first frame reveal it.
bool is_lossy(DcmItem& root, E_TransferSyntax syntax);
/// Reads position, orientation and spacing; returns a fault if they are missing or invalid.
/// @param several  whether the file has several frames
std::optional<Fault> read_position(const Attributes& attributes, bool several, DicomFrame& frame);
/// Size of a frame without compression.
std::uint64_t bits_of_frame(const DicomFrame& frame);
std::uint64_t bytes_of_frame(const DicomFrame& frame);
/// Checks that the pixel data are present and complete, as far as possible without decoding.
/// @param frames  number of frames
std::optional<Fault> check_pixels(DcmItem& root, const DicomFrame& frame, std::size_t frames, Loaded loaded);

}  // namespace palpate::volume_io
