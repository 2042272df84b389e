#pragma once

#include <cstdint>
#include <string>
#include <vector>

/// HTML page about many cases, in the style of the report, with sorting, filtering and comparison.
namespace palpate {

/// Contents of the page.
struct CohortPage {
  struct Column {
    /// Structure to which the column belongs; the columns of a structure are shown when it is selected.
    /// Empty: always shown.
    std::string group;
    std::string title, unit;
    int decimals = 0;
  };
  struct Row {
    std::string name;   ///< Name of the case
    std::string state;  ///< "done", "failed", "not done"
    std::string fault;  ///< Reason of the failure
    std::vector<std::string> notes;
    std::vector<double> values;  ///< One per column; NaN: not available
    std::vector<std::uint8_t> picture_png;
  };
  std::string program;  ///< Version and commit
  std::vector<Column> columns;
  std::vector<Row> rows;
};

/// One self-contained page. It loads and runs nothing external; without scripts it is a static table.
std::string cohort_html(const CohortPage& page);

}  // namespace palpate
