#include <gtest/gtest.h>

#include <limits>
#include <vector>

#include "palpate/base/progress_lines.h"

namespace palpate {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr ProgressLines::Time kStarted{};

TEST(ProgressLines, ShortTasksPrintNothing) {
  ProgressLines lines(kStarted);
  for (int ms = 0; ms < 2000; ms += 10)
    EXPECT_FALSE(lines.line(ms < 1000 ? "reading" : "smoothing", ms / 2000.0, kStarted + milliseconds(ms)));
}

TEST(ProgressLines, StagePrintsOnceThenEveryTenSeconds) {
  ProgressLines lines(kStarted);
  std::vector<std::string> reported;
  std::vector<int> when_s;
  // 20 reports a second of one stage that takes 35 s, then another
  for (int n = 0; n < 20 * 40; ++n) {
    const bool first = n < 20 * 35;
    const auto line =
        lines.line(first ? "smoothing" : "writing", first ? n / 700.0 : 0, kStarted + milliseconds(50 * n));
    if (!line) continue;
    reported.push_back(*line);
    when_s.push_back(n / 20);
  }
  EXPECT_EQ(reported, (std::vector<std::string>{"smoothing 5 %", "smoothing 34 %", "smoothing 62 %",
                                                "smoothing 91 %", "writing 0 %"}));
  EXPECT_EQ(when_s, (std::vector<int>{2, 12, 22, 32, 35}));
}

TEST(ProgressLines, RapidStagesAreRateLimited) {
  ProgressLines lines(kStarted);
  int reported = 0;
  for (int n = 0; n < 1000; ++n)
    reported += lines.line("structure " + std::to_string(n), 0, kStarted + milliseconds(10 * n)).has_value();
  EXPECT_EQ(reported, 4) << "in ten seconds";
}

TEST(ProgressLines, CompletionPrintsNothingAndInvalidFractionIsZero) {
  ProgressLines lines(kStarted);
  EXPECT_FALSE(lines.line("reading", 1, kStarted + seconds(60)));
  EXPECT_EQ(lines.line("reading", std::numeric_limits<double>::quiet_NaN(), kStarted + seconds(60)),
            "reading 0 %");
  EXPECT_EQ(lines.line("writing", -3, kStarted + seconds(70)), "writing 0 %");
}

}  // namespace
}  // namespace palpate
