#include "link/guess_limit.h"

#include <algorithm>
#include <iterator>

namespace palpate::link {
namespace {

constexpr auto kForgetEvery = std::chrono::milliseconds(100);
constexpr std::size_t kBlockBytes = 8;

}  // namespace

AddressBlock block_of(const boost::asio::ip::address& address) {
  namespace ip = boost::asio::ip;
  AddressBlock block{};
  const bool mapped = address.is_v6() && address.to_v6().is_v4_mapped();
  if (address.is_v6() && !mapped) {
    const auto bytes = address.to_v6().to_bytes();
    std::copy_n(bytes.begin(), kBlockBytes, block.begin());
    return block;
  }
  // marked where every /64 of IPv6 has a zero
  const auto v4 = mapped ? ip::make_address_v4(ip::v4_mapped, address.to_v6()) : address.to_v4();
  const auto bytes = v4.to_bytes();
  std::copy(bytes.begin(), bytes.end(), std::prev(block.end(), static_cast<std::ptrdiff_t>(bytes.size())));
  block[kBlockBytes] = 1;
  return block;
}

bool GuessLimit::may_guess(const AddressBlock& from, Clock::time_point now) {
  forget_the_quiet(now);
  const auto known = accounts_.find(from);
  if (known != accounts_.end()) return known->second.left(now) >= 1;
  return accounts_.size() < kMostAddresses || shared_.left(now) >= 1;
}

void GuessLimit::guessed_wrong(const AddressBlock& from, Clock::time_point now) {
  const auto known = accounts_.find(from);
  if (known != accounts_.end())
    known->second.take(now);
  else if (accounts_.size() < kMostAddresses)
    accounts_.emplace(from, TokenBucket(kEachSecond, kAtOnce, now)).first->second.take(now);
  else
    shared_.take(now);
}

void GuessLimit::forget_the_quiet(Clock::time_point now) {
  if (now < forgot_ + kForgetEvery) return;
  forgot_ = now;
  // an account that is full again says nothing that a new one would not
  std::erase_if(accounts_, [now](const auto& entry) { return entry.second.is_full(now); });
}

}  // namespace palpate::link
