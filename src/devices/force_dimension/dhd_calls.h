#pragma once

#include <optional>
#include <string>

#include "force_dimension/dhd.h"

/// Sequences of calls that both the driver and the checks of `palpate doctor` make.
namespace palpate::dhd {

/// Remedy if the library is not found.
inline constexpr const char* kMissingLibraryRemedy =
    "get Force Dimension's SDK from forcedimension.com/software/sdk and copy libdrd.so.3 to /usr/local/lib, "
    "or name the file: --library force-dimension=FILE";

/// Identity of a device, independent of its position in the list.
struct Identity {
  int type = 0;
  bool left = false;
  std::optional<unsigned short> serial;
  bool operator==(const Identity&) const = default;
};

/// Error with the library's own message for a failed call.
Error library_error(const Library& library, const std::string& what, const std::string& where,
                    const std::string& remedy);

/// Opens a device, by libdrd if it is available. Returns its id; negative: it failed.
int open_device(const Library& library, int index);
void close_device(const Library& library, char id);
/// Whether the position of the arm is known.
bool is_initialised(const Library& library, char id);

Identity identity_of(const Library& library, char id);
/// Name for the user: "omega.6 (left) no. 1234".
std::string name_of(const Identity& identity);

}  // namespace palpate::dhd
