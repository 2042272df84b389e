#pragma once

#include <cstdint>
#include <optional>
#include <span>

namespace palpate::volume_io {

/// What the main header of a JPEG 2000 codestream says (ISO/IEC 15444-1 Annex A), before any of it is
/// unpacked.
struct Jpeg2000Header {
  std::uint32_t columns = 0, rows = 0;
  std::uint64_t tiles = 0;
  int components = 0;
  int bits = 0;  ///< of the first component, as the next one
  bool is_signed = false;
  bool subsampled = false;       ///< a component has fewer samples than the image
  bool high_throughput = false;  ///< HTJ2K, ISO/IEC 15444-15
  bool irreversible = false;     ///< by the wavelet 9-7, whose values are not those that were packed
};

/// @param front  the first bytes, as many as there are or some 1000
/// Nothing where it is no such header or one that breaks off before its coding style.
std::optional<Jpeg2000Header> read_jpeg2000_header(std::span<const std::uint8_t> front);

}  // namespace palpate::volume_io
