#include "session/arming_code.h"

#include <sys/random.h>

#include <cstdio>

namespace palpate {
namespace {

constexpr std::uint32_t kCodes = 1'000'000;

// uniformly distributed; empty if the system cannot supply random bytes
std::string new_code() {
  // rejection sampling: values above the last whole multiple of kCodes would bias the code
  constexpr std::uint32_t kWhole = 0xFFFFFFFF - 0xFFFFFFFF % kCodes;
  std::uint32_t number = 0;
  do {
    if (::getrandom(&number, sizeof number, 0) != static_cast<ssize_t>(sizeof number)) return "";
  } while (number >= kWhole);
  char digits[16];
  std::snprintf(digits, sizeof digits, "%06u", static_cast<unsigned>(number % kCodes));
  return digits;
}

// constant-time comparison
bool are_equal(std::string_view one, std::string_view other) {
  if (one.size() != other.size()) return false;
  unsigned differ = 0;
  for (std::size_t i = 0; i < one.size(); ++i) differ |= static_cast<unsigned>(one[i] ^ other[i]);
  return differ == 0;
}

}  // namespace

std::string ArmingCode::code_for(std::uint32_t stop, Clock::time_point now) {
  const std::lock_guard lock(mutex_);
  if (now < paused_until_) return "";
  if (code_.empty() || stop != stop_ || now >= until_) {
    // wrong guesses are counted across codes
    code_ = new_code();
    stop_ = stop;
    until_ = now + kValidity;
  }
  return code_;
}

bool ArmingCode::redeem(std::uint32_t stop, std::string_view code, Clock::time_point now) {
  const std::lock_guard lock(mutex_);
  if (code_.empty() || now < paused_until_) return false;
  if (stop == stop_ && now < until_ && are_equal(code, code_)) {
    code_.clear();
    wrong_ = 0;
    return true;
  }
  if (++wrong_ >= kMaxWrongGuesses) {
    wrong_ = 0;
    code_.clear();
    paused_until_ = now + kLockout;
  }
  return false;
}

}  // namespace palpate
