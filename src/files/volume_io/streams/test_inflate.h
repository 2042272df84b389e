#pragma once

#include <zlib.h>

#include <algorithm>
#include <cstring>
#include <string>
#include <string_view>

#include "volume_io/streams/inflate.h"

/// Decoding by volume_io::Inflater and by zlib, for comparisons.
namespace palpate::test {

struct Decoded {
  std::string bytes, fault;
  bool operator==(const Decoded&) const = default;
};

/// @param most   maximum number of decoded bytes
/// @param piece  number of compressed bytes that the source gives at a time, and of decoded bytes read at a
///               time
inline Decoded decoded(std::string_view packed, std::size_t most, std::size_t piece = std::size_t{1} << 16) {
  volume_io::Inflater inflater([&](std::span<std::byte> out) {
    const std::size_t count = std::min({packed.size(), out.size(), piece});
    std::memcpy(out.data(), packed.data(), count);
    packed.remove_prefix(count);
    return count;
  });
  Decoded result;
  std::string buffer(piece, '\0');
  while (result.bytes.size() < most) {
    const std::size_t wanted = std::min(piece, most - result.bytes.size());
    const std::size_t received = inflater.read(std::as_writable_bytes(std::span(buffer)).first(wanted));
    result.bytes.append(buffer, 0, received);
    if (received < wanted) break;
  }
  result.fault = inflater.fault();
  return result;
}

/// As the program reads a file (compressed_streams.cc).
inline Decoded decoded_by_zlib(std::string_view packed, std::size_t most) {
  Decoded result;
  z_stream z{};
  constexpr int kGzipOrZlib = 15 + 32;
  if (inflateInit2(&z, kGzipOrZlib) != Z_OK) std::abort();
  z.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(packed.data()));
  z.avail_in = static_cast<uInt>(packed.size());
  std::string buffer(std::size_t{1} << 16, '\0');
  while (result.bytes.size() < most) {
    const std::size_t wanted = std::min(buffer.size(), most - result.bytes.size());
    z.next_out = reinterpret_cast<Bytef*>(buffer.data());
    z.avail_out = static_cast<uInt>(wanted);
    const int status = inflate(&z, Z_NO_FLUSH);
    const std::size_t received = wanted - z.avail_out;
    result.bytes.append(buffer, 0, received);
    if (status == Z_STREAM_END) {
      const bool again = z.avail_in >= 2 && z.next_in[0] == 0x1F && z.next_in[1] == 0x8B;
      if (!again || inflateReset(&z) != Z_OK) break;
    } else if (status == Z_BUF_ERROR && z.avail_in == 0) {
      result.fault = "the compressed data end early";
      break;
    } else if (status != Z_OK && status != Z_BUF_ERROR) {
      result.fault =
          std::string("the compressed data are damaged") + (z.msg ? std::string(" (") + z.msg + ")" : "");
      break;
    } else if (received == 0 && z.avail_in == 0) {
      result.fault = "the compressed data end early";
      break;
    }
  }
  inflateEnd(&z);
  return result;
}

/// @param window_bits  15: zlib's wrapper; 31: gzip's
/// @param strategy     of zlib: Z_FIXED gives blocks of the fixed code
inline std::string deflated(std::string_view bytes, int level, int window_bits,
                            int strategy = Z_DEFAULT_STRATEGY) {
  z_stream z{};
  if (deflateInit2(&z, level, Z_DEFLATED, window_bits, 8, strategy) != Z_OK) std::abort();
  std::string packed(deflateBound(&z, bytes.size()) + 100, '\0');
  z.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
  z.avail_in = static_cast<uInt>(bytes.size());
  z.next_out = reinterpret_cast<Bytef*>(packed.data());
  z.avail_out = static_cast<uInt>(packed.size());
  if (deflate(&z, Z_FINISH) != Z_STREAM_END) std::abort();
  packed.resize(z.total_out);
  deflateEnd(&z);
  return packed;
}

}  // namespace palpate::test
