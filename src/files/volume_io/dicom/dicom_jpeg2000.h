#pragma once

#include <cstdint>
#include <span>

#include "volume_io/dicom/dicom_jpeg2000_header.h"

namespace palpate::volume_io {

/// Decompresses one frame of JPEG 2000 by OpenJPEG.
/// @param header      header of the codestream, with the size of the frame, one component and at most 32 bits
/// @param packed      the codestream
/// @param word_bytes  bytes per value, 1, 2 or 4, sufficient for its bits
/// @param words       rows x columns values, little endian, in two's complement of the whole word
/// @returns true if the frame is complete; false if it is damaged, truncated or does not fit into memory
bool unpack_jpeg2000(const Jpeg2000Header& header, std::span<const std::uint8_t> packed,
                     std::size_t word_bytes, std::span<std::uint8_t> words);

}  // namespace palpate::volume_io
