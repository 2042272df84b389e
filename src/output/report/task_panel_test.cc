#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "palpate/report/report.h"
#include "report/html.h"
#include "report/page_sections.h"
#include "report/test_example_run.h"

namespace palpate::report {
namespace {

using ::testing::HasSubstr;

TEST(TaskPanel, ShowsEveryFigureOfTheScore) {
  const auto task = parse_task(R"(title = "Touch <it>"
end = "recording"
[[region]]
name = "patella"
structures = ["patella"]
[[step]]
name = "press & hold"
region = "patella"
seconds = 0.1
[[step]]
name = "press for an hour"
region = "patella"
seconds = 600
[[force]]
structures = ["patella"]
limit = 0.1
[[metric]]
name = "peak_force"
at_most = 0.05
basis = "nobody <yet>"
[[metric]]
name = "steps_done"
at_least = 0.5
[[metric]]
name = "path_length"
)",
                               "task.toml");
  ASSERT_TRUE(task) << task.error().message();
  TaskScore score;
  score.metrics = {{Metric::kPeakForce, 0, 0.5, true, false},
                   {Metric::kStepsDone, 1, 0.5, true, true},
                   {Metric::kPathLength, 2, kNoValue, false, true}};
  score.done = {true, false};
  score.events = {{TaskEvent::Kind::kOverLimit, 0, 1234, 1.2345, 0.5}};
  score.more_events = 7;
  const ScoredTask scored{*task, score};
  const std::string html = task_html(scored);
  EXPECT_THAT(html, HasSubstr("Task: Touch &lt;it&gt;"));
  EXPECT_THAT(html, HasSubstr(cell("0.5 N") + cell("at most 0.05") + cell("<strong>out of band</strong>") +
                              "<td>nobody &lt;yet&gt;</td>"));
  EXPECT_THAT(html,
              HasSubstr(cell("0.5") + cell("at least 0.5") + cell("in band") + "<td>not validated</td>"));
  EXPECT_THAT(html, HasSubstr(cell("none") + cell("") + cell("") + "<td></td>"));
  EXPECT_THAT(html, HasSubstr("press &amp; hold: done"));
  EXPECT_THAT(html, HasSubstr("press for an hour: <strong>not done</strong>"));
  EXPECT_THAT(html, HasSubstr("1.234 s, tick 1234: 0.5 N on patella, above 0.1 N"));
  EXPECT_THAT(html, HasSubstr("and 7 more"));
  EXPECT_THAT(html, HasSubstr("Not every counted metric"));
  // a truncated run is reported as such
  score.cut_short = true;
  EXPECT_THAT(task_html(scored), HasSubstr("the recording was cut short"));

  // the page includes the part if it is given
  const Model model = example::model();
  const Recording run = example::recording(model);
  EXPECT_TRUE(report_html(run, model, {}, {.scored = &scored})->find(task_html(scored)) != std::string::npos);
  EXPECT_TRUE(report_html(run, model)->find("task-title") == std::string::npos);
}

}  // namespace
}  // namespace palpate::report
