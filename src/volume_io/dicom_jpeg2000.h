#pragma once

#include <cstdint>
#include <span>

#include "volume_io/dicom_jpeg2000_header.h"

namespace palpate::volume_io {

/// Unpacks one frame of JPEG 2000 by OpenJPEG, which has no types here.
/// @param header  of it, whose size is that of the frame, of one component and at most 32 bits
/// @param packed  its codestream
/// @param word_bytes  1, 2 or 4, with room for its bits
/// @param words       rows x columns, little endian: two's complement in all bits of a word
/// @returns whether it is whole: false where it is damaged or breaks off, or takes more memory than there is
bool unpack_jpeg2000(const Jpeg2000Header& header, std::span<const std::uint8_t> packed,
                     std::size_t word_bytes, std::span<std::uint8_t> words);

}  // namespace palpate::volume_io
