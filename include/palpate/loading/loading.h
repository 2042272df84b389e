#pragma once

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/contact/model.h"
#include "palpate/model/memory_forecast.h"
#include "palpate/model/model_preparation.h"
#include "palpate/recording/recording.h"
#include "palpate/scene/scene.h"
#include "palpate/volume/label_map.h"
#include "palpate/volume/volume.h"

/// Builds a Model from a scene: reads its volumes, places labels and scan on one grid, and prepares the field
/// and surfaces (from the cache if prepared before).
namespace palpate {

/// Position of the labels relative to the scan.
struct LabelPlacement {
  std::uint64_t labelled = 0;  ///< Number of labelled voxels
  std::uint64_t inside = 0;    ///< Number of these with the centre within the scan's voxels
  double fraction() const {
    return labelled == 0 ? 1 : static_cast<double>(inside) / static_cast<double>(labelled);
  }
};
/// Counts the labelled voxels inside the scan; a voxel with labels in several layers counts once.
LabelPlacement placement_of(const LabelMap& labels, const GridGeometry& scan);
/// Text such as "97.3 % of the labelled voxels lie inside the scan"
std::string in_words(const LabelPlacement& placement);
/// Warning for the user if more than 5 % of the labelled voxels are outside the scan; otherwise empty.
std::string placement_warning(const LabelPlacement& placement);
/// Checks that at least half of the labelled voxels are inside the scan. Otherwise error kBadInput with
/// `labels_file`, unless the scan covers only part of the labelled region.
/// @param scan_is_cropped  whether the scene or the user states that the scan is cropped
Result<void> check_placement(const LabelPlacement& placement, const std::filesystem::path& labels_file,
                             bool scan_is_cropped);

/// A scene with its volumes read, and its field prepared if its method is a direct one.
struct LoadedScene {
  Scene scene;
  std::shared_ptr<const Model> model;
  /// Catalogue name with the parameters of a phantom; empty for other scenes.
  std::string data_set;
  /// For volumes without a scene: source of the proposed scene in one line, followed by one line per remark
  /// on how the volumes fit together. Otherwise empty.
  std::string proposed = {};
  /// Position of the labels relative to the scan, if both were read.
  std::optional<LabelPlacement> label_placement = {};
  /// Origin of the label names in one line; empty if the scene or the file itself declares them.
  std::string origin_of_names = {};
  /// Short form of the origin without file names; empty if there are no labels from files.
  std::string names_from = {};
};

/// Estimates about a scene before its model is built: the memory that it requires, bytes, and its cells.
struct SceneMemory {
  std::uint64_t read = 0;  ///< Volumes while reading
  std::uint64_t scan = 0;  ///< Scan retained by the model
  MemoryForecast model;
  /// Edge length of the cells on which its soft tissue is solved. 0: its tissue law solves none.
  double tissue_cell_mm = 0;

