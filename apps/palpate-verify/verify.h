#pragma once

#include "apps/command/console.h"

namespace CLI {
class App;
}

namespace palpate::app {

void add_verify(CLI::App& app, Run& run);

}  // namespace palpate::app
