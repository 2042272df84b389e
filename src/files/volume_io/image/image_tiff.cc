#include <zlib.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <map>
#include <set>
#include <string>

#include "volume_io/image/image.h"
#include "volume_io/voxel_source.h"

/// TIFF 6.0 and BigTIFF decoder, without libtiff, whose Debian build loads a library under the GPL (libjbig).
namespace palpate::volume_io {
namespace {

// tags, TIFF 6.0 section 8
enum Tag : std::uint16_t {
  kNewSubfileType = 254,
  kImageWidth = 256,
  kImageLength = 257,
  kBitsPerSample = 258,
  kCompression = 259,
  kPhotometric = 262,
  kFillOrder = 266,
  kImageDescription = 270,
  kStripOffsets = 273,
  kSamplesPerPixel = 277,
  kRowsPerStrip = 278,
  kStripByteCounts = 279,
  kPlanarConfiguration = 284,
  kPredictor = 317,
  kColorMap = 320,
  kTileWidth = 322,
  kTileLength = 323,
  kTileOffsets = 324,
  kTileByteCounts = 325,
  kExtraSamples = 338,
  kSampleFormat = 339,
};

enum class Photometric { kWhiteIsZero = 0, kBlackIsZero = 1, kRgb = 2, kPalette = 3 };

Error damaged() {
  return bad_input("", kDamagedImage, kCopyImage);
}

constexpr const char* kSavePlain = "save it without that compression, as by: tiffcp -c none IN OUT";

// Size of a value of a field type; bytes. 0: unknown type, the field is ignored.
std::uint64_t bytes_of_type(std::uint16_t type) {
  constexpr std::array<std::uint8_t, 19> kBytes{0, 1, 1, 2, 4, 8, 1, 1, 2, 4, 8, 4, 8, 4, 0, 0, 8, 8, 8};
  return type < kBytes.size() ? kBytes[type] : 0;
}

/// Layout of a page: location and encoding of its pixels.
struct Page {
  std::uint64_t columns = 0, rows = 0;
  int bits = 1, samples = 1;
  bool is_float = false, separate = false, transparent = false, tiled = false;
  int compression = 1, predictor = 1;
  Photometric photometric = Photometric::kBlackIsZero;
  std::uint64_t piece_columns = 0, piece_rows = 0;  // size of a tile, or of a strip, which has all columns
  std::vector<std::uint64_t> offsets, counts;       // location of each tile or strip in the file; bytes
  std::vector<std::uint64_t> palette;               // 16 bits each: red, green, blue

