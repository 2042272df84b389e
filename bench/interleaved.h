#pragma once

#include <functional>
#include <string>
#include <vector>

namespace palpate::bench {

/// One of the implementations that are compared.
struct Contender {
  std::string name;
  int threads = 1;
  std::function<void()> work;                  ///< Timed; keeps its result
  std::function<std::vector<float>()> result;  ///< Result of the last work, in the unit of the reference
  std::function<void()> before = {};           ///< Not timed, e.g. to warm up caches
};

struct Timing {
  std::string name;
  int threads = 1;
  double median_ms = 0, fastest_ms = 0, slowest_ms = 0;
  /// Median CPU time of the process with all its threads; unaffected by other load
  double cpu_ms = 0;
  double ratio = 0;           ///< Median relative to that of the first contender with as many threads
  double max_difference = 0;  ///< Maximum difference of its result from the reference
  double mean_difference = 0;
};

/// Compares every contender's result with the reference, then times all of them once per round, so that other
/// load on the machine affects all alike.
std::vector<Timing> run_interleaved(const std::vector<Contender>& contenders,
                                    const std::vector<float>& reference, int rounds);

void print_table(const std::string& title, const std::vector<Timing>& timings);

}  // namespace palpate::bench
