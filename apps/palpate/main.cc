#include <sys/prctl.h>

#include <algorithm>
#include <string>
#include <string_view>
#include <vector>

#include "apps/command/environment.h"
#include "palpate/plugin/plugin_driver.h"
#include "palpate/supervisor/supervisor.h"
#include "verbs.h"

int main(int argc, char** argv) {
  // supervisor process, which `explore` starts
  if (argc > 1 && std::string_view(argv[1]) == "supervise")
    return palpate::supervise({argv + 2, argv + argc});
  // process of a plug-in, which a session starts
  if (argc > 1 && std::string_view(argv[1]) == "serve-plugin")
    return palpate::serve_plugin({argv + 2, argv + argc});
  palpate::app::sanitise_environment();
  palpate::app::keep_freed_memory();
  // disables core dumps, which would contain patient data
  ::prctl(PR_SET_DUMPABLE, 0, 0, 0, 0);
  const std::vector<std::string> arguments(argv + std::min(argc, 1), argv + argc);
  palpate::app::exec_companion(palpate::app::palpate_program(), arguments);
  return palpate::app::run(arguments, {});
}