  std::uint64_t pieces_across() const { return (columns + piece_columns - 1) / piece_columns; }
  std::uint64_t pieces_down() const { return (rows + piece_rows - 1) / piece_rows; }
  int samples_of_piece() const { return separate ? 1 : samples; }
  std::uint64_t bytes_of_row() const {
    return (piece_columns * static_cast<std::uint64_t>(bits * samples_of_piece()) + 7) / 8;
  }
};

// ---- decompression -------------------------------------------------------------------------------

// Each function fills `out` completely, or returns false if the compressed data are truncated or damaged.

bool unpack_deflate(std::span<const std::uint8_t> packed, std::span<std::uint8_t> out) {
  uLongf length = static_cast<uLongf>(out.size());
  const int result = ::uncompress(out.data(), &length, packed.data(), static_cast<uLong>(packed.size()));
  // surplus data are ignored
  return (result == Z_OK || result == Z_BUF_ERROR) && length == out.size();
}

// PackBits, TIFF 6.0 section 9
bool unpack_bits(std::span<const std::uint8_t> packed, std::span<std::uint8_t> out) {
  std::size_t at = 0, to = 0;
  while (to < out.size()) {
    if (at >= packed.size()) return false;
    const auto control = static_cast<std::int8_t>(packed[at++]);
    if (control == -128) continue;
    const std::size_t requested = control >= 0 ? static_cast<std::size_t>(control) + 1
                                               : static_cast<std::size_t>(1 - static_cast<int>(control)),
                      count = std::min(requested, out.size() - to);
    if (control >= 0) {
      if (packed.size() - at < count) return false;
      std::copy_n(packed.begin() + static_cast<std::ptrdiff_t>(at), count,
                  out.begin() + static_cast<std::ptrdiff_t>(to));
      at += requested;
    } else {
      if (at >= packed.size()) return false;
      std::fill_n(out.begin() + static_cast<std::ptrdiff_t>(to), count, packed[at++]);
    }
    to += count;
  }
  return true;
}

// LZW, TIFF 6.0 section 13: codes of 9 to 12 bits, most significant bit first
bool unpack_lzw(std::span<const std::uint8_t> packed, std::span<std::uint8_t> out) {
  constexpr unsigned kClear = 256, kEnd = 257, kFirst = 258, kCodes = 4096;
  struct Entry {
    std::uint16_t before = 0;
    std::uint8_t last = 0, first = 0;
    std::uint16_t length = 1;
  };
  std::vector<Entry> table(kCodes);
  for (unsigned n = 0; n < 256; ++n)
    table[n] = {0, static_cast<std::uint8_t>(n), static_cast<std::uint8_t>(n), 1};
  unsigned next = kFirst, width = 9, last = kClear, bits_buffered = 0;
  std::uint32_t bit_buffer = 0;
  std::size_t at = 0, to = 0;
  while (to < out.size()) {
    while (bits_buffered < width) {
      if (at >= packed.size()) return false;
      bit_buffer = bit_buffer << 8 | packed[at++];
      bits_buffered += 8;
    }
    const unsigned code = bit_buffer >> (bits_buffered - width) & ((1u << width) - 1);
    bits_buffered -= width;
    if (code == kEnd) return false;
    if (code == kClear) {
      next = kFirst;
      width = 9;
      last = kClear;
      continue;
    }
    if (code > next || (code == next && last == kClear) || (code >= kFirst && code >= kCodes)) return false;
    if (last != kClear && next < kCodes) {
      const std::uint8_t first = code == next ? table[last].first : table[code].first;
      table[next] = {static_cast<std::uint16_t>(last), first, table[last].first,
                     static_cast<std::uint16_t>(table[last].length + 1)};
      ++next;
    }
    if (code >= next) return false;
    const std::size_t length = table[code].length;
    unsigned entry = code;
    for (std::size_t n = length; n-- > 0; entry = table[entry].before)
      if (to + n < out.size()) out[to + n] = table[entry].last;
    to += std::min(length, out.size() - to);
    last = code;
    // TIFF increases the code width one code early
    if (next + 1 >= (1u << width) && width < 12) ++width;
  }
  return true;
}

// ---- a file ---------------------------------------------------------------------------------------

class TiffDecoder : public ImageDecoder {
 public:
  explicit TiffDecoder(ImageBytes bytes) : bytes_(std::move(bytes)) {}

  Result<void> read_directories() {
    std::array<std::uint8_t, 16> head{};
    if (bytes_.size < 8 || !read_at(0, std::span(head).first(8))) return damaged();
    swap_ = (head[0] == 'M') == (std::endian::native == std::endian::little);
    big_ = value<std::uint16_t>(head.data() + 2) == 43;
    if (big_ && (bytes_.size < 16 || !read_at(0, head))) return damaged();
    std::uint64_t directory =
        big_ ? value<std::uint64_t>(head.data() + 8) : value<std::uint32_t>(head.data() + 4);
    std::set<std::uint64_t> visited;
    constexpr std::size_t kMaxPages = 100'000;
    while (directory != 0) {
      if (!visited.insert(directory).second || visited.size() > kMaxPages) return damaged();
      auto after = read_directory(directory);
      if (!after) return after.error();
      directory = *after;
    }
    if (pages_.empty()) return bad_input("", "is a TIFF file without a page", kCopyImage);
    return {};
  }

