#include "volume_io/formats/headers.h"

// the three header parsers, which receive untrusted bytes first
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  using namespace palpate::volume_io;
  if (const auto nrrd = parse_nrrd_header(bytes, "fuzz")) (void)volume_dims(nrrd->axes, "fuzz").ok();
  if (const auto meta = parse_metaimage_header(bytes, "fuzz")) (void)volume_dims(meta->axes, "fuzz").ok();
  if (const auto nifti = parse_nifti_header(bytes, "fuzz")) {
    (void)volume_dims(nifti->axes, "fuzz").ok();
    (void)parse_caret_labels(find_caret_extension(bytes, nifti->header_bytes, nifti->swapped), "fuzz").ok();
  }
  (void)parse_caret_labels(bytes, "fuzz").ok();
  return 0;
}
