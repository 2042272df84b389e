#pragma once

#include <chrono>
#include <cstddef>
#include <map>

#include "link/address.h"
#include "link/token_bucket.h"

namespace palpate::link {

/// How many wrong tokens are looked at, at most 10 in any second of one address. What is beyond is refused
/// without a look, the right token as well: an answer to it would be an answer to every guess. Nobody is kept
/// out for longer than the guessing lasts: a fifth of a second without one makes room for the next look, and
/// whoever is in already stays in.
///
/// The table of addresses is bounded: those that find no place in it share one account.
class GuessLimit {
 public:
  using Clock = TokenBucket::Clock;
  /// 5 at once and 5 more each second are never more than 10 in a second.
  static constexpr double kAtOnce = 5, kEachSecond = 5;
  /// Some 300 kB.
  static constexpr std::size_t kMostAddresses = 4096;

  /// Whether a token may be looked at that comes from there.
  bool may_guess(const AddressBlock& from, Clock::time_point now);
  /// The token was wrong.
  void guessed_wrong(const AddressBlock& from, Clock::time_point now);
  /// Removes the accounts of addresses that have not guessed for a second, at most every 100 ms. Without it
  /// an account would outlast its second until the next token is shown.
  void forget_the_quiet(Clock::time_point now);
  /// That have an account at present.
  std::size_t addresses() const { return accounts_.size(); }

 private:
  std::map<AddressBlock, TokenBucket> accounts_;
  TokenBucket shared_{kEachSecond, kAtOnce, {}};
  Clock::time_point forgot_{};
};

}  // namespace palpate::link
