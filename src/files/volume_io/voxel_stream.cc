#include "volume_io/voxel_stream.h"

#include <algorithm>
#include <bit>
#include <charconv>
#include <cstring>
#include <memory>

#include "palpate/base/reading.h"
#include "volume_io/streams/byte_stream.h"

namespace palpate::volume_io {
namespace {

class RawStream : public ByteStream {
 public:
  std::size_t read(std::span<std::byte> out) override { return file_.read(out); }
};

// text, read character by character
class TextStream : public ByteStream {
 protected:
  // next character, or -1
  int next() {
    if (at_ == held_) {
      held_ = file_.read(std::as_writable_bytes(std::span(in_)));
      at_ = 0;
      if (held_ == 0) return -1;
    }
    return static_cast<unsigned char>(in_[at_++]);
  }
  static bool is_space(int c) { return c == ' ' || (c >= '\t' && c <= '\r'); }

 private:
  char in_[kStreamPiece];
  std::size_t at_ = 0, held_ = 0;
};

class NumberStream : public TextStream {
 public:
  explicit NumberStream(Component component) : component_(component), size_(bytes_of(component)) {}

  // Whole values only: the size of `out` is a multiple of theirs, except for the single byte that tests for
  // surplus data.
  std::size_t read(std::span<std::byte> out) override {
    std::size_t used = 0;
    while (used < out.size() && fault_.empty()) {
      const std::string token = next_token();
      if (token.empty()) break;
      std::byte value[8];
      if (!parse(token, value)) {
        fault_ = token.substr(0, 20) + " is not a " + name_of(component_) + " number";
        break;
      }
      const std::size_t available = std::min(size_, out.size() - used);
      std::memcpy(out.data() + used, value, available);
      used += available;
    }
    return used;
  }

 private:
  std::string next_token() {
    int c = next();
    while (is_space(c) || c == ',') c = next();
    std::string token;
    constexpr std::size_t kMaxToken = 400;
    for (; c >= 0 && !is_space(c) && c != ',' && token.size() < kMaxToken; c = next())
      token.push_back(static_cast<char>(c));
    return token;
  }
  bool parse(const std::string& token, std::byte* value) const {
    const char* first = token.data() + (token[0] == '+' ? 1 : 0);
    const char* last = token.data() + token.size();
    return with_type(component_, [&](auto number) {
      const auto result = std::from_chars(first, last, number);
      std::memcpy(value, &number, sizeof number);
      return result.ec == std::errc() && result.ptr == last;
    });
  }

  Component component_;
  std::size_t size_;
};

class HexStream : public TextStream {
 public:
  std::size_t read(std::span<std::byte> out) override {
    std::size_t used = 0;
    while (used < out.size() && fault_.empty()) {
      const int high = next_digit();
      if (high < 0) break;
      const int low = next_digit();
      if (low < 0) break;
      out[used++] = static_cast<std::byte>(high * 16 + low);
    }
    return used;
  }

