#pragma once

#include <cstdint>
#include <optional>
#include <span>

namespace palpate::volume_io {

/// Main header of a JPEG 2000 codestream (ISO/IEC 15444-1 Annex A), read before decompression.
struct Jpeg2000Header {
  std::uint32_t columns = 0, rows = 0;
  std::uint64_t tiles = 0;
  int components = 0;
  int bits = 0;                  ///< Bits per sample of the first component.
  bool is_signed = false;        ///< The first component's samples are signed.
  bool subsampled = false;       ///< A component has fewer samples than the image.
  bool high_throughput = false;  ///< HTJ2K, ISO/IEC 15444-15.
  bool irreversible = false;     ///< Lossy 9-7 wavelet.
};

/// Parses the main header; nullopt if it is invalid or ends before its coding style.
/// @param front  first bytes of the codestream; about 1000 suffice
std::optional<Jpeg2000Header> read_jpeg2000_header(std::span<const std::uint8_t> front);

}  // namespace palpate::volume_io
