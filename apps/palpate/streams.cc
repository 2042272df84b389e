#include "streams.h"

#include <unistd.h>
#include <ext/stdio_sync_filebuf.h>

#include <cerrno>
#include <exception>
#include <iostream>
#include <string_view>

#include "palpate/base/printable.h"

namespace palpate::app {
namespace {

// where a stream of the C library leads
struct Border {
  int descriptor;
  PrintableStream shown;
};

// as fopencookie(3) wants it: the bytes taken, 0 for an error
ssize_t write_printable(void* cookie, const char* bytes, std::size_t size) {
  auto& border = *static_cast<Border*>(cookie);
  try {
    const std::string shown = border.shown.next({bytes, size});
    for (std::string_view rest = shown; !rest.empty();) {
      const ssize_t wrote = ::write(border.descriptor, rest.data(), rest.size());
      if (wrote < 0 && errno == EINTR) continue;
      if (wrote <= 0) return 0;
      rest.remove_prefix(static_cast<std::size_t>(wrote));
    }
  } catch (const std::exception&) {
    // no memory; exceptions must not pass through the C library
    return 0;
  }
  return static_cast<ssize_t>(size);
}

/// @param border  lives until the process has ended: what is buffered is written after main
std::FILE* printable_stream(Border& border, int buffering) {
  std::FILE* const stream = ::fopencookie(&border, "w", {nullptr, write_printable, nullptr, nullptr});
  if (stream != nullptr) std::setvbuf(stream, nullptr, buffering, BUFSIZ);
  return stream;
}

std::FILE* plain_stderr = stderr;

}  // namespace

void show_only_printable() {
  static auto* const out_border = new Border{STDOUT_FILENO, {}};
  static auto* const err_border = new Border{STDERR_FILENO, {}};
  std::FILE* const out = printable_stream(*out_border, ::isatty(STDOUT_FILENO) ? _IOLBF : _IOFBF);
  std::FILE* const err = printable_stream(*err_border, _IONBF);
  if (out == nullptr || err == nullptr) std::terminate();
  std::fflush(nullptr);
  stdout = out;
  stderr = err;
  using Buffer = __gnu_cxx::stdio_sync_filebuf<char>;
  static auto* const out_buffer = new Buffer(out);
  static auto* const err_buffer = new Buffer(err);
  std::cout.rdbuf(out_buffer);
  std::cerr.rdbuf(err_buffer);
  std::clog.rdbuf(err_buffer);
}

std::FILE* terminal() {
  return plain_stderr;
}

}  // namespace palpate::app
