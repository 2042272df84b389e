#include <cstdint>
#include <cstdlib>

#include "volume_io/streams/inflate.h"
#include "volume_io/streams/test_inflate.h"

// compressed bytes of a dropped file, whose decoding has to equal zlib's
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate::test;
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  constexpr std::size_t kMost = std::size_t{1} << 22;
  const Decoded ours = decoded(bytes, kMost), zlibs = decoded_by_zlib(bytes, kMost);
  // where the data end within a block, zlib may have delivered fewer of its last bytes
  const bool is_cut = ours.fault.find("end early") != std::string::npos;
  if (ours.fault != zlibs.fault || (!is_cut && ours.bytes != zlibs.bytes)) std::abort();
  return 0;
}
