#pragma once

#include <optional>
#include <string>
#include <vector>

/// A page for teachers: how learners got on, in the style of the report.
namespace palpate {

struct LearnersPage {
  struct Metric {
    std::string name, unit;                   ///< unit "1": none
    std::optional<double> at_least, at_most;  ///< of the latest run
    bool counts = false;
  };
  struct Run {
    std::string started_utc;
    double duration_s = 0;
    bool in_band = false;
    std::vector<double> values;  ///< one for each metric of the task; NaN: the run had none
  };
  struct Learner {
    std::string name;       ///< a pseudonym
    std::vector<Run> runs;  ///< in their order; at least one
  };
  /// One text of a task: of another text the bounds may be others, so its runs are other curves.
  struct Task {
    std::string title, hash;
    int in_a_row = 1;  ///< runs in band one after the other that pass
    std::vector<Metric> metrics;
    std::vector<Learner> learners;
  };
  std::string program;  ///< version and commit
  std::vector<Task> tasks;
};

/// The median over learners of their n-th runs, for every n that at least half of them, and two, came to;
/// of even numbers the mean of the two in the middle. Runs without a value are left out of their n.
/// @param curves  one for each learner
std::vector<double> median_curve(const std::vector<std::vector<double>>& curves);

/// After how many runs a learner had first been in band so many times in a row; 0: not yet.
int runs_until_passed(const LearnersPage::Learner& learner, int in_a_row);

/// One self-contained page. Loads and runs nothing.
std::string learners_html(const LearnersPage& page);

}  // namespace palpate