  Result<void> read(std::size_t n, std::span<std::uint32_t> pixels) override {
    const Page& page = layouts_[n];
    const int planes = page.separate ? page.samples : 1;
    const std::uint64_t pieces = page.pieces_across() * page.pieces_down();
    std::vector<std::uint8_t> piece(static_cast<std::size_t>(page.bytes_of_row() * page.piece_rows));
    std::ranges::fill(pixels, 0u);
    for (int plane = 0; plane < planes; ++plane)
      for (std::uint64_t p = 0; p < pieces; ++p) {
        const std::uint64_t left = p % page.pieces_across() * page.piece_columns,
                            top = p / page.pieces_across() * page.piece_rows,
                            height = std::min(page.piece_rows, page.rows - top);
        // the last strip stores only the remaining rows, the last tile all of its rows
        const std::uint64_t stored_rows = page.tiled ? page.piece_rows : height;
        const auto bytes =
            std::span(piece).first(static_cast<std::size_t>(page.bytes_of_row() * stored_rows));
        const auto index = static_cast<std::size_t>(static_cast<std::uint64_t>(plane) * pieces + p);
        if (!unpack(page, page.offsets[index], page.counts[index], bytes)) {
          // some writers truncate the last tile at the page's last row
          const auto shorter = bytes.first(static_cast<std::size_t>(page.bytes_of_row() * height));
          if (shorter.size() == bytes.size() ||
              !unpack(page, page.offsets[index], page.counts[index], shorter))
            return damaged();
        }
        undo_prediction(page, bytes);
        store_piece(page, plane, left, top, height, bytes, pixels);
      }
    return {};
  }

 private:
  bool read_at(std::uint64_t offset, std::span<std::uint8_t> into) const {
    return offset <= bytes_.size && into.size() <= bytes_.size - offset &&
           bytes_.read(offset, std::as_writable_bytes(into));
  }
  template <class T>
  T value(const std::uint8_t* at) const {
    std::array<std::uint8_t, sizeof(T)> bytes;
    std::memcpy(bytes.data(), at, sizeof(T));
    if (swap_) std::ranges::reverse(bytes);
    return std::bit_cast<T>(bytes);
  }

  using Fields = std::map<std::uint16_t, std::vector<std::uint64_t>>;

  // @return offset of the next directory
  Result<std::uint64_t> read_directory(std::uint64_t at) {
    const std::size_t count_bytes = big_ ? 8 : 2, entry_bytes = big_ ? 20 : 12, link_bytes = big_ ? 8 : 4;
    std::array<std::uint8_t, 8> number{};
    if (!read_at(at, std::span(number).first(count_bytes))) return damaged();
    const std::uint64_t count =
        big_ ? value<std::uint64_t>(number.data()) : value<std::uint16_t>(number.data());
    constexpr std::uint64_t kMaxEntries = 4096;
    if (count == 0 || count > kMaxEntries) return damaged();
    std::vector<std::uint8_t> entries(static_cast<std::size_t>(count) * entry_bytes + link_bytes);
    if (!read_at(at + count_bytes, entries)) return damaged();
    Fields fields;
    for (std::uint64_t n = 0; n < count; ++n) {
      const std::uint8_t* entry = entries.data() + static_cast<std::size_t>(n) * entry_bytes;
      if (!read_field(entry, fields)) return damaged();
    }
    if (auto page = read_page(fields); !page) return page.error();
    const std::uint8_t* link = entries.data() + static_cast<std::size_t>(count) * entry_bytes;
    return big_ ? value<std::uint64_t>(link) : std::uint64_t{value<std::uint32_t>(link)};
  }

