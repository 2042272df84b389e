#include "server/fault_log.h"

#include <gtest/gtest.h>

#include <vector>

#include "server/token_bucket.h"

namespace palpate::server {
namespace {

using namespace std::chrono_literals;

TEST(FaultLog, AFloodIsCounted) {
  std::vector<std::string> lines;
  FaultLog log([&](const std::string& line) { lines.push_back(line); });
  const auto begin = FaultLog::Clock::now();
  for (int n = 0; n < 1000; ++n) log.add("10.0.0.1", "a malformed request", begin + n * 100us);
  EXPECT_EQ(lines.size(), static_cast<std::size_t>(FaultLog::kLinesEachSecond));
  EXPECT_EQ(lines.front(), "viewer 10.0.0.1: a malformed request");
  log.catch_up(begin + 500ms);
  EXPECT_EQ(lines.size(), static_cast<std::size_t>(FaultLog::kLinesEachSecond));
  log.catch_up(begin + 1001ms);
  EXPECT_EQ(lines.back(), "viewers: 990 more faults");
  log.add("10.0.0.1", "no hello", begin + 2s);
  EXPECT_EQ(lines.back(), "viewer 10.0.0.1: no hello");
}

TEST(FaultLog, WorksWithoutListener) {
  FaultLog log({});
  log.add("10.0.0.1", "no hello");
  log.catch_up();
}

TEST(TokenBucket, HoldsARate) {
  auto now = TokenBucket::Clock::now();
  TokenBucket bucket(250, 250, now);
  // ten seconds at the sustained rate
  for (int n = 0; n < 2500; ++n, now += 4ms) ASSERT_TRUE(bucket.take(now)) << n;
  int used = 0;
  while (used < 1000 && bucket.take(now)) ++used;
  EXPECT_GE(used, 248);
  EXPECT_LE(used, 252);
}

}  // namespace
}  // namespace palpate::server
