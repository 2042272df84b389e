#include "server/download_rate_limiter.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <deque>
#include <string>
#include <vector>

#include "server/test_client.h"
#include "server/test_host.h"

namespace palpate::server {
namespace {

using namespace std::chrono_literals;
using palpate::testing::read_answer;
using palpate::testing::request;
using palpate::testing::TestServer;
using palpate::testing::TestSocket;
using palpate::testing::TestViewer;
using Clock = DownloadRateLimiter::Clock;

constexpr std::size_t kBurst_bytes = 20'000'000;

/// Sends a download as fast as permitted. @return time of completion
Clock::time_point send(DownloadRateLimiter& pace, std::size_t bytes, Clock::time_point now,
                       bool alone = false) {
  while (bytes > 0) {
    const auto turn = pace.next(bytes, alone, now);
    EXPECT_GE(turn.bytes, 1u);
    EXPECT_LE(turn.bytes, bytes);
    bytes -= turn.bytes;
    now = std::max(now, turn.not_before);
  }
  return now;
}

TEST(DownloadRateLimiter, SingleViewerIsNotLimited) {
  const Clock::time_point begin{};
  DownloadRateLimiter pace(kBurst_bytes, begin);
  EXPECT_EQ(pace.next(kBurst_bytes, false, begin).bytes, DownloadRateLimiter::kLargePart_bytes);
  EXPECT_EQ(send(pace, kBurst_bytes - DownloadRateLimiter::kLargePart_bytes, begin), begin);
  // and again, after the time in which the rate alone would have sent as much
  const auto later = begin + 3s;
  EXPECT_EQ(send(pace, kBurst_bytes, later), later);
  // the credit is bounded, however long the pause
  const auto much_later = begin + 1h;
  EXPECT_EQ(send(pace, kBurst_bytes, much_later), much_later);
  EXPECT_GT(send(pace, 1'000'000, much_later), much_later);
}

TEST(DownloadRateLimiter, ExcessIsSentInSmallChunksAtTheLimitedRate) {
  const Clock::time_point begin{};
  DownloadRateLimiter pace(kBurst_bytes, begin);
  send(pace, kBurst_bytes, begin);
  // a single download that is always ready
  Clock::time_point now = begin;
  double sent_bytes = 0;
  for (int n = 0; n < 10000; ++n) {
    const auto turn = pace.next(1 << 30, false, now);
    EXPECT_EQ(turn.bytes, DownloadRateLimiter::kSmallPart_bytes);
    sent_bytes += static_cast<double>(turn.bytes);
    EXPECT_GT(turn.not_before, now);
    now = turn.not_before;
  }
  const double s = std::chrono::duration<double>(now - begin).count();
  EXPECT_NEAR(sent_bytes / s / DownloadRateLimiter::kLimitedRate_bytes_per_s, 1, 1e-6);
}

TEST(DownloadRateLimiter, OneViewerAloneNeverWaits) {
  const Clock::time_point begin{};
  DownloadRateLimiter pace(kBurst_bytes, begin);
  EXPECT_EQ(send(pace, 100 * kBurst_bytes, begin, true), begin);
  // the next download is limited from the start, but does not pay for the previous one
  const auto turn = pace.next(1 << 30, false, begin);
  EXPECT_EQ(turn.bytes, DownloadRateLimiter::kSmallPart_bytes);
  EXPECT_LE(turn.not_before, begin + 10ms);
  // alone again, and not delayed by what was sent at the limited rate
  send(pace, kBurst_bytes, begin);
  EXPECT_EQ(send(pace, kBurst_bytes, begin, true), begin);
}

// the next part of each download waits at most one round, so none overtakes
TEST(DownloadRateLimiter, EachOfManyGetsItsShare) {
  struct Download {
    Clock::time_point at;
    std::size_t waits = 0, sent = 0;
  };
  Clock::time_point now{};
  DownloadRateLimiter pace(kBurst_bytes, now);
  send(pace, kBurst_bytes, now);
  std::vector<Download> downloads(64);
  const auto wants = [&](Download& download) {
    const auto turn = pace.next(1 << 30, false, now);
    download.at = turn.not_before;
    download.waits = turn.bytes;
  };
  for (Download& download : downloads) wants(download);
  for (int n = 0; n < 6400; ++n) {
    Download& next = *std::min_element(downloads.begin(), downloads.end(),
                                       [](const auto& a, const auto& b) { return a.at < b.at; });
    now = next.at;
    next.sent += next.waits;
    wants(next);
  }
  for (const Download& download : downloads)
    EXPECT_EQ(download.sent, 100 * DownloadRateLimiter::kSmallPart_bytes);
}

constexpr std::array<int, 3> kDims{256, 256, 64};
constexpr double kScan_bytes = 2.0 * kDims[0] * kDims[1] * kDims[2];

/// Downloads the scan `times` times in sequence. @return duration in s
double load(TestServer& test, int times) {
  const auto begun = Clock::now();
  for (int n = 0; n < times; ++n) {
    const auto answer = request(test.port(), "GET", "/api/volume/scan/0f3a000000000001");
    EXPECT_EQ(static_cast<double>(answer.body.size()), kScan_bytes);
  }
  return std::chrono::duration<double>(Clock::now() - begun).count();
}

/// Minimum duration of `loads` downloads at the limited rate, with scan and labels in the burst; s.
double at_the_rate_s(int loads) {
  return (loads - 1.5) * kScan_bytes / DownloadRateLimiter::kLimitedRate_bytes_per_s;
}

// a lower bound on time, so a slow machine cannot break it
TEST(DownloadRateLimiter, ServerLimitsSeveralViewers) {
  TestServer test({}, kDims);
  TestViewer one(test.port()), other(test.port());
  ASSERT_EQ(one.greet()["type"], "welcome");
  ASSERT_EQ(other.greet()["type"], "welcome");
  EXPECT_GE(load(test, 3), at_the_rate_s(3));
}

TEST(DownloadRateLimiter, LimitAppliesToDownloadersThatAreNoViewers) {
  TestServer test({}, kDims);
  // each has begun and reads no further
  constexpr int kReceiveBuffer_bytes = 4096;
  std::deque<TestSocket> slow;
  for (int n = 0; n < 2; ++n) {
    TestSocket& socket = slow.emplace_back(test.port(), false, kReceiveBuffer_bytes);
    socket.send("GET /api/volume/scan/0f3a000000000001 HTTP/1.1\r\nHost: " + test.host_name() + "\r\n\r\n");
    socket.take_until("\r\n\r\n");
    ASSERT_EQ(socket.take(1).size(), 1u);
  }
  EXPECT_GE(load(test, 3), at_the_rate_s(3));
}

// many times faster than the limited rate, so that a slow machine is distinguishable from the limit
TEST(DownloadRateLimiter, AServerDoesNotHoldUpOneViewerAlone) {
  TestServer test({}, kDims);
  TestViewer viewer(test.port());
  ASSERT_EQ(viewer.greet()["type"], "welcome");
  EXPECT_LT(load(test, 50), at_the_rate_s(50));
}

// several downloads on one connection; the last bytes of each are exact
TEST(DownloadRateLimiter, PartsComeInOrder) {
  constexpr std::array<int, 3> kOdd{128, 128, 63};
  TestServer test({}, kOdd);
  TestSocket socket(test.port());
  std::string first;
  for (int n = 0; n < 4; ++n) {
    socket.send("GET /api/volume/scan/0f3a000000000001 HTTP/1.1\r\nHost: " + test.host_name() + "\r\n\r\n");
    const auto answer = read_answer(socket);
    ASSERT_EQ(answer.status, 200);
    ASSERT_EQ(answer.body.size(), 2u * kOdd[0] * kOdd[1] * kOdd[2]);
    if (n == 0) first = answer.body;
    EXPECT_TRUE(answer.body == first);
  }
  const auto scan = test.host.scene().scan;
  for (std::size_t v = 0; v < scan->voxels().size(); v += 997)
    ASSERT_EQ(palpate::testing::number_at<std::int16_t>(first, 2 * v), static_cast<int>(scan->voxels()[v]))
        << v;
}

}  // namespace
}  // namespace palpate::server
