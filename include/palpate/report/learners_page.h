#pragma once

#include <optional>
#include <string>
#include <vector>

/// HTML page for teachers about the progress of learners, in the style of the report.
namespace palpate {

/// Contents of the page.
struct LearnersPage {
  struct Metric {
    std::string name, unit;                   ///< Unit "1": dimensionless
    std::optional<double> at_least, at_most;  ///< Band of the latest run
    bool counts = false;
  };
  struct Run {
    std::string started_utc;
    double duration_s = 0;
    bool in_band = false;
    std::vector<double> values;  ///< One per metric of the task; NaN: not available
  };
  struct Learner {
    std::string name;       ///< Pseudonym
    std::vector<Run> runs;  ///< In chronological order; at least one
  };
  /// One version of a task's text. Another version may have other bands, so its runs are separate curves.
  struct Task {
    std::string title, hash;
    int in_a_row = 1;  ///< Consecutive runs in band that make a pass
    std::vector<Metric> metrics;
    std::vector<Learner> learners;
  };
  std::string program;  ///< Version and commit
  std::vector<Task> tasks;
};

/// Median learning curve: for each n, the median over learners of the value of their n-th run, up to the last
/// n that at least half of the learners, and at least two, reached. For an even number it is the mean of the
/// middle two. Runs without a value are omitted.
/// @param curves  one per learner
std::vector<double> median_curve(const std::vector<std::vector<double>>& curves);

/// Number of runs after which a learner first had `in_a_row` consecutive runs in band; 0: not yet.
int runs_until_passed(const LearnersPage::Learner& learner, int in_a_row);

/// One self-contained page without scripts; it loads nothing external.
std::string learners_html(const LearnersPage& page);

}  // namespace palpate
