#include <cstdint>

#include "palpate/scene/script.h"

// any input gives a script whose steps can be run in order, or one error with its line
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto script = palpate::parse_script({reinterpret_cast<const char*>(data), size}, "script.toml");
  if (!script) {
    PALPATE_CHECK(!script.error().what.empty() && script.error().where.starts_with("script.toml"));
    return 0;
  }
  PALPATE_CHECK(!script->steps.empty() && script->steps.size() == script->lines.size());
  PALPATE_CHECK(script->rate_hz >= 250 && script->rate_hz <= 10000);
  PALPATE_CHECK(script->delay_s >= 0 && script->delay_s <= 0.02);
  for (const auto& step : script->steps) {
    if (const auto* approach = std::get_if<palpate::ApproachStep>(&step))
      PALPATE_CHECK(approach->structure.empty() == approach->point.has_value());
    if (const auto* slide = std::get_if<palpate::SlideStep>(&step))
      PALPATE_CHECK(slide->direction.norm() > 0);
  }
  return 0;
}
