#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "palpate/base/printable.h"
#include "palpate/doctor/grip_trial.h"

/// Parses a file of held-hand results, which a user or another program may have modified.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const auto must = [](bool holds) {
    if (!holds) std::abort();
  };
  const auto hands = palpate::parse_grip_figures(text, "held");
  if (!hands) {
    must(!hands.error().remedy.empty());
    return 0;
  }
  for (const auto& [name, figures] : *hands) {
    must(!name.empty() && name == figures.device && palpate::printable_name(name) == name);
    must(figures.delay_s >= 0 && figures.delay_s <= 0.02);
    must(figures.recommended_N_per_mm > 0 && figures.recommended_N_per_mm <= 3);
  }
  // round trip
  const auto again = palpate::parse_grip_figures(palpate::grip_figures_text(*hands), "held");
  must(again.ok() && again->size() == hands->size());
  for (const auto& [name, figures] : *hands) must(again->contains(name));
  return 0;
}
