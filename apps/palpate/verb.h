#pragma once

#include <CLI/CLI.hpp>
#include <cstdio>
#include <string>

#include "apps/command/console.h"
#include "apps/command/options.h"

/// The verbs of palpate, one file each. Each function adds a subcommand to the application. If the command
/// line selects it, the callback stores in `run` the function that performs the work.
namespace palpate::app {

/// Prints a text on standard output. Returns kExitOk: a failed write is detected after the verb.
inline int print_result(const std::string& text) {
  std::fwrite(text.data(), 1, text.size(), stdout);
  return kExitOk;
}

void add_info(CLI::App& app, Run& run);
void add_cohort(CLI::App& app, Run& run);
void add_data(CLI::App& app, Run& run);
void add_cache(CLI::App& app, Run& run);
void add_scene(CLI::App& app, Run& run);
void add_prepare(CLI::App& app, Run& run);
void add_lint(CLI::App& app, Run& run);
void add_fit(CLI::App& app, Run& run);
void add_forces(CLI::App& app, Run& run);
void add_hold(CLI::App& app, Run& run);
void add_section(CLI::App& app, Run& run);
void add_render(CLI::App& app, Run& run);
void add_simulate(CLI::App& app, Run& run);
void add_explore(CLI::App& app, Run& run);
void add_devices(CLI::App& app, Run& run);
void add_doctor(CLI::App& app, Run& run);
void add_token(CLI::App& app, Run& run);
void add_export(CLI::App& app, Run& run);
void add_replay(CLI::App& app, Run& run);
void add_report(CLI::App& app, Run& run);
void add_register(CLI::App& app, Run& run);
void add_pivot(CLI::App& app, Run& run);
void add_plan(CLI::App& app, Run& run);
void add_records(CLI::App& app, Run& run);
void add_task(CLI::App& app, Run& run);

}  // namespace palpate::app
