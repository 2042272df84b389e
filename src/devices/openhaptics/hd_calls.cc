#include "openhaptics/hd_calls.h"

#include <cmath>
#include <span>

#include "palpate/base/printable.h"

namespace palpate::hd {
namespace {

// errors are returned one by one; bounds a stack that never empties
constexpr int kMaxErrors = 64;

}  // namespace

std::string text_of(const Library& library, Parameter parameter) {
  const char* text = library.hdGetString(parameter);
  return text ? printable_name(text) : std::string();
}

std::optional<double> number_of(const Library& library, Parameter parameter, double largest) {
  double value = 0;
  library.hdGetDoublev(parameter, &value);
  // an unsupported parameter leaves the value unchanged
  return std::isfinite(value) && value > 0 && value <= largest ? std::optional(value) : std::nullopt;
}

bool is_warning(unsigned code) {
  return code >= kWarmMotors && code <= kForceError;
}

unsigned drain(const Library& library) {
  unsigned worst = kNoError;
  for (int n = 0; n < kMaxErrors; ++n) {
    const unsigned code = library.hdGetError().code;
    if (code == kNoError) break;
    if (!is_warning(code) || worst == kNoError) worst = code;
  }
  return worst;
}

Error init_error(const Library& library, unsigned code, const std::string& where) {
  const char* message = library.hdGetErrorString(code);
  std::string remedy =
      "is it connected and configured with the vendor's program? palpate doctor --device touch checks the "
      "requirements of the library";
  if (code == kLicence) remedy = "install the OpenHaptics licence as described in its manual";
  return {ErrorKind::kUnavailable,
          "the library cannot initialise it" +
              (message && *message ? " (" + printable_name(message) + ")" : std::string()),
          where, remedy};
}

Handle init(const Library& library, const std::string& config, unsigned& error) {
  const char* const kDefault[] = {nullptr, "Default Device", "Default PHANToM"};
  const char* const named[] = {config.c_str()};
  for (const char* name :
       config.empty() ? std::span<const char* const>(kDefault) : std::span<const char* const>(named)) {
    drain(library);
    const Handle handle = library.hdInitDevice(name);
    error = drain(library);
    if (handle != kBadHandle && error == kNoError) return handle;
    if (handle != kBadHandle) library.hdDisableDevice(handle);
    drain(library);
  }
  return kBadHandle;
}

}  // namespace palpate::hd