  bool read_field(const std::uint8_t* entry, Fields& fields) const {
    const auto tag = value<std::uint16_t>(entry), type = value<std::uint16_t>(entry + 2);
    const std::uint64_t count = big_ ? value<std::uint64_t>(entry + 4) : value<std::uint32_t>(entry + 4);
    const std::uint64_t each = bytes_of_type(type);
    const std::size_t inline_bytes = big_ ? 8 : 4;
    const std::uint8_t* stored = entry + (big_ ? 12 : 8);
    // a 16-bit palette has 196 608 values, a page of 16 x 16 tiles about as many
    constexpr std::uint64_t kMaxValues = std::uint64_t{1} << 20;
    static constexpr std::array kRequested{
        kNewSubfileType,  kImageWidth,          kImageLength,    kBitsPerSample,   kCompression,
        kPhotometric,     kFillOrder,           kStripOffsets,   kSamplesPerPixel, kRowsPerStrip,
        kStripByteCounts, kPlanarConfiguration, kPredictor,      kColorMap,        kTileWidth,
        kTileLength,      kTileOffsets,         kTileByteCounts, kExtraSamples,    kSampleFormat};
    if (std::ranges::find(kRequested, static_cast<Tag>(tag)) == kRequested.end()) return true;
    if (each == 0 || count == 0) return true;
    if (count > kMaxValues) return false;
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(count * each));
    if (bytes.size() <= inline_bytes) {
      std::copy_n(stored, bytes.size(), bytes.begin());
    } else {
      const std::uint64_t offset =
          big_ ? value<std::uint64_t>(stored) : std::uint64_t{value<std::uint32_t>(stored)};
      if (!read_at(offset, bytes)) return false;
    }
    auto& values = fields[tag];
    for (std::size_t n = 0; n < bytes.size(); n += static_cast<std::size_t>(each)) {
      const std::uint8_t* at = bytes.data() + n;
      values.push_back(each == 1   ? *at
                       : each == 2 ? value<std::uint16_t>(at)
                       : each == 4 ? value<std::uint32_t>(at)
                                   : value<std::uint64_t>(at));
    }
    return true;
  }

