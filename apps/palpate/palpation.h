#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <optional>
#include <vector>

#include "palpate/loading/loading.h"
#include "palpate/palpation/palpation.h"
#include "verb.h"

/// What the verbs that feel or show a scene share.
namespace palpate::app {

inline constexpr const char* kTargetHelp =
    "A data set (palpate data list), a scene file, or a scan or label map by itself, a folder of DICOM too";

/// What the command line names: a data set, a scene file, or a volume, perhaps with its segmentation, for
/// which a scene is proposed; which one is noted.
Result<LoadedScene> load_target(const std::string& target, Console& console,
                                std::optional<PreparationMethod> preparation = {},
                                std::optional<int> volume = {},
                                const std::optional<std::filesystem::path>& labels = {});
/// The same, and an error where nothing in it can be felt.
Result<LoadedScene> load_felt_target(const std::string& target, Console& console,
                                     std::optional<PreparationMethod> preparation = {},
                                     std::optional<int> volume = {},
                                     const std::optional<std::filesystem::path>& labels = {});

/// The script of that file; without one, a script that suits the model.
Result<Script> script_of(const std::optional<std::filesystem::path>& file, const Model& model);

/// --method NAME, one of these.
void add_method_option(CLI::App& verb, const std::string& help, std::span<const ForceMethodInfo> methods,
                       std::optional<ForceMethod>& method);

/// --volume N, which volume where a DICOM file or a folder of them is given.
void add_volume_option(CLI::App& verb, std::optional<int>& volume);

/// --labels and --scan, of a volume by itself that may be either.
void add_content_options(CLI::App& verb);

/// --preparation NAME, instead of the scene's.
void add_preparation_option(CLI::App& verb, std::optional<PreparationMethod>& preparation);

/// On stdout, a line each: where the approaches touched.
void print_touches(const std::vector<TouchFigure>& touches);
/// What "held" is, for help texts.
std::string held_defined();
/// On stdout, a line each: how much of a structure is gone.
void print_removed(const std::vector<RemovedFigure>& removed);
/// @param cutter  cutter_name of the model
void print_protected(const std::vector<ProtectedFigure>& spared, const std::string& cutter);
/// A table on stdout: how each structure was held.
void print_holds(const std::vector<HoldFigure>& holds);

}  // namespace palpate::app
