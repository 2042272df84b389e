#include <cstdint>

#include "palpate/phantoms/phantoms.h"

// any text is the name of a phantom, which has one name that reads as itself, or one error
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
