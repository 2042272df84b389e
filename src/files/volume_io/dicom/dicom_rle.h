#pragma once

#include <cstdint>
#include <span>

namespace palpate::volume_io {

/// Decompresses one frame of DICOM's RLE (PS3.5 Annex G): a header of 16 32-bit numbers with the number of
/// segments and their offsets, then one PackBits segment for each byte of a word, the most significant byte
/// first.
/// @param word_bytes  bytes per word, 1, 2 or 4; must equal the number of segments
/// @param words       little endian; a whole number of words, all written on success
/// @returns true if the frame is complete; false if a segment lies outside the data, begins before its
///          predecessor, is truncated, or does not contain exactly one byte for each word (except for one
///          byte that pads an odd length)
bool unpack_rle(std::span<const std::uint8_t> packed, std::size_t word_bytes, std::span<std::uint8_t> words);

}  // namespace palpate::volume_io
