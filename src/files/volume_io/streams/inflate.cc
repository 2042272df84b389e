#include "volume_io/streams/inflate.h"

#include <algorithm>
#include <cstring>

namespace palpate::volume_io {
namespace {

constexpr std::size_t kCompressedPiece = std::size_t{1} << 16;

// ---- checksums

constexpr std::array<std::uint32_t, 256> kCrcTable = [] {
  std::array<std::uint32_t, 256> table{};
  for (std::uint32_t n = 0; n < table.size(); ++n) {
    std::uint32_t c = n;
    for (int bit = 0; bit < 8; ++bit) c = c & 1 ? 0xEDB88320u ^ c >> 1 : c >> 1;
    table[n] = c;
  }
  return table;
}();

std::uint32_t crc32_of(std::uint32_t crc, std::span<const std::byte> bytes) {
  crc = ~crc;
  for (const std::byte byte : bytes)
    crc = kCrcTable[(crc ^ static_cast<std::uint32_t>(byte)) & 0xFF] ^ crc >> 8;
  return ~crc;
}

std::uint32_t adler32_of(std::uint32_t adler, std::span<const std::byte> bytes) {
  constexpr std::uint32_t kModulus = 65521;
  // as many additions as 32 bits hold (zlib's NMAX)
  constexpr std::size_t kMost = 5552;
  std::uint32_t a = adler & 0xFFFF, b = adler >> 16;
  while (!bytes.empty()) {
    const auto piece = bytes.first(std::min(kMost, bytes.size()));
    for (const std::byte byte : piece) {
      a += static_cast<std::uint32_t>(byte);
      b += a;
    }
    a %= kModulus;
    b %= kModulus;
    bytes = bytes.subspan(piece.size());
  }
  return b << 16 | a;
}

// ---- tables of RFC 1951, 3.2.5

constexpr std::array<std::uint16_t, 29> kLengthBase{3,  4,  5,  6,   7,   8,   9,   10,  11, 13,
                                                    15, 17, 19, 23,  27,  31,  35,  43,  51, 59,
                                                    67, 83, 99, 115, 131, 163, 195, 227, 258};
constexpr std::array<std::uint8_t, 29> kLengthBits{0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2,
                                                   2, 3, 3, 3, 3, 4, 4, 4, 4, 5, 5, 5, 5, 0};
constexpr std::array<std::uint16_t, 30> kDistanceBase{
    1,   2,   3,   4,   5,   7,    9,    13,   17,   25,   33,   49,   65,    97,    129,
    193, 257, 385, 513, 769, 1025, 1537, 2049, 3073, 4097, 6145, 8193, 12289, 16385, 24577};
constexpr std::array<std::uint8_t, 30> kDistanceBits{0, 0, 0, 0, 1, 1, 2, 2,  3,  3,  4,  4,  5,  5,  6,
                                                     6, 7, 7, 8, 8, 9, 9, 10, 10, 11, 11, 12, 12, 13, 13};
// order in which the lengths of the code of code lengths are stored
constexpr std::array<std::uint8_t, 19> kOrder{16, 17, 18, 0, 8,  7, 9,  6, 10, 5,
                                              11, 4,  12, 3, 13, 2, 14, 1, 15};

std::uint32_t reversed(std::uint32_t code, int bits) {
  std::uint32_t result = 0;
  for (int n = 0; n < bits; ++n) result |= (code >> n & 1) << (bits - 1 - n);
  return result;
}

}  // namespace

bool Inflater::Code::assign(std::span<const std::uint8_t> lengths, bool incomplete_allowed) {
  count.fill(0);
  for (const std::uint8_t length : lengths) ++count[length];
  count[0] = 0;
  int left = 1;
  longest = 0;
  for (int length = 1; length <= kMaxBits; ++length) {
    left = 2 * left - count[static_cast<std::size_t>(length)];
    if (left < 0) return false;  // more codes than bits distinguish
    if (count[static_cast<std::size_t>(length)] > 0) longest = length;
  }
  // an empty code is reported when a symbol is decoded
  if (left > 0 && longest != 0 && !(incomplete_allowed && longest == 1)) return false;

  std::array<std::uint16_t, kMaxBits + 2> first{}, next_code{};
  std::uint32_t code = 0;
  for (std::size_t length = 1; length <= kMaxBits; ++length) {
    first[length + 1] = static_cast<std::uint16_t>(first[length] + count[length]);
    code = (code + count[length - 1]) << 1;
    next_code[length] = static_cast<std::uint16_t>(code);
  }
  fast.fill(0);
  for (std::size_t n = 0; n < lengths.size(); ++n) {
    const std::uint8_t length = lengths[n];
    if (length == 0) continue;
    symbol[first[length]++] = static_cast<std::uint16_t>(n);
    const std::uint32_t bits = reversed(next_code[length]++, length);
    if (length > kFastBits) continue;
    for (std::uint32_t entry = bits; entry < fast.size(); entry += 1u << length)
      fast[entry] = static_cast<std::uint16_t>(n << 4 | length);
  }
  return true;
}

Inflater::Inflater(Source source)
    : source_(std::move(source)), in_(kCompressedPiece), literals_{}, distances_{}, window_(kWindow) {}

bool Inflater::stop(const char* why) {
  fault_ = std::string("the compressed data are damaged (") + why + ")";
  return false;
}

bool Inflater::ends_early() {
  fault_ = "the compressed data end early";
  return false;
}

// ---- bits

// true if that many bits are there, at most 32; more are fetched where possible
bool Inflater::fill(int bits) {
  while (bit_count_ <= 56) {
    if (at_ == held_) {
      if (bit_count_ >= bits) return true;
      held_ = source_(in_);
      at_ = 0;
      if (held_ == 0) return false;
    }
    bits_ |= static_cast<std::uint64_t>(in_[at_++]) << bit_count_;
    bit_count_ += 8;
  }
  return true;
}

std::uint32_t Inflater::take(int bits) {
  const auto value = static_cast<std::uint32_t>(bits_ & ((std::uint64_t{1} << bits) - 1));
  bits_ >>= bits;
  bit_count_ -= bits;
  return value;
}

bool Inflater::next_byte(std::uint8_t& byte) {
  if (!fill(8)) return ends_early();
  byte = static_cast<std::uint8_t>(take(8));
  return true;
}

// next symbol; -1: the data end within it; -2: no symbol has this code
int Inflater::decode(const Code& code) {
  (void)fill(kMaxBits);
  const std::uint16_t entry = code.fast[bits_ & ((1u << kFastBits) - 1)];
  if (entry != 0) {
    const int length = entry & 15;
    if (length > bit_count_) return -1;
    (void)take(length);
    return entry >> 4;
  }
  std::uint32_t value = 0, first = 0, index = 0;
  for (int length = 1; length <= code.longest; ++length) {
    if (length > bit_count_) return -1;
    value |= static_cast<std::uint32_t>(bits_ >> (length - 1) & 1);
    const std::uint32_t count = code.count[static_cast<std::size_t>(length)];
    if (value < first + count) {
      (void)take(length);
      return code.symbol[index + value - first];
    }
    index += count;
    first = (first + count) << 1;
    value <<= 1;
  }
  return bit_count_ == 0 ? -1 : -2;
}

// ---- stages

// skips a text of a gzip header, which ends with a zero
bool Inflater::skip_text(std::uint32_t& crc) {
  for (std::uint8_t byte = 1; byte != 0;) {
    if (!next_byte(byte)) return false;
    crc = crc32_of(crc, std::as_bytes(std::span(&byte, 1)));
  }
  return true;
}

bool Inflater::begin_member() {
  std::array<std::uint8_t, 10> header{};
  for (std::size_t n = 0; n < 2; ++n)
    if (!next_byte(header[n])) return false;
  member_begin_ = produced_;
  is_gzip_ = header[0] == 0x1F && header[1] == 0x8B;
  stage_ = Stage::kBlock;
  is_last_block_ = false;
  constexpr std::uint8_t kDeflate = 8;
  if (!is_gzip_) {
    if ((header[0] << 8 | header[1]) % 31 != 0) return stop("incorrect header check");
    if ((header[0] & 15) != kDeflate) return stop("unknown compression method");
    if (header[0] >> 4 > 7) return stop("invalid window size");
    constexpr std::uint8_t kNeedsDictionary = 0x20;
    if (header[1] & kNeedsDictionary) {
      // the dictionary's checksum
      if (!fill(32)) return ends_early();
      fault_ = "the compressed data are damaged";
      return false;
    }
    check_ = 1;
    return true;
  }
  check_ = 0;
  for (std::size_t n = 2; n < 4; ++n)
    if (!next_byte(header[n])) return false;
  const std::uint8_t flags = header[3];
  constexpr std::uint8_t kHeaderCheck = 2, kExtra = 4, kName = 8, kComment = 16, kReserved = 0xE0;
  if (header[2] != kDeflate) return stop("unknown compression method");
  if (flags & kReserved) return stop("unknown header flags set");
  for (std::size_t n = 4; n < header.size(); ++n)
    if (!next_byte(header[n])) return false;
  std::uint32_t crc = crc32_of(0, std::as_bytes(std::span(header)));
  if (flags & kExtra) {
    std::array<std::uint8_t, 2> size{};
    for (std::uint8_t& byte : size)
      if (!next_byte(byte)) return false;
    crc = crc32_of(crc, std::as_bytes(std::span(size)));
    for (int left = size[0] | size[1] << 8; left > 0; --left) {
      std::uint8_t byte = 0;
      if (!next_byte(byte)) return false;
      crc = crc32_of(crc, std::as_bytes(std::span(&byte, 1)));
    }
  }
  if (flags & kName && !skip_text(crc)) return false;
  if (flags & kComment && !skip_text(crc)) return false;
  if (flags & kHeaderCheck) {
    if (!fill(16)) return ends_early();
    if (take(16) != (crc & 0xFFFF)) return stop("header crc mismatch");
  }
  return true;
}

bool Inflater::begin_block() {
  if (is_last_block_) {
    (void)take(bit_count_ & 7);
    stage_ = Stage::kTrailer;
    return true;
  }
  if (!fill(3)) return ends_early();
  is_last_block_ = take(1) != 0;
  switch (take(2)) {
    case 0: {
      (void)take(bit_count_ & 7);
      if (!fill(32)) return ends_early();
      const std::uint32_t size = take(16);
      if (take(16) != (size ^ 0xFFFF)) return stop("invalid stored block lengths");
      stored_left_ = size;
      stage_ = Stage::kStored;
      return true;
    }
    case 1: {
      std::array<std::uint8_t, kMaxSymbols> lengths{};
      for (std::size_t n = 0; n < lengths.size(); ++n)
        lengths[n] = static_cast<std::uint8_t>(n < 144 ? 8 : n < 256 ? 9 : n < 280 ? 7 : 8);
      (void)literals_.assign(lengths, false);
      std::array<std::uint8_t, 32> distances{};
      distances.fill(5);
      (void)distances_.assign(distances, false);
      stage_ = Stage::kCodes;
      return true;
    }
    case 2:
      stage_ = Stage::kCodes;
      return read_codes();
    default:
      return stop("invalid block type");
  }
}

// the two codes of a dynamic block, RFC 1951, 3.2.7
bool Inflater::read_codes() {
  if (!fill(14)) return ends_early();
  const std::size_t literals = take(5) + 257, distances = take(5) + 1, counted = take(4) + 4;
  if (literals > 286 || distances > 30) return stop("too many length or distance symbols");
  std::array<std::uint8_t, 19> of_code{};
  for (std::size_t n = 0; n < counted; ++n) {
    if (!fill(3)) return ends_early();
    of_code[kOrder[n]] = static_cast<std::uint8_t>(take(3));
  }
  Code& code = distances_;  // overwritten below
  if (!code.assign(of_code, false)) return stop("invalid code lengths set");
  std::array<std::uint8_t, 286 + 30> lengths{};
  const std::size_t all = literals + distances;
  for (std::size_t n = 0; n < all;) {
    const int symbol = decode(code);
    if (symbol == -1) return ends_early();
    // zlib reads each bit of an empty code as the length 0, and reports the missing end of block afterwards
    if (symbol < 0) {
      (void)take(1);
      ++n;
      continue;
    }
    if (symbol < 16) {
      lengths[n++] = static_cast<std::uint8_t>(symbol);
      continue;
    }
    if (symbol == 16 && n == 0) return stop("invalid bit length repeat");
    const std::uint8_t length = symbol == 16 ? lengths[n - 1] : 0;
    const int extra = symbol == 16 ? 2 : symbol == 17 ? 3 : 7;
    if (!fill(extra)) return ends_early();
    const std::size_t repeats = take(extra) + (symbol == 18 ? 11 : 3);
    if (n + repeats > all) return stop("invalid bit length repeat");
    std::fill_n(lengths.begin() + static_cast<std::ptrdiff_t>(n), repeats, length);
    n += repeats;
  }
  constexpr std::size_t kEndOfBlock = 256;
  if (lengths[kEndOfBlock] == 0) return stop("invalid code -- missing end-of-block");
  const std::span<const std::uint8_t> every(lengths);
  if (!literals_.assign(every.first(literals), true)) return stop("invalid literal/lengths set");
  if (!distances_.assign(every.subspan(literals, distances), true)) return stop("invalid distances set");
  return true;
}

bool Inflater::copy_stored() {
  while (stored_left_ > 0 && pending() < kMaxPending) {
    std::uint8_t byte = 0;
    if (!next_byte(byte)) return false;
    put(byte);
    --stored_left_;
  }
  if (stored_left_ == 0) stage_ = Stage::kBlock;
  return true;
}

bool Inflater::decode_symbols() {
  constexpr int kEndOfBlock = 256;
  while (pending() < kMaxPending) {
    const int symbol = decode(literals_);
    if (symbol == -1) return ends_early();
    if (symbol < 0 || symbol > 285) return stop("invalid literal/length code");
    if (symbol < kEndOfBlock) {
      put(static_cast<std::uint8_t>(symbol));
      continue;
    }
    if (symbol == kEndOfBlock) {
      stage_ = Stage::kBlock;
      return true;
    }
    const auto l = static_cast<std::size_t>(symbol - kEndOfBlock - 1);
    if (!fill(kLengthBits[l])) return ends_early();
    const std::uint32_t length = kLengthBase[l] + take(kLengthBits[l]);
    const int of_distance = decode(distances_);
    if (of_distance == -1) return ends_early();
    if (of_distance < 0 || of_distance > 29) return stop("invalid distance code");
    const auto d = static_cast<std::size_t>(of_distance);
    if (!fill(kDistanceBits[d])) return ends_early();
    const std::uint64_t distance = kDistanceBase[d] + take(kDistanceBits[d]);
    if (distance > produced_ - member_begin_) return stop("invalid distance too far back");
    for (std::uint32_t n = 0; n < length; ++n) put(window_[(produced_ - distance) & kWindowMask]);
  }
  return true;
}

// @pre all bytes of the member have been delivered, and are in the checksum
bool Inflater::end_member() {
  if (!fill(32)) return ends_early();
  std::uint32_t stored = take(32);
  if (!is_gzip_) stored = stored >> 24 | (stored >> 8 & 0xFF00) | (stored << 8 & 0xFF0000) | stored << 24;
  if (stored != check_) return stop("incorrect data check");
  if (is_gzip_) {
    if (!fill(32)) return ends_early();
    if (take(32) != static_cast<std::uint32_t>(produced_ - member_begin_))
      return stop("incorrect length check");
  }
  // another member, or the end
  constexpr std::uint32_t kMagic = 0x8B1F;
  stage_ = fill(16) && (bits_ & 0xFFFF) == kMagic ? Stage::kHeader : Stage::kEnd;
  return true;
}

void Inflater::add_to_check(std::span<const std::byte> bytes) {
  check_ = is_gzip_ ? crc32_of(check_, bytes) : adler32_of(check_, bytes);
}

std::size_t Inflater::read(std::span<std::byte> out) {
  std::size_t used = 0;
  while (used < out.size()) {
    if (pending() > 0) {
      const auto at = static_cast<std::size_t>(delivered_ & kWindowMask);
      const std::size_t piece = std::min({pending(), out.size() - used, kWindow - at});
      std::memcpy(out.data() + used, window_.data() + at, piece);
      add_to_check(out.subspan(used, piece));
      used += piece;
      delivered_ += piece;
      continue;
    }
    if (!fault_.empty()) break;
    bool good = true;
    // a stage that fails may have decoded bytes before, which are delivered
    while (good && pending() < kMaxPending && stage_ != Stage::kEnd) {
      if (stage_ == Stage::kTrailer && pending() > 0) break;
      switch (stage_) {
        case Stage::kHeader:
          good = begin_member();
          break;
        case Stage::kBlock:
          good = begin_block();
          break;
        case Stage::kStored:
          good = copy_stored();
          break;
        case Stage::kCodes:
          good = decode_symbols();
          break;
        case Stage::kTrailer:
          good = end_member();
          break;
        case Stage::kEnd:
          break;
      }
    }
    if (stage_ == Stage::kEnd && pending() == 0) break;
  }
  return used;
}

}  // namespace palpate::volume_io
