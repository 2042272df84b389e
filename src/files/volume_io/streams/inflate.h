#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace palpate::volume_io {

/// Decoder of DEFLATE data (RFC 1951) in the wrapper of gzip (RFC 1952) or zlib (RFC 1950), which its first
/// bytes tell apart, for builds without zlib. It accepts and rejects what zlib's inflate() does, with the
/// same texts, and verifies every checksum. Gzip members may be concatenated; other bytes after the end are
/// ignored. The input is untrusted. Memory: 170 KiB.
class Inflater {
 public:
  /// Fills a buffer with the next compressed bytes; fewer only at their end.
  using Source = std::function<std::size_t(std::span<std::byte>)>;
  explicit Inflater(Source source);

  /// Fills `out`; fewer bytes mean the end of the data, and fault() is set if they ended abnormally.
  std::size_t read(std::span<std::byte> out);
  /// Why the data ended abnormally: "the compressed data end early", "the compressed data are damaged
  /// (incorrect data check)"; empty: they did not.
  const std::string& fault() const { return fault_; }

 private:
  static constexpr int kFastBits = 10, kMaxBits = 15, kMaxSymbols = 288;

  /// Canonical Huffman code, at most 15 bits long.
  struct Code {
    /// By the next kFastBits bits: symbol * 16 + length of a code of that length or less; 0: a longer code.
    std::array<std::uint16_t, 1 << kFastBits> fast;
    std::array<std::uint16_t, kMaxBits + 1> count;  ///< Number of codes of each length.
    std::array<std::uint16_t, kMaxSymbols> symbol;  ///< Symbols ordered by their code.
    int longest;                                    ///< Length of the longest code; 0: there is none.

    /// @param incomplete_allowed  whether a code of a single symbol, one bit long, is valid, as it is in zlib
    ///                            for literals and distances
    /// Returns false for lengths that form no code.
    bool assign(std::span<const std::uint8_t> lengths, bool incomplete_allowed);
  };
  enum class Stage { kHeader, kBlock, kStored, kCodes, kTrailer, kEnd };

  // bits
  bool fill(int bits);
  std::uint32_t take(int bits);
  bool next_byte(std::uint8_t& byte);
  int decode(const Code& code);

  // stages; false: the data ended abnormally
  bool begin_member();
  bool skip_text(std::uint32_t& crc);
  bool begin_block();
  bool read_codes();
  bool copy_stored();
  bool decode_symbols();
  bool end_member();
  bool stop(const char* why);
  bool ends_early();

  void put(std::uint8_t byte) { window_[produced_++ & kWindowMask] = byte; }
  std::size_t pending() const { return static_cast<std::size_t>(produced_ - delivered_); }
  void add_to_check(std::span<const std::byte> bytes);

  /// Ring of decoded bytes: those not yet delivered, and the 32 KiB before them that distances reach.
  static constexpr std::size_t kWindow = std::size_t{1} << 17, kWindowMask = kWindow - 1;
  /// Decoding pauses with more undelivered bytes than this.
  static constexpr std::size_t kMaxPending = kWindow / 2;

  Source source_;
  std::vector<std::byte> in_;
  std::size_t at_ = 0, held_ = 0;
  std::uint64_t bits_ = 0;
  int bit_count_ = 0;

  Stage stage_ = Stage::kHeader;
  bool is_gzip_ = false, is_last_block_ = false;
  std::uint32_t stored_left_ = 0;
  Code literals_, distances_;
  std::vector<std::uint8_t> window_;
  std::uint64_t produced_ = 0, delivered_ = 0;
  std::uint64_t member_begin_ = 0;  ///< produced_ at the begin of the member: distances reach no further back
  std::uint32_t check_ = 0;         ///< CRC-32 or Adler-32 of the member's delivered bytes.
  std::string fault_;
};

}  // namespace palpate::volume_io
