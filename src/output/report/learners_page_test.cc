#include "palpate/report/learners_page.h"

#include <gtest/gtest.h>

#include <cmath>

namespace palpate {
namespace {

const double kNone = std::nan("");

LearnersPage::Run run_of(bool in_band, double value) {
  return {"2026-11-01T10:00:00Z", 60, in_band, {value}};
}

LearnersPage example() {
  LearnersPage page{"1.0", {}};
  LearnersPage::Task task{"Find <it>", "0123", 2, {{"force & more", "N", {}, 2.0, true}}, {}};
  task.learners = {{"L<1>", {run_of(false, 4), run_of(true, 1.5), run_of(true, 1)}},
                   {"L2", {run_of(true, 1), run_of(false, 3), run_of(true, kNone)}}};
  page.tasks.push_back(task);
  return page;
}

TEST(LearnersPage, MedianEndsWhereHalfOfTheLearnersEnd) {
  EXPECT_TRUE(median_curve({}).empty());
  EXPECT_TRUE(median_curve({{1, 2, 3}}).empty()) << "one learner is no cohort";
  EXPECT_EQ(median_curve({{1, 2, 3}, {3}}), (std::vector<double>{2}));
  EXPECT_EQ(median_curve({{1, 5, 3}, {3, 6}, {8, 7}}), (std::vector<double>{3, 6}));
  EXPECT_EQ(median_curve({{1, 2}, {2, kNone}, {3, 5}, {4}}), (std::vector<double>{2.5, 3.5}));
  const auto none = median_curve({{kNone, 1}, {kNone, 2}});
  ASSERT_EQ(none.size(), 2u);
  EXPECT_TRUE(std::isnan(none[0]));
  EXPECT_EQ(none[1], 1.5);
}

TEST(LearnersPage, PassedIsSoManyInARow) {
  const LearnersPage page = example();
  EXPECT_EQ(runs_until_passed(page.tasks[0].learners[0], 1), 2);
  EXPECT_EQ(runs_until_passed(page.tasks[0].learners[0], 2), 3);
  EXPECT_EQ(runs_until_passed(page.tasks[0].learners[1], 2), 0);
}

TEST(LearnersPage, ShowsEveryLearnerAndNothingAsMarkup) {
  const std::string html = learners_html(example());
  EXPECT_NE(html.find("Find &lt;it&gt;"), std::string::npos);
  EXPECT_NE(html.find("L&lt;1&gt;"), std::string::npos);
  EXPECT_NE(html.find("force &amp; more"), std::string::npos);
  EXPECT_EQ(html.find("<it>"), std::string::npos);
  EXPECT_EQ(html.find("L<1>"), std::string::npos);
  EXPECT_NE(html.find("passed</span>, run 3"), std::string::npos);
  EXPECT_NE(html.find("not yet"), std::string::npos);
  EXPECT_NE(html.find("at most 2.00 N"), std::string::npos);
  EXPECT_NE(html.find("median 2.50 N of first runs, 1.00 N of run 3"), std::string::npos);
  EXPECT_NE(html.find("not for clinical use"), std::string::npos);
  EXPECT_EQ(html.find("nan", html.find("<body>")), std::string::npos);
  EXPECT_NE(learners_html({"1.0", {}}).find("no such run"), std::string::npos);
}

TEST(LearnersPage, ALongCurveIsDrawnByPartOfItsRunsAndItsLast) {
  LearnersPage page = example();
  auto& runs = page.tasks[0].learners[0].runs;
  const std::size_t short_page = learners_html(page).size();
  runs.assign(100000, run_of(true, 1));
  runs.back() = run_of(false, 7);
  const std::string html = learners_html(page);
  EXPECT_LT(html.size(), short_page + 10000);
  // 7 is the highest, so the last point is 6 % of the range below the top
  EXPECT_NE(html.find("L312.0 "), std::string::npos);
}

// values whose range alone does not define an axis
TEST(LearnersPage, AnyValuesHaveAnAxis) {
  for (const double value : {0.0, 5.0, -5.0, 1e300, -1e300, 1e-300, kNone, HUGE_VAL}) {
    LearnersPage page = example();
    page.tasks[0].metrics[0].at_most.reset();
    page.tasks[0].learners = {{"one", {run_of(true, value)}}};
    const std::string html = learners_html(page);
    for (const char* odd : {"nan", "inf"})
      EXPECT_EQ(html.find(odd, html.find("<body>")), std::string::npos) << value;
  }
}

}  // namespace
}  // namespace palpate
