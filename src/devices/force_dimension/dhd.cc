#include "force_dimension/dhd.h"

#include <array>

#include "palpate/device/vendor_library.h"

namespace palpate::dhd {

Result<Library> load(const std::filesystem::path& file) {
  Library library;
#define PALPATE_DHD_NEEDED_ROW(result, name, arguments) \
  VendorFunction{#name, reinterpret_cast<void**>(&library.name), true},
#define PALPATE_DHD_OPTIONAL_ROW(result, name, arguments) \
  VendorFunction{#name, reinterpret_cast<void**>(&library.name), false},
  const VendorFunction functions[] = {PALPATE_DHD_NEEDED(PALPATE_DHD_NEEDED_ROW)
                                          PALPATE_DHD_OPTIONAL(PALPATE_DHD_OPTIONAL_ROW)};
#undef PALPATE_DHD_NEEDED_ROW
#undef PALPATE_DHD_OPTIONAL_ROW
  if (auto loaded = load_vendor_library(file, functions, "Force Dimension's SDK"); !loaded)
    return loaded.error();
  return library;
}

}  // namespace palpate::dhd
