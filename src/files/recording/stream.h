#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "palpate/reader/fields.h"
#include "palpate/recording/recording.h"
#include "palpate/recording/recording_source.h"

/// Protocol from the sandboxed process that opens an HDF5 file to its client. The file may have compromised
/// the sender, so the receiver validates everything.
///
///   byte 0      u32 n, n bytes: the problem; u32 m, m bytes: the remedy              a refusal
///   byte 1      header fields in the order of visit_header, script, structures,
///               byte 0 or 1 and, after 1, the fields of the summary, u32 number of problems, problems,
///               u64 ticks, byte: whether the clock is monotonic, u32 number of methods, u8 method and u64
///               tick of each, then parts until all ticks have been sent:
///
///                 u32 events, u32 ticks, at most kBlockRows of each and at least one of either
///                 rows of each column in the order of event_columns(),
///                 rows of each column in the order of tick_columns(), device_columns() of device 0, of
///                 device 1, ...
///
/// Numbers are little-endian; a text is u32 n and n bytes.
namespace palpate::internal {

inline constexpr std::uint64_t kBlockRows = 4096;

using reader::ByteSource;
using reader::ByteTarget;

/// Properties of the sequence of ticks that the head contains, accumulated from the first tick on.
class TickProperties {
 public:
  void observe(std::uint64_t tick, double time_s, std::uint8_t method);
  /// Stores them in a head.
  void write_to(RecordingHead& head) const;
  /// Whether they agree so far with a received head.
  bool agrees_with(const RecordingHead& head) const;

 private:
  std::uint64_t ticks_ = 0;
  bool is_clock_monotonic_ = true;
  double last_s_ = 0;
  std::array<bool, 256> method_seen_{};
  std::vector<RecordingHead::AppliedMethod> methods_;
};

bool send_refusal(ByteTarget& target, const Error& refusal);
bool send_head(ByteTarget& target, const RecordingHead& head);
/// Sends the beginning of a part, up to the columns of its ticks.
bool send_events(ByteTarget& target, std::span<const RecordingEvent> events, std::uint32_t ticks);

/// Receives the head. Errors: the sender's refusal, or a violation of the protocol; Error::where is empty.
Result<RecordingHead> receive_head(ByteSource& source);
/// Receives all parts after the head. `visit` may stop by returning an error.
Result<void> receive_parts(ByteSource& source, const RecordingHead& head,
                           const std::function<Result<void>(const RecordingPart&)>& visit,
                           const Progress& progress);
/// Number of events not after this tick.
std::size_t events_up_to(std::span<const RecordingEvent> events, std::uint64_t tick);

}  // namespace palpate::internal
