#include "volume_io/formats/file_kind.h"

// the first byte selects a name, the second whether the size is known
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 2) return 0;
  static const char* const kNames[] = {"a", "a.stl", "a.obj", "a.mnc", "a.mgz", "a.mrb", "a.nii.gz", "a.dcm"};
  const std::string_view bytes(reinterpret_cast<const char*>(data) + 2, size - 2);
  (void)palpate::volume_io::kind_of(bytes, kNames[data[0] % 8], data[1] % 2 ? bytes.size() : 0);
  return 0;
}
