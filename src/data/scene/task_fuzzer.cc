#include <cmath>
#include <cstdint>

#include "palpate/scene/task_file.h"

// any input gives a task that can be evaluated, or one error with its line
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto task = palpate::parse_task({reinterpret_cast<const char*>(data), size}, "task.toml");
  if (!task) {
    PALPATE_CHECK(!task.error().what.empty() && task.error().where.starts_with("task.toml"));
    return 0;
  }
  PALPATE_CHECK(!task->title.empty() && !task->metrics.empty() && task->in_a_row >= 1);
  for (const auto& step : task->steps) {
    const bool removes = step.kind == palpate::StepKind::kRemove;
    PALPATE_CHECK(step.region < (removes ? task->plan->regions.size() : task->regions.size()));
    PALPATE_CHECK(!step.name.empty() && (!step.seen || task->scope));
    PALPATE_CHECK(step.seconds >= 0 && step.force_N[0] < step.force_N[1]);
    PALPATE_CHECK(removes ||
                  task->regions[step.region].structures.empty() == (step.kind == palpate::StepKind::kVisit));
  }
  for (const auto& region : task->regions)
    PALPATE_CHECK(!region.structures.empty() || (region.point && region.radius_mm));
  for (const auto& metric : task->metrics)
    PALPATE_CHECK(!metric.at_least || !metric.at_most || *metric.at_least <= *metric.at_most);
  PALPATE_CHECK(palpate::drawn_data_set(*task, 7).empty() == task->data_set.empty());
  return 0;
}