  Result<void> read_page(const Fields& fields) {
    const auto all = [&](Tag tag) {
      const auto found = fields.find(tag);
      return found == fields.end() ? std::vector<std::uint64_t>() : found->second;
    };
    const auto one = [&](Tag tag, std::uint64_t otherwise) {
      const auto values = all(tag);
      return values.empty() ? otherwise : values.front();
    };
    // skip reduced-resolution copies and masks
    if ((one(kNewSubfileType, 0) & 5) != 0) return {};
    Page page;
    page.columns = one(kImageWidth, 0);
    page.rows = one(kImageLength, 0);
    if (auto possible = check_image_size(page.columns, page.rows); !possible) return possible.error();
    const std::uint64_t samples = one(kSamplesPerPixel, 1), compression = one(kCompression, 1),
                        photometric = one(kPhotometric, 1), format = one(kSampleFormat, 1);
    const auto bits = all(kBitsPerSample);
    const auto unread = [](const std::string& what, const char* remedy) {
      return bad_input("", what, remedy);
    };
    if (compression != 1 && compression != 5 && compression != 8 && compression != 32946 &&
        compression != 32773)
      return unread(
          "is a TIFF file with an unsupported compression (Compression " + std::to_string(compression) + ")",
          kSavePlain);
    if (photometric > 3)
      return unread("is a TIFF file with unsupported colours (PhotometricInterpretation " +
                        std::to_string(photometric) + ")",
                    "save it as grey, RGB or with a palette");
    page.photometric = static_cast<Photometric>(photometric);
    const bool colour = page.photometric == Photometric::kRgb;
    const std::uint64_t depth = bits.empty() ? 1 : bits.front();
    const bool alike = std::ranges::all_of(bits, [&](std::uint64_t each) { return each == depth; });
    const bool whole_depth = depth == 1 || depth == 2 || depth == 4 || depth == 8 || depth == 16;
    page.is_float = format == 3;
    if (samples < (colour ? 3u : 1u) || samples > 8 || !alike ||
        (page.is_float ? depth != 32 : !whole_depth) ||
        (page.is_float && (colour || page.photometric == Photometric::kPalette)) || format == 2 ||
        format > 4 || (colour && depth < 8))
      return unread("is a TIFF file of " + std::to_string(samples) + " samples of " + std::to_string(depth) +
                        " bits, sample format " + std::to_string(format) + ", which is not supported",
                    "save it with 8 or 16 unsigned bits, for example in Fiji (Image > Type > 16-bit)");
    if (one(kFillOrder, 1) != 1 && depth < 8)
      return unread("is a TIFF file with reversed bit order (FillOrder 2)", kSavePlain);
    page.bits = static_cast<int>(depth);
    page.samples = static_cast<int>(samples);
    page.compression = static_cast<int>(compression);
    page.separate = samples > 1 && one(kPlanarConfiguration, 1) == 2;
    page.transparent = colour && samples == 4 && one(kExtraSamples, 0) != 0;
    page.predictor = static_cast<int>(std::min<std::uint64_t>(one(kPredictor, 1), 99));
    const bool predicted = page.predictor == 2 && (page.bits == 8 || page.bits == 16);
    if (compression != 1 && compression != 32773 && page.predictor != 1 && !predicted)
      return unread("is a TIFF file with an unsupported Predictor (" + std::to_string(page.predictor) + ")",
                    kSavePlain);
    if (compression == 1 || compression == 32773) page.predictor = 1;
    page.palette = all(kColorMap);
    if (page.photometric == Photometric::kPalette &&
        (page.bits > 16 || page.palette.size() != (std::size_t{3} << page.bits)))
      return damaged();

    page.tiled = fields.contains(kTileOffsets);
    page.piece_columns = page.tiled ? one(kTileWidth, 0) : page.columns;
    page.piece_rows = page.tiled ? one(kTileLength, 0) : std::min(one(kRowsPerStrip, page.rows), page.rows);
    if (page.piece_columns == 0 || page.piece_rows == 0 ||
        !check_image_size(page.piece_columns, page.piece_rows))
      return damaged();
    page.offsets = all(page.tiled ? kTileOffsets : kStripOffsets);
    page.counts = all(page.tiled ? kTileByteCounts : kStripByteCounts);
    const std::uint64_t pieces = page.pieces_across() * page.pieces_down() * (page.separate ? samples : 1);
    // old writers omit the size of a single strip
    if (page.counts.empty() && page.offsets.size() == 1 && compression == 1)
      page.counts = {page.bytes_of_row() * page.rows};
    if (page.offsets.size() < pieces || page.counts.size() < pieces) return damaged();

    ImageShape shape;
    shape.columns = static_cast<int>(page.columns);
    shape.rows = static_cast<int>(page.rows);
    shape.colour = colour || page.photometric == Photometric::kPalette;
    shape.component = page.is_float                      ? Component::kFloat32
                      : page.bits == 16 && !shape.colour ? Component::kUint16
                                                         : Component::kUint8;
    pages_.push_back(shape);
    layouts_.push_back(std::move(page));
    return {};
  }

  bool unpack(const Page& page, std::uint64_t offset, std::uint64_t count, std::span<std::uint8_t> out) {
    if (page.compression == 1) return out.size() <= count && read_at(offset, out);
    // no compression expands a piece much
    const std::uint64_t largest = 2 * std::uint64_t{out.size()} + (1 << 16);
    packed_.resize(static_cast<std::size_t>(std::min(count, largest)));
    if (!read_at(offset, packed_)) return false;
    switch (page.compression) {
      case 5:
        return unpack_lzw(packed_, out);
      case 32773:
        return unpack_bits(packed_, out);
      default:
        return unpack_deflate(packed_, out);
    }
  }

