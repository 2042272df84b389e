#pragma once

#include <string>

/// What the bits of a recording mean, as its columns describe them: "1 clamped, 2 not finite, ...". One list
/// of names, in bits.cc; docs/reference/flags.md is held against it.
namespace palpate::internal {

/// DeviceTick::flags
std::string flag_bits();
/// TickRecord::switches
std::string switch_bits();
/// DeviceTick::status
std::string status_bits();
/// RecordingEvent::changed
std::string setting_bits();
/// "0 trilinear, 1 b-spline, ..."
std::string method_numbers();
/// RecordingEvent::kind and its by.asker, likewise.
std::string event_kinds();
std::string askers();

}  // namespace palpate::internal
