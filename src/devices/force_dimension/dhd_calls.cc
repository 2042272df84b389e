#include "force_dimension/dhd_calls.h"

#include <array>

#include "force_dimension/models.h"
#include "palpate/base/printable.h"

namespace palpate::dhd {

Error library_error(const Library& library, const std::string& what, const std::string& where,
                    const std::string& remedy) {
  const char* message = library.dhdErrorGetLastStr();
  return {ErrorKind::kUnavailable,
          what + (message && *message != '\0' ? " (" + printable_name(message) + ")" : std::string()), where,
          remedy};
}

int open_device(const Library& library, int index) {
  const auto id = static_cast<char>(index);
  return library.drdOpenID && library.drdClose ? library.drdOpenID(id) : library.dhdOpenID(id);
}
void close_device(const Library& library, char id) {
  if (library.drdOpenID && library.drdClose)
    library.drdClose(id);
  else
    library.dhdClose(id);
}

bool is_initialised(const Library& library, char id) {
  if (library.drdIsInitialized) return library.drdIsInitialized(id);
  std::array<int, kStatusFields> status{};
  return library.dhdGetStatus(status.data(), id) >= 0 && status[kReset] == 1;
}

Identity identity_of(const Library& library, char id) {
  Identity identity{library.dhdGetSystemType(id), library.dhdIsLeftHanded(id), {}};
  unsigned short serial = 0;
  if (library.dhdGetSerialNumber && library.dhdGetSerialNumber(&serial, id) >= 0) identity.serial = serial;
  return identity;
}
std::string name_of(const Identity& identity) {
  std::string name = model_of(identity.type).name;
  if (identity.left) name += " (left)";
  if (identity.serial) name += " no. " + std::to_string(*identity.serial);
  return name;
}

}  // namespace palpate::dhd