 private:
  int next_digit() {
    int c = next();
    while (is_space(c)) c = next();
    if (c < 0) return -1;
    if (c >= '0' && c <= '9') return c - '0';
    c |= 0x20;
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    fault_ = "the hexadecimal data have other characters";
    return -1;
  }
};

// null for bzip2 in a browser
std::unique_ptr<ByteStream> stream_for(const VoxelSource& source) {
  switch (source.encoding) {
    case Encoding::kDeflate:
      return deflate_stream();
    case Encoding::kBzip2:
      return bzip2_stream();
    case Encoding::kText:
      return std::make_unique<NumberStream>(source.component);
    case Encoding::kHex:
      return std::make_unique<HexStream>();
    case Encoding::kRaw:
    case Encoding::kSlices:
      break;
  }
  return std::make_unique<RawStream>();
}

Error ended_early(const VolumeFile& file, std::uint64_t values, const std::string& fault) {
  const auto& dims = file.header.geometry.dims;
  const auto voxels = values / static_cast<std::uint64_t>(file.header.layers);
  const auto slice = static_cast<std::uint64_t>(dims[0]) * static_cast<std::uint64_t>(dims[1]);
  std::string what = "the voxel data end after ";
  if (!file.layers_first)
    what += std::to_string(values) + " of " + std::to_string(file.value_count()) + " values";
  else if (dims[2] > 1)
    what += std::to_string(voxels / slice) + " of " + std::to_string(dims[2]) + " slices";
  else
    what += std::to_string(voxels) + " of " + std::to_string(slice) + " voxels";
  if (!fault.empty()) what += ", " + fault;
  return bad_input(file.voxels.file.string(), what,
                   "the file is cut short or damaged: copy or download it again");
}

Error surplus(const VolumeFile& file) {
  return bad_input(file.voxels.file.string(), "holds more voxel data than stated in its header",
                   "sizes, type or encoding in the header may be wrong; an NRRD header whose data file has "
                   "its own header needs 'byte skip: -1'");
}

// stream positioned before the first voxel
struct Positioned {
  std::unique_ptr<ByteStream> stream;
  std::string fault;  // non-empty: the first voxel cannot be reached
};

std::uint64_t pass_over(ByteStream& stream, std::uint64_t bytes, VoxelSink& sink) {
  constexpr std::uint64_t kWord = std::uint64_t{1} << 24;
  std::vector<std::byte> dump(kStreamPiece);
  std::uint64_t passed = 0;
  while (passed < bytes) {
    if (passed % kWord == 0) sink.still_reading();
    const auto piece = static_cast<std::size_t>(std::min<std::uint64_t>(dump.size(), bytes - passed));
    const std::size_t received = stream.read(std::span(dump).first(piece));
    passed += received;
    if (received < piece) break;
  }
  return passed;
}

Result<std::unique_ptr<ByteStream>> open_stream(const VoxelSource& source) {
  auto stream = stream_for(source);
  if (stream == nullptr)
    return bad_input(source.file.string(), "its voxels are compressed by bzip2, which a page does not read",
                     "save it with gzip");
  if (auto opened = stream->file().open(source.file, source.offset); !opened) return opened.error();
  return stream;
}

// opens a stream and advances it to the first voxel
Result<Positioned> at_first_voxel(const VolumeFile& file, VoxelSink& sink) {
  const VoxelSource& source = file.voxels;
  auto stream = open_stream(source);
  if (!stream) return stream.error();
  std::uint64_t skip = source.skip;
  if (source.trailing_bytes) {
    // an offset from the end requires decoding all data once
    const std::uint64_t total = pass_over(**stream, ~std::uint64_t{0}, sink);
    const std::uint64_t needed = file.value_count() * bytes_of(source.component) + *source.trailing_bytes;
    if (total < needed || !(*stream)->fault().empty())
      return Positioned{nullptr,
                        (*stream)->fault().empty() ? "they are shorter than stated" : (*stream)->fault()};
    skip = total - needed;
    stream = open_stream(source);
    if (!stream) return stream.error();
  }
  if (pass_over(**stream, skip, sink) < skip)
    return Positioned{nullptr,
                      (*stream)->fault().empty() ? "they are shorter than stated" : (*stream)->fault()};
  return Positioned{std::move(*stream), ""};
}

void swap_bytes(std::span<std::byte> values, std::size_t size) {
  for (std::size_t n = 0; n + size <= values.size(); n += size)
    std::reverse(values.begin() + static_cast<std::ptrdiff_t>(n),
                 values.begin() + static_cast<std::ptrdiff_t>(n + size));
}

// maximum number of values into which the stored bytes can be decoded
std::uint64_t max_values(const VoxelSource& source, std::uint64_t stored) {
  // Deflate: 258 bytes from 2 bits. bzip2: 900 000 bytes from about 32, each 5 of which encode a run of up to
  // 259.
  constexpr std::uint64_t kMaxDeflate = 1032, kMaxBzip2 = 1 << 21;
  const std::uint64_t size = bytes_of(source.component), before = source.trailing_bytes.value_or(source.skip);
  const auto after_skip = [&](std::uint64_t bytes) { return (bytes - std::min(bytes, before)) / size; };
  switch (source.encoding) {
    case Encoding::kDeflate:
      return after_skip(stored * kMaxDeflate);
    case Encoding::kBzip2:
      return after_skip(stored * kMaxBzip2);
    case Encoding::kText:
      return (stored + 1) / 2;
    case Encoding::kHex:
      return stored / 2 / size;
    case Encoding::kRaw:
    case Encoding::kSlices:
      break;
  }
  return after_skip(stored);
}

}  // namespace

Result<std::string> read_front(const std::filesystem::path& file, Encoding encoding, std::size_t bytes) {
  VoxelSource source;
  source.file = file;
  source.encoding = encoding;
  auto stream = open_stream(source);
  if (!stream) return stream.error();
  std::error_code failed;
  const std::uint64_t stored = std::filesystem::file_size(file, failed);
  if (!failed && encoding == Encoding::kRaw)
    bytes = static_cast<std::size_t>(std::min<std::uint64_t>(bytes, stored));
  std::string front(bytes, '\0');
  front.resize((*stream)->read(std::as_writable_bytes(std::span(front))));
  return front;
}

Result<void> check_plausible(const VolumeFile& file, std::size_t bytes_per_value, std::uint64_t besides) {
  // the reader process has already checked the contents of each image
  if (file.voxels.encoding == Encoding::kSlices)
    return check_memory(file.value_count() * bytes_per_value + besides, file.voxels.file.string());
  std::error_code failed;
  const std::uint64_t bytes = std::filesystem::file_size(file.voxels.file, failed);
  if (failed) return bad_input(file.voxels.file.string(), "cannot be read: " + failed.message());
  const std::uint64_t stored = bytes - std::min<std::uint64_t>(bytes, file.voxels.offset);
  const std::uint64_t promised = file.value_count(), most = max_values(file.voxels, stored);
  if (promised > most) {
    if (file.voxels.encoding == Encoding::kRaw) return ended_early(file, most, "");
    return bad_input(file.voxels.file.string(),
                     "promises " + std::to_string(promised) + " voxels, but " + std::to_string(stored) +
                         " bytes can hold at most " + std::to_string(most),
                     "the file is cut short or its header is damaged: copy or download it again");
  }
  return check_memory(promised * bytes_per_value + besides, file.voxels.file.string());
}

Result<void> send_voxels(const VolumeFile& file, VoxelSink& sink) {
  const VoxelSource& source = file.voxels;
  auto at = at_first_voxel(file, sink);
  if (!at) return at.error();
  if (!at->fault.empty()) return ended_early(file, 0, at->fault);
  ByteStream& stream = *at->stream;

  // whole pieces of values, in the machine's byte order
  const std::size_t size = bytes_of(source.component);
  const bool swap = source.encoding != Encoding::kText && size > 1 &&
                    source.big_endian != (std::endian::native == std::endian::big);
  const std::uint64_t count = file.value_count();
  for (std::uint64_t first = 0; first < count;) {
    const auto requested = static_cast<std::size_t>(std::min<std::uint64_t>(count - first, kPieceValues));
    const auto values = sink.buffer().first(requested * size);
    const std::size_t received = stream.read(values);
    if (received < values.size()) return ended_early(file, first + received / size, stream.fault());
    if (swap) swap_bytes(values, size);
    sink.commit(values.size());
    first += requested;
  }

  // trailing data: the rest of the stream contains its checksum
  if (source.encoding == Encoding::kRaw && source.may_have_more) return {};
  const std::uint64_t after = source.trailing_bytes.value_or(0);
  const std::uint64_t more = pass_over(stream, source.may_have_more ? ~std::uint64_t{0} : after + 1, sink);
  if (!stream.fault().empty() && source.encoding != Encoding::kText)
    return bad_input(source.file.string(), "all voxels are there, but " + stream.fault(),
                     "copy or download the file again");
  if (!source.may_have_more && (more > after || !stream.fault().empty())) return surplus(file);
  return {};
}

}  // namespace palpate::volume_io
