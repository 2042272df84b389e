#pragma once

#include <optional>
#include <string>

#include "openhaptics/hd.h"

/// Sequences of calls that both the driver and the checks of `palpate doctor` make.
namespace palpate::hd {

/// Remedy if the library is not found.
inline constexpr const char* kMissingLibraryRemedy =
    "get OpenHaptics and the device's driver from 3D Systems and install both, or name the file: --library "
    "touch=FILE";

/// Text of the current device, made printable; empty if the library has none.
std::string text_of(const Library& library, Parameter parameter);
/// Number of the current device; empty if it is not supported, or not in (0, largest].
std::optional<double> number_of(const Library& library, Parameter parameter, double largest);

bool is_warning(unsigned code);
/// Takes all errors off the stack; returns the last one that is more than a warning, otherwise the last one.
unsigned drain(const Library& library);
/// Error of a device that the library could not initialise.
/// @param code  result of init()
Error init_error(const Library& library, unsigned code, const std::string& where);
/// Initialises the device of this name, or of the usual default names if it is empty. kBadHandle: it failed
/// with `error`.
Handle init(const Library& library, const std::string& config, unsigned& error);

}  // namespace palpate::hd
