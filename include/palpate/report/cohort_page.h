#pragma once

#include <cstdint>
#include <string>
#include <vector>

/// A page about many cases, in the style of the report, that sorts, filters and compares them.
namespace palpate {

struct CohortPage {
  struct Column {
    std::string
        group;  ///< a structure's name, whose columns are shown when it is chosen; empty: always shown
    std::string title, unit;
    int decimals = 0;
  };
  struct Row {
    std::string name;   ///< of the case
    std::string state;  ///< "done", "failed", "not done"
    std::string fault;  ///< why it failed
    std::vector<std::string> notes;
    std::vector<double> values;  ///< one for each column; NaN: not there
    std::vector<std::uint8_t> picture_png;
  };
  std::string program;  ///< version and commit
  std::vector<Column> columns;
  std::vector<Row> rows;
};

/// One self-contained page. Loads and runs nothing but what stands in it; without scripts it is a table.
std::string cohort_html(const CohortPage& page);

}  // namespace palpate
