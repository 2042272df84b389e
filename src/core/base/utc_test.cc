#include "palpate/base/utc.h"

#include <gtest/gtest.h>

#include <limits>

namespace palpate {
namespace {

TEST(Utc, LaterTimesCarryIntoTheNextDayMonthAndYear) {
  EXPECT_EQ(utc_after("2026-03-01T12:34:56Z", 0), "2026-03-01T12:34:56Z");
  EXPECT_EQ(utc_after("2026-03-01T12:34:56Z", 3.99), "2026-03-01T12:34:59Z");
  EXPECT_EQ(utc_after("2024-02-28T23:59:30Z", 90), "2024-02-29T00:01:00Z");
  EXPECT_EQ(utc_after("2026-12-31T23:59:59Z", 1), "2027-01-01T00:00:00Z");
}

TEST(Utc, InvalidTimesAreReturnedUnchanged) {
  for (const std::string text : {"", "yesterday", "2026-03-01T12:34:56Z and more", "2026-13-01T12:34:56Z"})
    EXPECT_EQ(utc_after(text, 5), text);
  for (const double after_s : {-1.0, std::numeric_limits<double>::quiet_NaN(), 1e300})
    EXPECT_EQ(utc_after("2026-03-01T12:34:56Z", after_s), "2026-03-01T12:34:56Z");
}

TEST(Utc, NowIsParseable) {
  EXPECT_GT(utc_after(utc_now(), 10), utc_now());
}

}  // namespace
}  // namespace palpate
