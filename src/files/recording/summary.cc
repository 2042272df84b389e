#include "palpate/base/check.h"
#include "palpate/base/hash.h"
#include "palpate/recording/recording.h"
#include "recording/header_fields.h"

namespace palpate {

void RecordingSummary::observe(const TickRecord& tick) {
  PALPATE_CHECK(tick.devices >= 1 && tick.devices <= kMaxDevices);
  std::uint32_t flags = 0;
  for (std::size_t d = 0; d < static_cast<std::size_t>(tick.devices); ++d) flags |= tick.device[d].flags;
  ticks += 1;
  run_hash = mix_run_hash(run_hash, tick.state_hash);
  internal::visit_flag_counts(
      *this, [&](const char*, std::uint64_t& count, TickFlag flag) { count += (flags & flag) != 0; });
}

std::uint64_t mix_run_hash(std::uint64_t run_hash, std::uint64_t state_hash) {
  hash_word(run_hash, state_hash);
  return run_hash;
}

}  // namespace palpate
