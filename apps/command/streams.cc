#include "streams.h"

#include <unistd.h>
#include <ext/stdio_sync_filebuf.h>

#include <cerrno>
#include <cstdio>
#include <exception>
#include <iostream>
#include <new>
#include <streambuf>
#include <string>
#include <string_view>
#include <utility>

#include "palpate/base/printable.h"

namespace palpate::app {
namespace detail {

// target descriptor of a C library stream
struct PrintableSink {
  int descriptor;
  PrintableStream shown;
};

// write function of fopencookie(3): returns the number of bytes consumed, 0 for an error
ssize_t write_printable(void* cookie, const char* bytes, std::size_t size) {
  auto& border = *static_cast<PrintableSink*>(cookie);
  try {
    const std::string shown = border.shown.next({bytes, size});
    for (std::string_view remaining = shown; !remaining.empty();) {
      const ssize_t wrote = ::write(border.descriptor, remaining.data(), remaining.size());
      if (wrote < 0 && errno == EINTR) continue;
      if (wrote <= 0) return 0;
      remaining.remove_prefix(static_cast<std::size_t>(wrote));
    }
  } catch (const std::exception&) {
    // out of memory; exceptions must not propagate through the C library
    return 0;
  }
  return static_cast<ssize_t>(size);
}

// stdout or stderr, replaced by a stream to another descriptor
class ReplacedFile {
 public:
  ReplacedFile(std::FILE*& file, int descriptor, int buffering)
      : border_{descriptor, {}},
        stream_(::fopencookie(&border_, "w", {nullptr, write_printable, nullptr, nullptr})),
        file_(file),
        before_(file) {
    if (stream_ == nullptr) throw std::bad_alloc();
    std::setvbuf(stream_, nullptr, buffering, BUFSIZ);
    std::fflush(before_);
    file_ = stream_;
  }
  ~ReplacedFile() {
    file_ = before_;
    std::fclose(stream_);
  }
  ReplacedFile(const ReplacedFile&) = delete;
  ReplacedFile& operator=(const ReplacedFile&) = delete;

  std::FILE* stream() const { return stream_; }

 private:
  PrintableSink border_;
  std::FILE* stream_;
  std::FILE*& file_;
  std::FILE* before_;
};

// std::cout or the like, redirected in the same way
class ReplacedStream {
 public:
  ReplacedStream(std::ostream& stream, std::streambuf* buffer) : stream_(stream), format_(nullptr) {
    format_.copyfmt(stream_);
    stream_.flush();
    before_ = stream_.rdbuf(buffer);
  }
  ~ReplacedStream() {
    stream_.flush();
    // also clears the error state
    stream_.rdbuf(before_);
    stream_.copyfmt(format_);
  }
  ReplacedStream(const ReplacedStream&) = delete;
  ReplacedStream& operator=(const ReplacedStream&) = delete;

 private:
  std::ostream& stream_;
  std::ios format_;
  std::streambuf* before_;
};

}  // namespace detail

struct PrintableStreams::Redirected {
  explicit Redirected(const Streams& streams)
      : out(stdout, streams.out, ::isatty(streams.out) ? _IOLBF : _IOFBF),
        err(stderr, streams.err, _IONBF),
        out_buffer(out.stream()),
        err_buffer(err.stream()),
        cout(std::cout, &out_buffer),
        cerr(std::cerr, &err_buffer),
        clog(std::clog, &err_buffer) {}

  detail::ReplacedFile out, err;
  __gnu_cxx::stdio_sync_filebuf<char> out_buffer, err_buffer;
  detail::ReplacedStream cout, cerr, clog;
};

PrintableStreams::PrintableStreams(const Streams& streams)
    : redirected_(std::make_unique<Redirected>(streams)) {}

PrintableStreams::~PrintableStreams() = default;

bool PrintableStreams::flush() {
  std::cout.flush();
  return std::fflush(stdout) == 0 && std::ferror(stdout) == 0 && std::cout.good();
}

}  // namespace palpate::app
