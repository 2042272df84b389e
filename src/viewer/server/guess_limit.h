#pragma once

#include <chrono>
#include <cstddef>
#include <map>

#include "palpate/server/address.h"
#include "server/token_bucket.h"

namespace palpate::server {

/// Rate limit on token guesses: at most 10 wrong tokens per address within any second are checked. Beyond
/// that, requests are refused without checking, correct tokens included, since a different answer would
/// reveal the correct one. The lockout lasts only as long as the guessing: after a fifth of a second without
/// a guess the next one is checked, and viewers already connected stay connected.
///
/// The table of addresses is bounded; addresses beyond it share one account.
class GuessLimit {
 public:
  using Clock = TokenBucket::Clock;
  /// A burst of 5 and 5 more per second never exceed 10 within a second.
  static constexpr double kBurst = 5, kRate_per_s = 5;
  /// About 300 kB.
  static constexpr std::size_t kMaxAddresses = 4096;

  /// Whether a token from that address may be checked.
  bool may_check_token(const AddressBlock& from, Clock::time_point now);
  /// Counts a wrong token.
  void guessed_wrong(const AddressBlock& from, Clock::time_point now);
  /// Removes the accounts of addresses without a guess in the last second; does so at most every 100 ms.
  /// Without it an account would persist until the next token is checked.
  void forget_inactive(Clock::time_point now);
  /// Number of addresses with an account.
  std::size_t addresses() const { return accounts_.size(); }

 private:
  std::map<AddressBlock, TokenBucket> accounts_;
  TokenBucket shared_{kRate_per_s, kBurst, {}};
  Clock::time_point forgot_{};
};

}  // namespace palpate::server
