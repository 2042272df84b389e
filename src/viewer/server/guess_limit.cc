#include "server/guess_limit.h"

namespace palpate::server {
namespace {

constexpr auto kForgetEvery = std::chrono::milliseconds(100);

}  // namespace

bool GuessLimit::may_check_token(const AddressBlock& from, Clock::time_point now) {
  forget_inactive(now);
  const auto known = accounts_.find(from);
  if (known != accounts_.end()) return known->second.left(now) >= 1;
  return accounts_.size() < kMaxAddresses || shared_.left(now) >= 1;
}

void GuessLimit::guessed_wrong(const AddressBlock& from, Clock::time_point now) {
  const auto known = accounts_.find(from);
  if (known != accounts_.end())
    known->second.take(now);
  else if (accounts_.size() < kMaxAddresses)
    accounts_.emplace(from, TokenBucket(kRate_per_s, kBurst, now)).first->second.take(now);
  else
    shared_.take(now);
}

void GuessLimit::forget_inactive(Clock::time_point now) {
  if (now < forgot_ + kForgetEvery) return;
  forgot_ = now;
  // a full account is equivalent to none
  std::erase_if(accounts_, [now](const auto& entry) { return entry.second.is_full(now); });
}

}  // namespace palpate::server
