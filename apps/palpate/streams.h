#pragma once

#include <cstdio>

namespace palpate::app {

/// The border at which text leaves the program: from here on whatever is written to stdout, stderr,
/// std::cout, std::cerr and std::clog, by whatever library, gets out as palpate/base/printable.h says.
void show_only_printable();

/// stderr without that, for the commands to the terminal that this program gives itself. What is shown by it
/// has to be printable already.
std::FILE* terminal();

}  // namespace palpate::app
