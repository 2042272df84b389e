#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "palpate/base/file.h"

/// Streams of the bytes that a file holds, decoded (voxel_stream.h).
namespace palpate::volume_io {

/// Size of the pieces in which streams read their file; bytes.
constexpr std::size_t kStreamPiece = 1 << 16;

/// Sequential reads of a file from an offset on.
class FileBytes {
 public:
  Result<void> open(const std::filesystem::path& file, std::uint64_t offset) {
    auto opened = InputFile::open(file);
    if (!opened) return opened.error();
    file_ = *std::move(opened);
    at_ = offset;
    return {};
  }
  /// Returns fewer bytes than requested only at the end or after a read error.
  std::size_t read(std::span<std::byte> out) {
    const auto received = file_->read_at(at_, out);
    if (!received) return 0;
    at_ += *received;
    return *received;
  }

 private:
  std::optional<InputFile> file_;
  std::uint64_t at_ = 0;
};

/// Decoded bytes in order.
class ByteStream {
 public:
  virtual ~ByteStream() = default;
  /// Fills `out`; fewer bytes mean the end of the data, and fault() is set if they ended abnormally.
  virtual std::size_t read(std::span<std::byte> out) = 0;
  const std::string& fault() const { return fault_; }
  FileBytes& file() { return file_; }

 protected:
  FileBytes file_;
  std::string fault_;
};

/// Stream of a gzip or zlib file: by zlib (compressed_streams.cc), in a browser by inflate.h.
std::unique_ptr<ByteStream> deflate_stream();
/// Stream of a bzip2 file; null in a browser, where there is no decoder.
std::unique_ptr<ByteStream> bzip2_stream();

}  // namespace palpate::volume_io
