#pragma once

#include <cstdint>
#include <string>
#include <vector>

/// A page about data sets, in the style of the report: each with a picture of its volume.
namespace palpate {

struct DataPage {
  struct Set {
    std::string name, summary, licence;
    std::string state;                      ///< where it is, or how it is had
    std::string fault;                      ///< why there is no picture, where there should be one
    std::vector<std::uint8_t> picture_png;  ///< empty: none
  };
  std::string program;  ///< version and commit
  std::vector<Set> sets;
};

/// One self-contained page. Loads and runs nothing.
std::string data_html(const DataPage& page);

}  // namespace palpate
