#pragma once

#include <cstddef>
#include <span>
#include <string>

/// The one table of what a recording stores for every tick and every event. The writer, the reader and the
/// check of docs/reference/recording-layout.md all walk it; a new column is one new line here and one
/// there.
namespace palpate::internal {

/// How a value lies in memory and, identically, in the file: little-endian.
enum class Number { kU8, kU16, kU32, kU64, kF64 };

std::size_t size_of(Number number);

/// The oldest format that is read.
inline constexpr std::uint32_t kOldestFormat = 3;

/// One data set: `width` numbers a row.
struct Column {
  const char* name;  ///< of the data set in its group
  Number number;
  std::size_t width;                ///< numbers a row; 1: the data set is [N], otherwise [N, width]
  std::size_t offset;               ///< of the first number in TickRecord, DeviceTick or RecordingEvent
  const char* unit;                 ///< "1": a pure number
  const char* frame;                ///< whose axes, or "-"
  const char* meaning;              ///< ASCII
  std::string (*bits)() = nullptr;  ///< the list of what its bits or numbers mean
  std::uint32_t since =
      kOldestFormat;  ///< the format's major number that never lacks it; what a file lacks is read as 0

  std::size_t row_bytes() const { return size_of(number) * width; }
  /// Stored with the data set.
  std::string description() const { return bits == nullptr ? meaning : meaning + (": " + bits()); }
};

/// Columns of the group /ticks: offsets in TickRecord.
std::span<const Column> tick_columns();
/// Columns of the groups /device0 ... /device3: offsets in DeviceTick.
std::span<const Column> device_columns();
/// Columns of the group /events: offsets in RecordingEvent.
std::span<const Column> event_columns();
/// Bytes of one tick of a recording with that many devices.
std::size_t tick_bytes(int devices);

}  // namespace palpate::internal
