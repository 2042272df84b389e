#pragma once

#include <cstdint>
#include <span>

namespace palpate::volume_io {

/// Unpacks one frame of DICOM's RLE (PS3.5 Annex G): 16 numbers of 32 bits, how many segments there are and
/// where each of them begins, then for each byte of a word a segment with that byte of all words, the most
/// significant one first, packed as PackBits does.
/// @param word_bytes  1, 2 or 4, which is the number of segments
/// @param words       little endian; a whole number of words, all of which are written where it succeeds
/// @returns whether the frame is whole: false where a segment lies outside of what is there, begins before
/// the one
///          before it, breaks off, or holds less or more than a byte for each word (but for one that pads an
///          odd number)
bool unpack_rle(std::span<const std::uint8_t> packed, std::size_t word_bytes, std::span<std::uint8_t> words);

}  // namespace palpate::volume_io
