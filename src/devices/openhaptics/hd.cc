#include "openhaptics/hd.h"

#include "palpate/device/vendor_library.h"

namespace palpate::hd {

Result<Library> load(const std::filesystem::path& file) {
  Library library;
#define PALPATE_HD_ROW(result, name, arguments) \
  VendorFunction{#name, reinterpret_cast<void**>(&library.name), true},
  const VendorFunction functions[] = {PALPATE_HD_FUNCTIONS(PALPATE_HD_ROW)};
#undef PALPATE_HD_ROW
  if (auto loaded = load_vendor_library(file, functions, "OpenHaptics"); !loaded) return loaded.error();
  return library;
}

}  // namespace palpate::hd
