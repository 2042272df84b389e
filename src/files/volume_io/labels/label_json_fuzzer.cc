#include "palpate/volume_io/label_tables.h"

// name formats other than colour tables and tab-separated tables; the first byte selects one
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const std::string_view text(reinterpret_cast<const char*>(data) + 1, size - 1);
  if (data[0] % 4 == 0) (void)palpate::parse_snap_labels(text, "fuzz").ok();
  if (data[0] % 4 == 1) (void)palpate::parse_label_csv(text, "fuzz").ok();
  if (data[0] % 4 >= 2) (void)palpate::parse_label_json(text, "fuzz").ok();
  return 0;
}