  /// Peak usage, and usage after loading.
  std::uint64_t peak() const { return std::max(read + model.labels, scan + model.labels + model.peak); }
  std::uint64_t permanent() const { return scan + model.permanent(); }
};
/// Called with the estimate before the memory is allocated.
using MemoryCallback = std::function<void(const SceneMemory&)>;

struct PlacementOptions;
struct Study;
/// Orientation, axes and spacing that a scene declares for its volumes (palpate/volume_io/volume_io.h).
PlacementOptions placement_options_of(const Scene& scene);

/// Input files of a scene, as given on a command line or in a table.
struct SceneSource {
  /// Catalogue name ("knee-atlas", "head"), name of a phantom with or without parameters
  /// ("knee-phantom:side=right"), which is generated in memory, scene file, or volume. A scan, a label map
  /// or both get the scene that new_scene_text proposes.
  std::string target = {};
  /// Second of two volumes, a scan and its segmentation in either order (identify_scan_and_labels). Empty:
  /// the only segmentation in a DICOM folder (find_study).
  std::optional<std::filesystem::path> segmentation = {};
  std::optional<std::filesystem::path> names = {};  ///< Table with names for the labels of the volumes
  std::optional<int> volume = {};                   ///< Number of the scan in a DICOM folder with several
  std::optional<TissueLaw> law = {};                ///< Law of a proposed scene; empty: as in NewSceneInput
  bool touch_unknown = false;                       ///< For a proposed scene, as in NewSceneInput
};
/// Determines scan and segmentation of a source of volumes: their order, the number of the volume, and
/// whether the segmentation was made on the scan. Errors: those of identify_scan_and_labels and find_study.
Result<Study> study_of(const SceneSource& source, const Progress& progress = {});

/// Loads a scene, a data set, or volumes with the scene proposed for them.
/// @param preparation  overrides the method of the scene
/// Errors: those of study_of; kBadInput, which describes the file, if it is neither scene nor volume (a
/// picture, a folder, ...); kUsage if a segmentation, names or the number of a volume are given without
/// volumes.
Result<LoadedScene> load_scene_or_data_set(const SceneSource& source, const Progress& progress = {},
                                           const Warn& warn = {},
                                           std::optional<PreparationMethod> preparation = {},
                                           const MemoryCallback& report_memory = {});

/// Labels of a scene with all layers, resampled onto the model's grid if theirs differs; empty if the scene
/// has none. Parameters and errors as for load_scene_or_data_set.
Result<std::optional<LabelMap>> labels_of_scene(const SceneSource& source, const Model& model,
                                                const Progress& progress = {});

/// Loads the scene of a recording. Whether the model matches the recorded one is checked by replay and
/// report.
/// @param source  as above; if its target is empty, the data set named by the recording is used. Error
///                kUsage if it names none.
Result<LoadedScene> load_scene_of_recording(const RecordingHeader& recording, SceneSource source,
                                            const Progress& progress = {}, const Warn& warn = {});

/// Whether the model has a touchable tissue with at least one voxel. Other models can only be displayed.
bool has_touchable_tissue(const Model& model);
/// Error kBadInput with a remedy if the model has no touchable tissue.
Result<void> require_touchable_tissue(const LoadedScene& loaded);

/// The volumes of a scene.
struct SceneVolumes {
  std::optional<LabelMap> labels;             ///< Released once the model holds them in bricks
  std::shared_ptr<const Volume<float>> scan;  ///< Shared with the model; may be null if there are labels
  bool oriented = true;                       ///< Whether the files define the patient orientation
  std::vector<Caveat> caveats = {};           ///< Placement caveats, for Model::caveats
  std::optional<LabelPlacement> label_placement = {};  ///< Set if both were read
};

/// Volumes of a scene, read but not prepared.
struct ReadVolumes {
  SceneVolumes volumes;
  std::string origin_of_names = {};  ///< As in LoadedScene
};
/// Reads label map and scan without resampling, with all layers. A volume on its own is taken as the label
/// map. Errors: those of load_scene_or_data_set.
Result<ReadVolumes> read_volumes(const SceneSource& source, const Progress& progress = {},
                                 const Warn& warn = {});

/// Estimates the memory of a model with the scene's own method from volumes already read. The labels are
/// converted to bricks, which counts as measured; the rest is estimated. Errors: those of build_model.
Result<SceneMemory> memory_of(const Scene& scene, SceneVolumes volumes, const Progress& progress = {});
/// Same for a scene that load_scene_or_data_set accepts; its volumes are read.
Result<SceneMemory> memory_of_scene_or_data_set(const SceneSource& source, const Progress& progress = {});

/// Builds the Model of a scene from volumes already read, whose grids may differ. If no tissue is touchable
/// its field is 0 everywhere. The model is ready for the scene's method if that is a direct one; the surfaces
/// of the proxy are made by prepared_with_cache.
Result<std::shared_ptr<const Model>> build_model(const Scene& scene, SceneVolumes volumes,
                                                 const Progress& progress = {}, const Warn& warn = {},
                                                 const MemoryCallback& report_memory = {});
/// Overload that copies, for callers that retain the volumes. One of them may be null.
Result<std::shared_ptr<const Model>> build_model(const Scene& scene, const LabelMap* labels,
                                                 const Volume<float>* scan, const Progress& progress = {},
                                                 const Warn& warn = {}, bool oriented = true);

/// prepared_for (palpate/model/make_model.h) with results taken from the cache where available. Errors: its
/// own, and those of check_memory (palpate/base/reading.h) for a field of the direct methods.
Result<std::shared_ptr<const Model>> prepared_with_cache(std::shared_ptr<const Model> model,
                                                         std::span<const ForceMethod> methods,
                                                         const Progress& progress = {});

/// Slow preparation steps of a model that changes (next_version, palpate/model/changed_model.h), with results
/// taken from the cache. An instance serves one model.
std::unique_ptr<const ModelPreparation> cached_preparation();

}  // namespace palpate
