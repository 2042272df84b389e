#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

/// The table of all columns of ticks and events. Writer, reader and the check of
/// docs/reference/recording-layout.md iterate over it; a new column is one new line here and one there.
namespace palpate::internal {

/// Representation of a value, identical in memory and file: little-endian.
enum class Number { kU8, kU16, kU32, kU64, kF64 };

std::size_t size_of(Number number);

/// A data set with `width` numbers per row.
struct Column {
  const char* name;  ///< Name of the data set in its group
  Number number;
  std::size_t width;    ///< Numbers per row; 1: the data set has shape [N], otherwise [N, width]
  std::size_t offset;   ///< Offset of the first number in TickRecord, DeviceTick or RecordingEvent
  const char* unit;     ///< Unit; "1": dimensionless
  const char* frame;    ///< Frame of the axes, or "-"
  const char* meaning;  ///< Description, ASCII
  std::string (*bits)() = nullptr;  ///< List of the meanings of its bits or numbers
  /// Minor version of the format that added the column: absent from older recordings, where it reads as 0.
  std::uint32_t since_minor = 0;
  std::size_t row_bytes() const { return size_of(number) * width; }
  /// Description stored with the data set.
  std::string description() const { return bits == nullptr ? meaning : meaning + (": " + bits()); }
};

/// Columns of the group /ticks: offsets in TickRecord.
std::span<const Column> tick_columns();
/// Columns of the groups /device0 ... /device3: offsets in DeviceTick.
std::span<const Column> device_columns();
/// Columns of the group /events: offsets in RecordingEvent.
std::span<const Column> event_columns();
/// Bytes per tick of a recording with `devices` devices.
std::size_t tick_bytes(int devices);

}  // namespace palpate::internal
