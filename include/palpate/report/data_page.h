#pragma once

#include <cstdint>
#include <string>
#include <vector>

/// HTML page about data sets, in the style of the report, with a picture of each volume.
namespace palpate {

/// Contents of the page.
struct DataPage {
  struct Set {
    std::string name, summary, licence;
    std::string state;                      ///< Location if installed, otherwise how to obtain it
    std::string fault;                      ///< Reason why a picture could not be made
    std::vector<std::uint8_t> picture_png;  ///< PNG of the volume; empty: none
  };
  std::string program;  ///< Version and commit
  std::vector<Set> sets;
};

/// One self-contained page without scripts; it loads nothing external.
std::string data_html(const DataPage& page);

}  // namespace palpate
