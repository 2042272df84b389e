#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "palpate/volume/volume.h"

/// HTML page about the fitness of a segmentation for touch, in the style of the report.
namespace palpate {

struct LintPage {
  struct Structure {
    std::string name;
    Rgb colour;
    std::string grade;  ///< Grade: "A" ... "D"
    std::size_t voxels = 0;
    double volume_mm3 = 0;
    int faults = 0, warnings = 0, undecided = 0;
  };
  struct Finding {
    std::string title, severity;            ///< "Islands", "fault"
    std::string sentence, effect, remedy;   ///< Texts without full stops
    std::string position;                   ///< Position; empty: the finding has none
    std::vector<std::uint8_t> picture_png;  ///< PNG image; empty: none
  };
  struct Kind {
    std::string title, definition;
  };
  std::string program;  ///< Version and commit
  std::string grade;
  double tool_radius_mm = 0;
  std::vector<Structure> structures;
  std::vector<Finding> findings;
  std::vector<Kind> kinds;  ///< Kinds of finding that were checked
};

/// Generates the page, which is self-contained and loads and executes nothing.
std::string lint_html(const LintPage& page);

}  // namespace palpate
