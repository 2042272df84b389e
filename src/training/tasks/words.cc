#include <cmath>
#include <cstdio>

#include "palpate/tasks/evaluator.h"

namespace palpate {
namespace {

constexpr std::size_t kMaxNamed = 3;  // maximum number of names in an event text

std::string short_number(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.4g", value);
  return text;
}

std::string names_of_structures(const std::vector<LabelReference>& structures, std::size_t max_count = 1000) {
  std::string text;
  for (std::size_t n = 0; n < structures.size() && n < max_count; ++n) {
    const auto* number = std::get_if<int>(&structures[n]);
    text += (n == 0 ? "" : ", ") +
            (number ? "#" + std::to_string(*number) : std::get<std::string>(structures[n]));
  }
  if (structures.size() > max_count) text += " or " + std::to_string(structures.size() - max_count) + " more";
  return text;
}

}  // namespace

const char* kind_name(TaskEvent::Kind kind) {
  switch (kind) {
    case TaskEvent::Kind::kStepDone:
      return "step_done";
    case TaskEvent::Kind::kOverLimit:
      return "over_limit";
    case TaskEvent::Kind::kProtected:
      return "protected";
    case TaskEvent::Kind::kUnseen:
      return "unseen";
    case TaskEvent::Kind::kEnded:
      return "ended";
  }
  return "";
}

std::string metric_text(Metric metric, double value) {
  if (std::isnan(value)) return "none";
  const std::string_view unit = info_of(metric).unit;
  return short_number(value) + (unit == "1" ? "" : " " + std::string(unit));
}

std::string bounds_text(const TaskMetric& metric) {
  if (metric.at_least && metric.at_most)
    return short_number(*metric.at_least) + " ... " + short_number(*metric.at_most);
  if (metric.at_least) return "at least " + short_number(*metric.at_least);
  if (metric.at_most) return "at most " + short_number(*metric.at_most);
  return "";
}

std::string metric_name(const TaskMetric& metric) {
  std::string name(info_of(metric.metric).name);
  if (!metric.structures.empty()) name += " of " + names_of_structures(metric.structures);
  return name;
}

std::string event_text(const TaskFile& task, const TaskEvent& event) {
  switch (event.kind) {
    case TaskEvent::Kind::kStepDone:
      return "done: " + task.steps[event.part].name;
    case TaskEvent::Kind::kOverLimit:
      return short_number(event.force_N) + " N on " +
             names_of_structures(task.forces[event.part].structures, kMaxNamed) + ", above " +
             short_number(*task.forces[event.part].limit_N) + " N";
    case TaskEvent::Kind::kProtected:
      return "touched " + names_of_structures(task.protections[event.part].structures, kMaxNamed) + " with " +
             short_number(event.force_N) + " N, which is protected";
    case TaskEvent::Kind::kUnseen:
      return "touched outside the scope's view, with " + short_number(event.force_N) + " N";
    case TaskEvent::Kind::kEnded:
      return "the task was over";
  }
  return "";
}

}  // namespace palpate
