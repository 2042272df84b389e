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

inline constexpr const char* kMadeWithHelp =
    "Scene file, volume or data set that the recording was made with; not needed for data sets";

/// Loads a source as load_scene_or_data_set() does; what the scene was proposed from, where the labels lie
/// and where their names are from is noted.
Result<LoadedScene> load_target(const SceneSource& source, Console& console,
                                std::optional<PreparationMethod> preparation = {},
                                const MemoryCallback& report_memory = {});
/// The same, and an error where nothing in it can be felt.
Result<LoadedScene> load_felt_target(const SceneSource& source, Console& console,
                                     std::optional<PreparationMethod> preparation = {},
                                     const MemoryCallback& report_memory = {});

/// The script of that file; none without one, for which a run plans the default script.
Result<std::optional<Script>> script_of(const std::optional<std::filesystem::path>& file);

/// --method NAME, one of these.
void add_method_option(CLI::App& verb, const std::string& help, std::span<const ForceMethodInfo> methods,
                       std::optional<ForceMethod>& method);

/// --volume N, which volume where a DICOM file or a folder of them is given.
void add_volume_option(CLI::App& verb, std::optional<int>& volume);

/// --labels and --scan, of a volume by itself that may be either.
void add_content_options(CLI::App& verb);

/// --names FILE, a table that names the labels of volumes.
void add_names_option(CLI::App& verb, std::optional<std::filesystem::path>& names);

/// The files of a scene: the positionals "target" and "segmentation", and --names, --volume, --labels,
/// --scan.
/// @param help  of the target
/// @return the target's option, which is not required yet
CLI::Option* add_source_options(CLI::App& verb, SceneSource& source, const std::string& help = kTargetHelp);

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
