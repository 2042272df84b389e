#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <optional>
#include <vector>

#include "palpate/loading/loading.h"
#include "palpate/palpation/palpation.h"
#include "palpate/scene/script.h"
#include "verb.h"

/// Options, loading and output shared by the verbs that render or display a scene.
namespace palpate::app {

inline constexpr const char* kTargetHelp =
    "A data set (palpate data list), a scene file, or a scan or label map, also as a DICOM folder";

inline constexpr const char* kMadeWithHelp =
    "Scene file or volume of the recording; not needed for data sets";

/// Loads a source by load_scene_or_data_set(). Prints notes about the origin of a proposed scene, the
/// placement of the labels in the scan, and the source of their names.
Result<LoadedScene> load_target(const SceneSource& source, Console& console,
                                std::optional<PreparationMethod> preparation = {},
                                const MemoryCallback& report_memory = {});
/// As load_target(), with an error if the scene has no touchable tissue.
Result<LoadedScene> load_touchable_target(const SceneSource& source, Console& console,
                                          std::optional<PreparationMethod> preparation = {},
                                          const MemoryCallback& report_memory = {});

/// Script of a file; empty if there is no file, in which case a run plans the default script.
Result<std::optional<Script>> script_of(const std::optional<std::filesystem::path>& file);

/// Adds --method NAME with one of these methods.
void add_method_option(CLI::App& verb, const std::string& help, std::span<const ForceMethodInfo> methods,
                       std::optional<ForceMethod>& method);

/// Adds --volume N, which selects a volume of a DICOM file or folder with several.
void add_volume_option(CLI::App& verb, std::optional<int>& volume);

/// Adds --labels and --scan, which state the content of a volume that may be either.
void add_content_options(CLI::App& verb);

/// Adds --names FILE, a table with names for the labels of a volume.
void add_names_option(CLI::App& verb, std::optional<std::filesystem::path>& names);

/// Adds the input files of a scene: the positionals "target" and "segmentation", and --names, --volume,
/// --labels, --scan.
/// @param help  help text of the target
/// @return the option of the target, not yet marked as required
CLI::Option* add_source_options(CLI::App& verb, SceneSource& source, const std::string& help = kTargetHelp);

/// Adds --preparation NAME, which overrides the method of the scene.
void add_preparation_option(CLI::App& verb, std::optional<PreparationMethod>& preparation);

/// Prints the contact points of the approaches on stdout, one per line.
void print_touches(const std::vector<TouchFigure>& touches);
/// Definition of a held structure, for help texts.
std::string hold_definition();
/// Prints the removed volume of each structure on stdout, one per line.
void print_removed(const std::vector<RemovedFigure>& removed);
/// Prints the protected structures on stdout, one per line.
/// @param cutter  result of cutter_name for the model
void print_protected(const std::vector<ProtectedFigure>& figures, const std::string& cutter);
/// Prints a table on stdout of how each structure was held.
void print_holds(const std::vector<HoldFigure>& holds);

}  // namespace palpate::app
