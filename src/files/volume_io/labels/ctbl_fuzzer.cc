#include "palpate/volume_io/label_tables.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  (void)palpate::parse_colour_table({reinterpret_cast<const char*>(data), size}, "fuzz").ok();
  return 0;
}
