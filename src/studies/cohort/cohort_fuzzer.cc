#include "palpate/cohort/case.h"
#include "palpate/cohort/cohort_table.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  (void)palpate::parse_cohort_table(text, "fuzz", "").ok();
  (void)palpate::parse_case_json(text).has_value();
  return 0;
}
