#include "session/arming_code.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

namespace palpate {
namespace {

class ArmingCodes : public ::testing::Test {
 protected:
  // a different six-digit code
  static std::string wrong(std::string code) {
    code[0] = code[0] == '9' ? '0' : static_cast<char>(code[0] + 1);
    return code;
  }
  ArmingCode code_;
  ArmingCode::Clock::time_point now_{std::chrono::seconds(1000)};
};

TEST_F(ArmingCodes, AreSixDigitsThatAreGoodOnce) {
  EXPECT_FALSE(code_.redeem(1, "", now_)) << "none was shown";
  const std::string shown = code_.code_for(1, now_);
  ASSERT_EQ(shown.size(), 6u);
  EXPECT_TRUE(std::ranges::all_of(shown, [](char c) { return c >= '0' && c <= '9'; }));
  EXPECT_EQ(code_.code_for(1, now_), shown) << "the same until it is used";
  EXPECT_FALSE(code_.redeem(1, shown.substr(0, 5), now_));
  EXPECT_TRUE(code_.redeem(1, shown, now_));
  EXPECT_FALSE(code_.redeem(1, shown, now_)) << "used up";
  EXPECT_NE(code_.code_for(1, now_), shown);
}

TEST_F(ArmingCodes, AreOfOneStopAndOfOneMinute) {
  const std::string shown = code_.code_for(1, now_);
  EXPECT_FALSE(code_.redeem(2, shown, now_));
  const std::string next = code_.code_for(2, now_);
  EXPECT_NE(next, shown);
  EXPECT_FALSE(code_.redeem(2, next, now_ + ArmingCode::kValidity));
  EXPECT_NE(code_.code_for(2, now_ + ArmingCode::kValidity), next);
}

TEST_F(ArmingCodes, GuessesAreLimitedAcrossCodes) {
  for (int n = 0; n < ArmingCode::kMaxWrongGuesses; ++n)
    EXPECT_FALSE(code_.redeem(1, wrong(code_.code_for(1, now_)), now_));
  EXPECT_EQ(code_.code_for(1, now_), "");
  EXPECT_FALSE(code_.redeem(1, "", now_));
  now_ += ArmingCode::kLockout;
  // another stop between two guesses does not grant additional ones
  EXPECT_FALSE(code_.redeem(1, wrong(code_.code_for(1, now_)), now_));
  EXPECT_FALSE(code_.redeem(2, wrong(code_.code_for(2, now_)), now_));
  EXPECT_FALSE(code_.redeem(3, wrong(code_.code_for(3, now_)), now_));
  EXPECT_EQ(code_.code_for(3, now_), "");
  now_ += ArmingCode::kLockout;
  EXPECT_TRUE(code_.redeem(3, code_.code_for(3, now_), now_));
}

TEST_F(ArmingCodes, AreSpreadOverAllThereAre) {
  std::set<std::string> visited;
  for (std::uint32_t stop = 0; stop < 1000; ++stop) visited.insert(code_.code_for(stop, now_));
  // a thousand out of a million: occasional collisions are expected
  EXPECT_GT(visited.size(), 980u);
  for (char digit = '0'; digit <= '9'; ++digit)
    EXPECT_TRUE(std::ranges::any_of(visited, [&](const std::string& code) { return code[0] == digit; }))
        << digit;
}

}  // namespace
}  // namespace palpate
