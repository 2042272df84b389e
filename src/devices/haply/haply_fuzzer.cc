#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "haply/messages.h"

/// Messages of an arbitrary local program in place of the Inverse Service.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const auto must = [](bool holds) {
    if (!holds) std::abort();
  };
  if (const auto version = palpate::haply::parse_version(text)) must(version->minor >= 0);
  if (const auto state = palpate::haply::parse_state(text)) {
    for (const auto& device : state->devices)
      if (device.tip_mm) must(device.tip_mm->all_finite());
    for (const auto& grip : state->grips) must(std::abs(grip.orientation.norm() - 1) < 1e-9);
  }
  return 0;
}
