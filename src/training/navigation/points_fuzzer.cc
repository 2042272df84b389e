#include "palpate/navigation/point_files.h"
#include "palpate/navigation/result_files.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  (void)palpate::parse_points(text, "fuzz").ok();
  (void)palpate::parse_markups(text, "fuzz").ok();
  (void)palpate::parse_poses(text, "fuzz").ok();
  (void)palpate::parse_poses(text, "fuzz", {"StylusToTracker", true}).ok();
  (void)palpate::parse_tip(text, "fuzz").ok();
  (void)palpate::parse_registration(text, "fuzz").ok();
  return 0;
}
