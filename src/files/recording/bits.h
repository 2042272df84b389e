#pragma once

#include <string>

/// Meaning of the bits in a recording's columns: "1 clamped, 2 not finite, ...". The single list of names is
/// in bits.cc; docs/reference/flags.md is checked against it.
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
/// RecordingEvent::kind and its by.originator, in the same form.
std::string event_kinds();
std::string originators();

}  // namespace palpate::internal
