// recording_example write FILE      a complete run of two devices, 2500 ticks at 1 kHz
// recording_example killed FILE     the same, killed before its end
// recording_example same A B        exit code 0 if both contain the same header and ticks
//
// For open_in_h5py_test.py, and to create a file for the examples of docs/reference/recording.md.
#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <string_view>

#include "palpate/recording/recorder.h"
#include "recording/test_support.h"

namespace {

using namespace palpate;

int report(const Error& error) {
  std::fprintf(stderr, "%s\n", error.message().c_str());
  return 1;
}

int write(const std::filesystem::path& file, bool killed) {
  const auto ticks = test::example_ticks(2500, 2, 1000);
  auto writer = RecordingWriter::create(file, test::example_header());
  if (!writer) return report(writer.error());
  if (auto appended = (*writer)->append(ticks, test::example_events()); !appended)
    return report(appended.error());
  if (killed) ::kill(::getpid(), SIGKILL);
  const auto finished = (*writer)->finish(test::example_summary(ticks.size()));
  return finished ? 0 : report(finished.error());
}

int same(const std::filesystem::path& a, const std::filesystem::path& b) {
  const auto first = read_recording(a), second = read_recording(b);
  if (!first) return report(first.error());
  if (!second) return report(second.error());
  std::string difference = test::first_difference((*first).header, (*second).header);
  if ((*first).ticks.size() != (*second).ticks.size()) difference = "number of ticks";
  for (std::size_t i = 0; i < (*first).ticks.size() && difference.empty(); ++i)
    difference = test::first_difference((*first).ticks[i], (*second).ticks[i]);
  if ((*first).events.size() != (*second).events.size()) difference = "number of events";
  for (std::size_t i = 0; i < (*first).events.size() && difference.empty(); ++i)
    difference = test::first_difference((*first).events[i], (*second).events[i]);
  if (difference.empty()) return 0;
  std::fprintf(stderr, "they differ: %s\n", difference.c_str());
  return 1;
}

}  // namespace

int main(int count, char** arguments) {
  const std::string_view what = count > 2 ? arguments[1] : "";
  if (what == "write" && count == 3) return write(arguments[2], false);
  if (what == "killed" && count == 3) return write(arguments[2], true);
  if (what == "same" && count == 4) return same(arguments[2], arguments[3]);
  std::fprintf(stderr, "usage: recording_example write FILE | killed FILE | same A B\n");
  return 2;
}
