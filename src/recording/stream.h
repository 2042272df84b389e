#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "palpate/recording.h"

/// What the process that opens an HDF5 file sends to the one that wants its content. HDF5 may have been
/// led astray by the file, so the receiver believes nothing.
///
///   byte 0      u32 n, n bytes: what is wrong; u32 m, m bytes: the remedy            a refusal
///   byte 1      header fields in the order of visit_header, script, structures,
///               byte 0 or 1 and, after 1, the fields of the summary, u32 number of troubles, troubles,
///               u32 number of changes, six f64 of each, u64 rows, then blocks of at most kBlockRows rows:
///               per block the rows of each column, in the order of tick_columns(), device_columns() of
///               device 0, of device 1, ...
///
/// Numbers are little-endian; a text is u32 n and n bytes.
namespace palpate::internal {

inline constexpr std::uint64_t kBlockRows = 4096;

class ByteTarget {
 public:
  virtual ~ByteTarget() = default;
  virtual bool write(std::span<const std::byte> bytes) = 0;
};

class ByteSource {
 public:
  virtual ~ByteSource() = default;
  /// Fills `bytes` or says why not.
  virtual Result<void> read(std::span<std::byte> bytes) = 0;
};

/// Everything but the ticks.
struct RecordingHead {
  RecordingHeader header;
  std::optional<RecordingSummary> summary;
  std::uint64_t rows = 0;
};

bool send_refusal(ByteTarget& target, const Error& refusal);
bool send_head(ByteTarget& target, const RecordingHead& head);
/// The rest of a recording, or the refusal, or what is wrong with the stream. Error::where is empty.
Result<Recording> receive_recording(ByteSource& source, const Progress& progress);

}  // namespace palpate::internal
