#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "palpate/report/report.h"
#include "report/html.h"
#include "report/page_sections.h"
#include "report/test_example_run.h"

namespace palpate::report {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

TEST(PlanPanel, ShowsEveryFigureOfTheComparison) {
  const Model model = example::model();
  const Recording run = example::recording(model);
  const PlanInScene plan = example::plan(model);
  const auto distances = structure_distances(model);
  ASSERT_TRUE(distances) << distances.error().message();
  const auto made = compare_recording(plan, model, *distances, run);
  ASSERT_TRUE(made) << made.error().message();
  const RehearsedPlan rehearsed{plan, *made};
  const auto html = report_html(run, model, {}, {.rehearsed = &rehearsed});
  ASSERT_TRUE(html) << html.error().message();
  EXPECT_THAT(*html, HasSubstr("Plan and result"));
  EXPECT_THAT(*html, HasSubstr("A &lt;plan&gt;"));
  EXPECT_THAT(*html, HasSubstr("<h3>way &amp; target</h3>"));
  const TrajectoryResult& done = made->trajectories[0];
  EXPECT_EQ(done.entry_kind, EntryKind::kPassed);
  EXPECT_FALSE(done.is_within_limit());  // a millimetre off
  EXPECT_THAT(*html, HasSubstr(cell(number(done.entry_error_mm.value, 2)) +
                               cell("at most 0.50, <strong>not kept</strong>")));
  EXPECT_THAT(*html, HasSubstr(cell(number(done.target_error_mm.value, 2))));
  EXPECT_THAT(*html, HasSubstr(number(done.depth_mm, 2) + " mm deep, planned 5.00 mm"));
  EXPECT_THAT(*html, HasSubstr(cell(number(made->regions[0].planned_mm3, 1)) + cell("0.0")));
  EXPECT_GT(made->regions[0].planned_mm3, 10);
  EXPECT_FALSE(made->violations.empty());
  for (const StructureClearance& approach : made->approaches)
    EXPECT_THAT(*html, HasSubstr(cell(number(approach.nearest_mm, 2))));
  for (const ClearanceViolation& violation : made->violations)
    EXPECT_THAT(*html, HasSubstr(cell(std::to_string(violation.begin.tick) + " to " +
                                      std::to_string(violation.last_tick))));
  // two sections with the trajectory drawn
  std::size_t lines = 0;
  for (std::size_t at = html->find("class=\"planned\" x1"); at != std::string::npos;
       at = html->find("class=\"planned\" x1", at + 1))
    ++lines;
  EXPECT_EQ(lines, 4u);
  EXPECT_THAT(*html, HasSubstr("\"clearance\":[["));

  const auto without = report_html(run, model);
  ASSERT_TRUE(without);
  EXPECT_THAT(*without, Not(HasSubstr("Plan and result")));
  EXPECT_THAT(*without, Not(HasSubstr("\"clearance\":")));
}

TEST(PlanPanel, PlotsDistancesOnItsOwnTimes) {
  PlanComparison made;
  made.times_s = {0, 1, 2};
  made.approaches.resize(3);
  made.approaches[0].nearest_mm = 5;
  made.approaches[1].nearest_mm = 9;
  made.approaches[1].requested_mm = 1;
  made.approaches[2].nearest_mm = 2;
  made.approaches[2].over_time_mm = {7, 3, 2};
  // structures with a required clearance first, then by distance
  EXPECT_THAT(plotted_clearances(made), ::testing::ElementsAre(1, 2, 0));
  EXPECT_THAT(clearance_at(made, 2, 100, {100, 100.9, 101, 101.5, 104}),
              ::testing::ElementsAre(7, 7, 3, 3, 2));
}

}  // namespace
}  // namespace palpate::report
