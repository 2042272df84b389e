#pragma once

#include <functional>
#include <string>
#include <vector>

namespace palpate::bench {

/// One way of doing the work that is compared.
struct Contender {
  std::string name;
  int threads = 1;
  std::function<void()> work;                  ///< what is timed; keeps its result
  std::function<std::vector<float>()> result;  ///< of the last work, in the unit of the reference
  std::function<void()> before = {};           ///< not timed: what warms the caches, say
};

struct Timing {
  std::string name;
  int threads = 1;
  double median_ms = 0, fastest_ms = 0, slowest_ms = 0;
  double cpu_ms = 0;          ///< median of the process's CPU time, all its threads: other load is not in it
  double ratio = 0;           ///< median over that of the first contender with as many threads
  double max_difference = 0;  ///< of its result from the reference
  double mean_difference = 0;
};

/// Compares every contender's result with the reference, then times everybody once in every round, so
/// that whatever else the machine does meets all of them alike.
std::vector<Timing> run_interleaved(const std::vector<Contender>& contenders,
                                    const std::vector<float>& reference, int rounds);

void print_table(const std::string& title, const std::vector<Timing>& timings);

}  // namespace palpate::bench
