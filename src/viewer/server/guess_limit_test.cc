#include "server/guess_limit.h"

#include <gtest/gtest.h>

#include <deque>
#include <random>

#include "base/test_seed.h"
#include "server/access.h"
#include "server/site.h"
#include "server/test_host.h"

namespace palpate::server {
namespace {

using namespace std::chrono_literals;
using Clock = GuessLimit::Clock;

constexpr const char* kRight = "a-token-of-our-own-71";

AddressBlock block(const std::string& address) {
  return block_of(IpAddress::parse(address).value());
}
AddressBlock block(std::uint32_t address) {
  return block_of(IpAddress(
      IpAddress::V4Bytes{static_cast<unsigned char>(address >> 24), static_cast<unsigned char>(address >> 16),
                         static_cast<unsigned char>(address >> 8), static_cast<unsigned char>(address)}));
}

Access guarded() {
  return Access("127.0.0.1", 8480, false, {}, *Tokens::parse(std::string("view ") + kRight, "tokens"));
}

TEST(GuessLimit, AddressesOfOneMachineCountTogether) {
  EXPECT_EQ(block("10.1.2.3"), block("::ffff:10.1.2.3"));
  EXPECT_NE(block("10.1.2.3"), block("10.1.2.4"));
  EXPECT_EQ(block("2001:db8:1:2::1"), block("2001:db8:1:2:ffff:ffff:ffff:ffff"));
  EXPECT_NE(block("2001:db8:1:2::1"), block("2001:db8:1:3::1"));
  EXPECT_NE(block("0.0.0.0"), block("::"));
  EXPECT_NE(block("0.0.0.1"), block("::1"));
}

// whatever the timing of the guesses: all at once, uniform, in bursts
TEST(GuessLimit, NeverMoreThanTenInASecond) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE(seed);
  std::mt19937 random(seed);
  for (const int longest_ms : {1, 20, 150, 1500}) {
    Access access = guarded();
    Clock::time_point now{};
    std::deque<Clock::time_point> inspected;
    int largest = 0;
    for (int n = 0; n < 5000; ++n) {
      now += std::chrono::milliseconds(random() % static_cast<unsigned>(longest_ms + 1));
      const auto who = access.admit("wrong-" + std::to_string(random()), block("10.1.2.3"), now);
      EXPECT_FALSE(who.who);
      if (!who.too_many_guesses) inspected.push_back(now);
      while (!inspected.empty() && inspected.front() <= now - 1s) inspected.pop_front();
      largest = std::max(largest, static_cast<int>(inspected.size()));
    }
    EXPECT_LE(largest, 10);
    EXPECT_GE(largest, longest_ms < 100 ? 9 : 2) << "somebody who mistypes is not kept waiting";
  }
}

TEST(GuessLimit, OtherAddressesAreNotHeldUp) {
  Access access = guarded();
  const Clock::time_point now{};
  while (!access.admit("wrong", block("10.1.2.3"), now).too_many_guesses) {
  }
  EXPECT_EQ(access.admit(kRight, block("10.1.2.4"), now).who->role, Role::kView);
  EXPECT_EQ(access.admit(kRight, block("2001:db8::1"), now).who->role, Role::kView);
}

// a viewer with the right token shares an address with an attacker
TEST(GuessLimit, ValidTokenIsBlockedOnlyDuringGuessing) {
  Access access = guarded();
  Clock::time_point now{};
  // an hour of guessing at full speed
  for (int n = 0; n < 36000; ++n) {
    now += 100ms;
    for (int k = 0; k < 10; ++k) access.admit("wrong", block("10.1.2.3"), now);
  }
  const auto during = access.admit(kRight, block("10.1.2.3"), now);
  EXPECT_TRUE(during.too_many_guesses) << "an answer would be an answer to every guess";
  EXPECT_FALSE(during.who);
  EXPECT_EQ(access.admit(kRight, block("10.1.2.3"), now + 201ms).who->role, Role::kView);
}

// the page sends several requests at once, each with its token
TEST(GuessLimit, RightTokensAndNoneCostNothing) {
  Access access = guarded();
  const Clock::time_point now{};
  for (int n = 0; n < 1000; ++n) {
    EXPECT_EQ(access.admit(kRight, block("10.1.2.3"), now).who->role, Role::kView);
    EXPECT_FALSE(access.admit("", block("10.1.2.3"), now).too_many_guesses);
  }
}

TEST(GuessLimit, TheTableOfAddressesIsBounded) {
  GuessLimit limit;
  Clock::time_point now{};
  int inspected = 0;
  const int tried = 3 * static_cast<int>(GuessLimit::kMaxAddresses);
  for (int n = 0; n < tried; ++n) {
    const AddressBlock from = block(static_cast<std::uint32_t>(n));
    if (!limit.may_check_token(from, now)) continue;
    ++inspected;
    limit.guessed_wrong(from, now);
  }
  EXPECT_EQ(limit.addresses(), GuessLimit::kMaxAddresses);
  EXPECT_EQ(inspected, static_cast<int>(GuessLimit::kMaxAddresses + GuessLimit::kBurst));
  // inactive addresses are forgotten, even if no new address was accepted
  now += 300ms;
  EXPECT_TRUE(limit.may_check_token(block("10.9.9.9"), now));
  EXPECT_EQ(limit.addresses(), 0u);
}

// the hub's periodic check asks for it, whether or not tokens are shown
TEST(GuessLimit, NoAddressIsRememberedForLongerThanASecond) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE(seed);
  std::mt19937 random(seed);
  for (int round = 0; round < 200; ++round) {
    Access access = guarded();
    Clock::time_point now{std::chrono::hours(1)}, last = now;
    const int guesses = 1 + static_cast<int>(random() % 12);
    for (int n = 0; n < guesses; ++n) {
      now += std::chrono::milliseconds(random() % 250);
      // a request refused without a check does not count
      if (!access.admit("wrong-token-of-some-length", block("10.1.2.3"), now).too_many_guesses) last = now;
      access.forget_inactive_guesses(now);
      EXPECT_EQ(access.addresses_remembered(), 1u) << round;
    }
    for (now = last; now < last + 1s; now += 100ms) access.forget_inactive_guesses(now);
    access.forget_inactive_guesses(last + 1s);
    EXPECT_EQ(access.addresses_remembered(), 0u) << round;
  }
}

TEST(GuessLimit, SiteReportsRetryAfter) {
  testing::FakeHost host;
  Site site(host, guarded(), VolumeFacts{"00aa", 1, 0, {0, 1}, false});
  HttpRequest request;
  request.method = "GET";
  request.target = "/api/scene";
  request.host = "localhost:8480";
  request.local_address = "127.0.0.1";
  request.authorization = "Bearer wrong";
  const auto answer = [&] { return std::get<HttpResponse>(site.answer(request)); };
  for (int n = 0; n < GuessLimit::kBurst; ++n) EXPECT_EQ(answer().status, 401);
  EXPECT_EQ(answer().status, 429);
  const std::string head = site.head_of(answer(), request, false);
  EXPECT_NE(head.find("429 Too Many Requests\r\n"), std::string::npos);
  EXPECT_NE(head.find("Retry-After: 1\r\n"), std::string::npos);
  // the page itself holds no data and is served regardless
  request.target = "/";
  EXPECT_EQ(answer().status, 200);
}

}  // namespace
}  // namespace palpate::server
