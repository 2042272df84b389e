#pragma once

#include <ios>
#include <memory>

namespace palpate::app {

/// The descriptors a run reads from and writes to. Whoever opened them closes them.
struct Streams {
  int in = 0;
  int out = 1;
  int err = 2;
};

/// Redirects stdout, stderr, std::cout, std::cerr and std::clog of the process to the given descriptors while
/// it lives. Whatever any library writes to them gets out as palpate/base/printable.h says. Afterwards the
/// process has its own streams again, with their format flags. One at a time in a process.
class PrintableStreams {
 public:
  /// Throws std::bad_alloc.
  explicit PrintableStreams(const Streams& streams);
  ~PrintableStreams();
  PrintableStreams(const PrintableStreams&) = delete;
  PrintableStreams& operator=(const PrintableStreams&) = delete;

  /// Writes what is buffered. False when anything written to stdout so far was lost.
  bool flush();

 private:
  struct Redirected;
  std::unique_ptr<Redirected> redirected_;
};

}  // namespace palpate::app
