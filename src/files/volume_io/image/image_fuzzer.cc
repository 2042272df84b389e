#include <algorithm>
#include <cstdlib>
#include <vector>

#include "volume_io/image/image.h"

// decodes one image if it is small
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate;
  using namespace palpate::volume_io;
  const auto decoder = open_image(bytes_in_memory({reinterpret_cast<const char*>(data), size}));
  if (!decoder) {
    if (decoder.error().what.empty() || decoder.error().remedy.empty()) std::abort();
    return 0;
  }
  const auto& pages = (*decoder)->pages();
  if (pages.empty()) std::abort();
  constexpr std::size_t kMaxPages = 4, kMaxPixels = 1 << 16;
  for (std::size_t n = 0; n < std::min(pages.size(), kMaxPages); ++n) {
    if (pages[n].pixels() == 0 || pages[n].pixels() > kMaxImagePixels) std::abort();
    if (pages[n].pixels() > kMaxPixels) continue;
    std::vector<std::uint32_t> pixels(pages[n].pixels());
    if (const auto read = (*decoder)->read(n, pixels); !read) {
      if (read.error().what.empty() || read.error().remedy.empty()) std::abort();
      continue;
    }
    const std::uint32_t largest = pages[n].colour                            ? 0xFFFFFF
                                  : pages[n].component == Component::kUint8  ? 0xFF
                                  : pages[n].component == Component::kUint16 ? 0xFFFF
                                                                             : 0xFFFFFFFF;
    if (std::ranges::any_of(pixels, [&](std::uint32_t pixel) { return pixel > largest; })) std::abort();
  }
  return 0;
}
