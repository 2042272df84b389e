#pragma once

#include <string>
#include <vector>

#include "apps/command/program.h"
#include "apps/command/streams.h"

/// The program palpate as a library.
namespace palpate::app {

const Program& palpate_program();

/// Runs a command line of palpate in this process; see run(const Program&, ...). `verify` fails because it
/// is a program of its own. `explore`, `cohort` and `hold --device` start the executable of this process,
/// which must be palpate.
int run(const std::vector<std::string>& arguments, const Streams& streams);

}  // namespace palpate::app
