#pragma once

#include <cstdint>
#include <filesystem>
#include <random>
#include <span>
#include <string>
#include <vector>

#include "base/test_folder.h"
#include "base/test_process.h"
#include "palpate/recording/recording.h"
#include "recording/commit_file.h"
#include "recording/stream.h"

/// Utilities shared by the tests, the fuzzer and the example of this module.
namespace palpate::test {

/// Header with every field set.
RecordingHeader example_header(int devices = 2, double rate_hz = 1000);
RecordingSummary example_summary(std::uint64_t ticks);
/// A model event in tick 3 and a settings event in tick 7.
std::vector<RecordingEvent> example_events();
/// Random valid events, at most one after each of `ticks[0]`, `ticks[every]`, ...
std::vector<RecordingEvent> random_events(std::span<const TickRecord> ticks, std::size_t every,
                                          std::uint64_t seed);

/// A smooth, plausible run on a virtual clock.
std::vector<TickRecord> example_ticks(std::size_t count, int devices, double rate_hz);
/// Random bits in every number but time_s, which follows the rate: NaNs with payloads, denormals, -0.0.
std::vector<TickRecord> random_ticks(std::size_t count, int devices, double rate_hz, std::uint64_t seed);

/// "" if all fields are bitwise equal, otherwise the name of the first that differs. The fields are listed
/// manually here, so that a field missing in the table of columns is detected.
std::string first_difference(const TickRecord& a, const TickRecord& b);
std::string first_difference(const RecordingEvent& a, const RecordingEvent& b);
std::string first_difference(const RecordingHeader& a, const RecordingHeader& b);
std::string first_difference(const RecordingSummary& a, const RecordingSummary& b);

/// One write or, without bytes, one resize.
struct SinkingStep {
  std::uint64_t offset = 0;
  std::vector<std::byte> bytes;
  bool resize = false;
};
void replay_step(const SinkingStep& step, std::vector<std::byte>& file);

/// In-memory sink that stores every step and can run out of space.
class MemorySink : public internal::ByteSink {
 public:
  struct Disk {
    std::vector<std::byte> file;
    std::vector<SinkingStep> steps;
    std::size_t fails_at = SIZE_MAX;  ///< This write and all later ones fail
  };
  explicit MemorySink(Disk& disk) : disk_(disk) {}
  int write_at(std::uint64_t offset, std::span<const std::byte> bytes) override;
  int read_at(std::uint64_t offset, std::span<std::byte> bytes) override;
  int resize(std::uint64_t size) override;
  int sync() override { return 0; }

 private:
  Disk& disk_;
};

/// Both ends of the stream between the reader's processes, in memory.
class MemorySource : public internal::ByteSource {
 public:
  explicit MemorySource(std::span<const std::byte> bytes) : remaining_(bytes) {}
  Result<void> read(std::span<std::byte> bytes) override;

 private:
  std::span<const std::byte> remaining_;
};
class MemoryTarget : public internal::ByteTarget {
 public:
  bool write(std::span<const std::byte> more) override;
  std::vector<std::byte> bytes;
};

/// Everything received through a stream.
Result<Recording> receive_all(internal::ByteSource& source);

/// read_recording without its child process, which starts slowly under sanitizers. For trusted files only.
Result<Recording> read_in_this_process(const std::filesystem::path& file);

void write_bytes(const std::filesystem::path& file, std::span<const std::byte> bytes);
std::vector<std::byte> read_bytes(const std::filesystem::path& file);

}  // namespace palpate::test
