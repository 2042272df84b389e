#include <bzlib.h>
#include <zlib.h>

#include <algorithm>
#include <cstring>

#include "volume_io/streams/byte_stream.h"

namespace palpate::volume_io {
namespace {

class DeflateStream : public ByteStream {
 public:
  DeflateStream() {
    constexpr int kGzipOrZlib = 15 + 32;
    good_ = inflateInit2(&z_, kGzipOrZlib) == Z_OK;
    if (!good_) fault_ = "cannot be decompressed";
  }
  ~DeflateStream() override { inflateEnd(&z_); }

  std::size_t read(std::span<std::byte> out) override {
    std::size_t used = 0;
    while (good_ && used < out.size()) {
      if (z_.avail_in == 0 && !refill()) break;
      const auto available = static_cast<uInt>(std::min<std::size_t>(out.size() - used, 1u << 30));
      z_.next_out = reinterpret_cast<Bytef*>(out.data() + used);
      z_.avail_out = available;
      const int status = inflate(&z_, Z_NO_FLUSH);
      used += available - z_.avail_out;
      if (status == Z_STREAM_END)
        good_ = next_member();
      else if (status != Z_OK && status != Z_BUF_ERROR)
        stop(std::string("the compressed data are damaged") +
             (z_.msg ? std::string(" (") + z_.msg + ")" : ""));
    }
    return used;
  }

 private:
  void stop(std::string fault) {
    good_ = false;
    fault_ = std::move(fault);
  }
  bool refill() {
    const std::size_t received = file_.read(std::as_writable_bytes(std::span(in_)));
    z_.next_in = in_;
    z_.avail_in = static_cast<uInt>(received);
    if (received == 0) stop("the compressed data end early");
    return received != 0;
  }
  // gzip members may be concatenated; other bytes after the end are ignored
  bool next_member() {
    if (z_.avail_in < 2) {
      std::memmove(in_, z_.next_in, z_.avail_in);
      const std::size_t retained = z_.avail_in;
      z_.next_in = in_;
      z_.avail_in += static_cast<uInt>(file_.read(std::as_writable_bytes(std::span(in_).subspan(retained))));
    }
    return z_.avail_in >= 2 && z_.next_in[0] == 0x1f && z_.next_in[1] == 0x8b && inflateReset(&z_) == Z_OK;
  }

  z_stream z_{};
  bool good_ = false;
  Bytef in_[kStreamPiece];
};

class Bzip2Stream : public ByteStream {
 public:
  Bzip2Stream() { good_ = BZ2_bzDecompressInit(&z_, 0, 0) == BZ_OK; }
  ~Bzip2Stream() override { BZ2_bzDecompressEnd(&z_); }

  std::size_t read(std::span<std::byte> out) override {
    std::size_t used = 0;
    while (good_ && used < out.size()) {
      if (z_.avail_in == 0) {
        z_.next_in = in_;
        z_.avail_in = static_cast<unsigned>(file_.read(std::as_writable_bytes(std::span(in_))));
        if (z_.avail_in == 0) {
          good_ = false;
          fault_ = "the compressed data end early";
          break;
        }
      }
      const auto available = static_cast<unsigned>(std::min<std::size_t>(out.size() - used, 1u << 30));
      z_.next_out = reinterpret_cast<char*>(out.data() + used);
      z_.avail_out = available;
      const int status = BZ2_bzDecompress(&z_);
      used += available - z_.avail_out;
      if (status == BZ_OK) continue;
      good_ = false;
      if (status != BZ_STREAM_END) fault_ = "the compressed data are damaged";
    }
    return used;
  }

 private:
  bz_stream z_{};
  bool good_ = false;
  char in_[kStreamPiece];
};

}  // namespace

std::unique_ptr<ByteStream> deflate_stream() {
  return std::make_unique<DeflateStream>();
}

std::unique_ptr<ByteStream> bzip2_stream() {
  return std::make_unique<Bzip2Stream>();
}

}  // namespace palpate::volume_io
