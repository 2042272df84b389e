#include <algorithm>
#include <string>
#include <vector>

#include "apps/command/environment.h"
#include "apps/command/program.h"
#include "verify.h"

// `palpate verify`: palpate replaces itself by this program through execv(), with the arguments after the
// verb
int main(int argc, char** argv) {
  palpate::app::sanitise_environment();
  palpate::app::keep_freed_memory();
  std::vector<std::string> arguments(argv + std::min(argc, 1), argv + argc);
  arguments.insert(arguments.begin(), "verify");
  const palpate::app::Program program{"", {palpate::app::add_verify}, {}, {}};
  return palpate::app::run(program, arguments, {});
}
