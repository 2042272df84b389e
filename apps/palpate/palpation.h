#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <optional>
#include <vector>

#include "palpate/session.h"

/// What simulate and explore share.
namespace palpate::app {

/// The script of that file; without one, a script that suits the model.
Result<Script> script_of(const std::optional<std::filesystem::path>& file, const Model& model);

/// --method NAME, one of these.
void add_method_option(CLI::App& verb, const std::string& help, std::span<const ForceMethodInfo> methods,
                       std::optional<ForceMethod>& method);

/// --preparation NAME, instead of the scene's.
void add_preparation_option(CLI::App& verb, std::optional<PreparationMethod>& preparation);

/// A table on stdout: how each structure was held.
void print_holds(const std::vector<HoldFigure>& holds);

}  // namespace palpate::app
