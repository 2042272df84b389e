#include <algorithm>
#include <cstddef>
#include <cstdio>
#include <cstring>
#include <span>

#include "palpate/recording/recording_source.h"
#include "recording/columns.h"

namespace palpate {
namespace {

using internal::Column;
using internal::Number;

// in DeviceTick all outputs follow the inputs
bool is_output(const Column& column) {
  return column.offset >= offsetof(DeviceTick, force_N);
}

std::span<const char> bytes_of(const DeviceTick& device, const Column& column) {
  return {reinterpret_cast<const char*>(&device) + column.offset, column.row_bytes()};
}

template <class T>
T number_of(const char* at) {
  T value;
  std::memcpy(&value, at, sizeof value);
  return value;
}

std::string text_of(const DeviceTick& device, const Column& column) {
  std::string text;
  for (std::size_t n = 0; n < column.width; ++n) {
    const char* at = bytes_of(device, column).data() + n * internal::size_of(column.number);
    char number[40];
    switch (column.number) {
      case Number::kU8:
        std::snprintf(number, sizeof number, "%u", static_cast<unsigned>(number_of<std::uint8_t>(at)));
        break;
      case Number::kU16:
        std::snprintf(number, sizeof number, "%u", static_cast<unsigned>(number_of<std::uint16_t>(at)));
        break;
      case Number::kU32:
        std::snprintf(number, sizeof number, "%u", static_cast<unsigned>(number_of<std::uint32_t>(at)));
        break;
      case Number::kU64:
        std::snprintf(number, sizeof number, "%llu",
                      static_cast<unsigned long long>(number_of<std::uint64_t>(at)));
        break;
      case Number::kF64:
        std::snprintf(number, sizeof number, "%.17g", number_of<double>(at));
        break;
    }
    text += (n == 0 ? "" : " ") + std::string(number);
  }
  return text;
}

}  // namespace

std::string first_different_output(const DeviceTick& recorded, const DeviceTick& again) {
  for (const Column& column : internal::device_columns()) {
    if (!is_output(column)) continue;
    const std::span<const char> before = bytes_of(recorded, column), now = bytes_of(again, column);
    if (std::equal(before.begin(), before.end(), now.begin())) continue;
    return std::string(column.name) + ": recorded " + text_of(recorded, column) + ", now " +
           text_of(again, column);
  }
  return "";
}

}  // namespace palpate