  // reverses horizontal differencing: each value is stored as the difference from its predecessor in the row
  void undo_prediction(const Page& page, std::span<std::uint8_t> bytes) const {
    if (page.predictor != 2) return;
    const auto samples = static_cast<std::size_t>(page.samples_of_piece()),
               row_bytes = static_cast<std::size_t>(page.bytes_of_row());
    for (std::size_t row = 0; row + row_bytes <= bytes.size(); row += row_bytes) {
      std::uint8_t* at = bytes.data() + row;
      if (page.bits == 8) {
        for (std::size_t n = samples; n < row_bytes; ++n)
          at[n] = static_cast<std::uint8_t>(at[n] + at[n - samples]);
        continue;
      }
      for (std::size_t n = 2 * samples; n + 1 < row_bytes; n += 2) {
        const auto sum = static_cast<std::uint16_t>(value<std::uint16_t>(at + n) +
                                                    value<std::uint16_t>(at + n - 2 * samples));
        auto stored = std::bit_cast<std::array<std::uint8_t, 2>>(sum);
        if (swap_) std::swap(stored[0], stored[1]);
        std::memcpy(at + n, stored.data(), 2);
      }
    }
  }

  std::uint32_t sample_at(const Page& page, const std::uint8_t* row, std::uint64_t index) const {
    switch (page.bits) {
      case 8:
        return row[index];
      case 16:
        return value<std::uint16_t>(row + 2 * index);
      case 32:
        return value<std::uint32_t>(row + 4 * index);
      default: {
        const auto bit = index * static_cast<std::uint64_t>(page.bits);
        const int shift = 8 - page.bits - static_cast<int>(bit % 8);
        return static_cast<std::uint32_t>(row[bit / 8] >> shift & ((1 << page.bits) - 1));
      }
    }
  }

  void store_piece(const Page& page, int plane, std::uint64_t left, std::uint64_t top, std::uint64_t height,
                   std::span<const std::uint8_t> bytes, std::span<std::uint32_t> pixels) const {
    const auto samples = static_cast<std::uint64_t>(page.samples_of_piece());
    const std::uint64_t width = std::min(page.piece_columns, page.columns - left);
    const int to_8_bits = page.bits == 16 ? 8 : 0;
    for (std::uint64_t j = 0; j < height; ++j) {
      const std::uint8_t* row = bytes.data() + j * page.bytes_of_row();
      std::uint32_t* to = pixels.data() + (top + j) * page.columns + left;
      for (std::uint64_t i = 0; i < width; ++i) {
        const auto sample = [&](std::uint64_t s) { return sample_at(page, row, i * samples + s); };
        switch (page.photometric) {
          case Photometric::kRgb:
            if (page.separate) {
              if (plane < 3) to[i] |= sample(0) >> to_8_bits << (8 * (2 - plane));
              if (plane == 3 && page.transparent && sample(0) == 0) to[i] = 0;
            } else if (!page.transparent || sample(3) != 0) {
              to[i] = sample(0) >> to_8_bits << 16 | sample(1) >> to_8_bits << 8 | sample(2) >> to_8_bits;
            }
            break;
          case Photometric::kPalette: {
            if (plane > 0) break;
            const std::size_t entries = page.palette.size() / 3, entry = sample(0);
            std::uint32_t colour = 0;
            for (std::size_t c = 0; c < 3; ++c)
              colour =
                  colour << 8 | static_cast<std::uint32_t>(page.palette[c * entries + entry] >> 8 & 0xFF);
            to[i] = colour;
            break;
          }
          default:
            // further samples are transparency or other channels, and are ignored
            if (plane > 0) break;
            to[i] = sample(0);
            if (page.photometric == Photometric::kWhiteIsZero && !page.is_float)
              to[i] = ((1u << page.bits) - 1) - to[i];
        }
      }
    }
  }

  ImageBytes bytes_;
  bool swap_ = false, big_ = false;
  std::vector<Page> layouts_;  // layouts of pages_
  std::vector<std::uint8_t> packed_;
};

}  // namespace

Result<std::unique_ptr<ImageDecoder>> open_tiff(ImageBytes bytes) {
  auto decoder = std::make_unique<TiffDecoder>(std::move(bytes));
  if (auto understood = decoder->read_directories(); !understood) return understood.error();
  return std::unique_ptr<ImageDecoder>(std::move(decoder));
}

}  // namespace palpate::volume_io
