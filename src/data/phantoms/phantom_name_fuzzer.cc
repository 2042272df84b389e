#include <cstdint>

#include "palpate/phantoms/phantoms.h"

// Any text is either the name of a phantom, whose canonical name parses to itself, or an error.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto parameters = palpate::parse_phantom({reinterpret_cast<const char*>(data), size});
  if (!parameters) {
    PALPATE_CHECK(!parameters.error().what.empty());
    return 0;
  }
  const std::string name = palpate::phantom_name(*parameters);
  const auto again = palpate::parse_phantom(name);
  PALPATE_CHECK(again.ok() && palpate::phantom_name(*again) == name);
  return 0;
}
