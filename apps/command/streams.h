#pragma once

#include <ios>
#include <memory>

namespace palpate::app {

/// Descriptors of a run's standard streams; owned by the caller.
struct Streams {
  int in = 0;
  int out = 1;
  int err = 2;
};

/// Redirects stdout, stderr, std::cout, std::cerr and std::clog of the process to the given descriptors
/// during its lifetime. All output, including that of libraries, is sanitised by palpate/base/printable.h.
/// The original streams with their format flags are restored afterwards. One instance per process at a time.
class PrintableStreams {
 public:
  /// Throws std::bad_alloc.
  explicit PrintableStreams(const Streams& streams);
  ~PrintableStreams();
  PrintableStreams(const PrintableStreams&) = delete;
  PrintableStreams& operator=(const PrintableStreams&) = delete;

  /// Flushes buffered output. Returns false if any output to stdout was lost.
  bool flush();

 private:
  struct Redirected;
  std::unique_ptr<Redirected> redirected_;
};

}  // namespace palpate::app
