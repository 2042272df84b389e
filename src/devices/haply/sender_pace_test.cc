#include "haply/sender_pace.h"

#include <gtest/gtest.h>

namespace palpate::haply {
namespace {

constexpr std::int64_t kMillisecond_ns = 1'000'000;

/// A pace that is observed every millisecond.
class ObservedPace {
 public:
  /// @param count  number of unsolicited states per millisecond
  void observe(int count, int duration_ms) {
    for (int n = 0; n < duration_ms; ++n) pace_.observe(count, now_ns_ += kMillisecond_ns);
  }
  void stall(int duration_ms) { now_ns_ += duration_ms * kMillisecond_ns; }
  bool may_be_queued() const { return pace_.may_be_queued(); }

 private:
  std::int64_t now_ns_ = 0;
  SenderPace pace_{0};
};

TEST(SenderPace, StatesAreCurrentIfNoneIsUnsolicited) {
  ObservedPace pace;
  for (int n = 0; n < 100; ++n) {
    pace.observe(0, 10);
    ASSERT_FALSE(pace.may_be_queued()) << n;
  }
}

TEST(SenderPace, AfterAStallStatesMayBeQueuedUntilAWindowIsQuiet) {
  ObservedPace pace;
  pace.observe(0, 100);
  pace.stall(50);
  pace.observe(0, 1);
  EXPECT_TRUE(pace.may_be_queued());
  pace.observe(0, 10);
  EXPECT_TRUE(pace.may_be_queued()) << "the window has not ended";
  pace.observe(0, 30);
  EXPECT_FALSE(pace.may_be_queued());
}

TEST(SenderPace, ASustainedPaceBecomesTheKnownOne) {
  ObservedPace pace;
  pace.observe(10, 1);
  EXPECT_TRUE(pace.may_be_queued());
  pace.observe(10, 100);
  EXPECT_TRUE(pace.may_be_queued()) << "not sustained yet";
  pace.observe(10, 1000);
  EXPECT_FALSE(pace.may_be_queued());
  // a burst beyond it
  pace.observe(100, 2);
  EXPECT_TRUE(pace.may_be_queued());
}

}  // namespace
}  // namespace palpate::haply
