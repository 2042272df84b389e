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
#include "palpate/haptics/haptics.h"
#include "palpate/model/memory_forecast.h"
#include "palpate/model/preparing.h"
#include "palpate/recording/recording.h"
#include "palpate/scene/scene.h"
#include "palpate/volume/volume.h"

/// A scene becomes a Model.
namespace palpate {

/// How labels lie on a scan.
struct LabelPlacement {
  std::uint64_t labelled = 0;  ///< voxels that have a label
  std::uint64_t inside = 0;    ///< those of which the centre lies in the scan's voxels
  double share() const {
    return labelled == 0 ? 1 : static_cast<double>(inside) / static_cast<double>(labelled);
  }
};
LabelPlacement placement_of(const LabelMap& labels, const GridGeometry& scan);
/// "97.3 % of the labelled voxels lie inside the scan"
std::string in_words(const LabelPlacement& placement);
/// What a person should know where a part of the labels lies outside the scan, more than 5 %; else empty.
std::string doubt_of(const LabelPlacement& placement);
/// Error kBadInput, with `labels_file`, where less than half of the labels lies inside the scan, unless that
/// shows a part of what is labelled.
/// @param scan_is_cropped  as the scene or the user says
Result<void> check_placement(const LabelPlacement& placement, const std::filesystem::path& labels_file,
                             bool scan_is_cropped);

/// A scene with its volumes read and its field prepared.
struct LoadedScene {
  Scene scene;
  std::shared_ptr<const Model> model;
  /// Catalogue name, a phantom's parameters included, when it came from there, else empty.
  std::string data_set;
  /// Of volumes without a scene: what it was proposed from, in one line, and a line for each note on how they
  /// belong together; else empty.
  std::string proposed = {};
  /// How much of the labels lies inside the scan, where both were read.
  std::optional<LabelPlacement> label_placement = {};
  /// Where the labels of files have their names from, in one line; empty where the scene or the file says it
  /// itself.
  std::string origin_of_names = {};
  /// The same in a few words, without any file's name; empty without labels of files.
  std::string names_from = {};
};

/// How much memory a scene takes, bytes, before it is taken.
struct SceneMemory {
  std::uint64_t read = 0;  ///< of the volumes as they are read
  std::uint64_t scan = 0;  ///< that the model keeps
  MemoryForecast model;

  /// The most at a time, and what stays of it.
  std::uint64_t peak() const { return std::max(read + model.labels, scan + model.labels + model.peak); }
  std::uint64_t stays() const { return scan + model.stays(); }
};
/// Told before it is taken.
using Foretell = std::function<void(const SceneMemory&)>;

struct Placing;
/// How a scene says that its volumes lie (palpate/volume_io/volume_io.h).
Placing placing_of(const Scene& scene);

/// @param what         a catalogue name ("knee-atlas", "head"), a phantom's with or without parameters
///                     ("knee-phantom:side=right"), which is generated in memory, a scene file, or a volume:
///                     a scan, a label map or both get the scene that new_scene_text proposes
/// @param preparation  instead of the scene's
/// @param volume       of a volume that is DICOM's, its number (palpate/volume_io/volume_io.h)
/// @param labels       of a scan its segmentation; without one the only one in its folder (find_study)
/// Errors: kBadInput that names what a file is where it is neither (a segmentation of DICOM, a surface, a
/// picture, a folder,
/// ...).
Result<LoadedScene> load_scene_or_data_set(const std::string& what, const Progress& progress = {},
                                           const Warn& warn = {},
                                           std::optional<PreparationMethod> preparation = {},
                                           const Foretell& foretell = {}, std::optional<int> volume = {},
                                           const std::optional<std::filesystem::path>& labels = {});

/// Labels of a scene, with all layers, resampled onto the model's grid where theirs is another one; nothing
/// where the scene has none. Parameters and errors: those of load_scene_or_data_set.
Result<std::optional<LabelMap>> labels_of_scene(const std::string& what, const Model& model,
                                                const Progress& progress = {},
                                                std::optional<int> volume = {});

/// The scene of a recording: `what` as above, or empty for the data set that the recording names. Error
/// kUsage when it names none. Whether the model is the recorded one is for replay and report to say.
Result<LoadedScene> load_scene_of_recording(const RecordingHeader& recording, const std::string& what,
                                            const Progress& progress = {}, const Warn& warn = {},
                                            std::optional<int> volume = {});

/// Whether anything in the model can be felt: a tissue that is, with a voxel. What is not can be shown.
bool is_anything_felt(const Model& model);
/// An error that says how to let something be felt, where nothing is. kBadInput.
Result<void> check_felt(const LoadedScene& loaded);

/// The volumes of a scene.
struct SceneVolumes {
  std::optional<LabelMap> labels;             ///< freed as soon as the model has them in bricks
  std::shared_ptr<const Volume<float>> scan;  ///< the model shares it; may be null where there are labels
  bool oriented = true;                       ///< false: the files do not say how they lie in the patient
  std::vector<Caveat> caveats = {};           ///< Model::caveats of where they lie
  std::optional<LabelPlacement> label_placement = {};  ///< where both were read
};

/// Of a model by the scene's own method, from volumes already read: their labels are put in bricks, which is
/// taken, and the rest is estimated. Errors: those of build_model.
Result<SceneMemory> memory_of(const Scene& scene, SceneVolumes volumes, const Progress& progress = {});
/// Of what load_scene_or_data_set loads, which is read.
Result<SceneMemory> memory_of_scene_or_data_set(const std::string& what, const Progress& progress = {});

/// Builds the Model of a scene from volumes already read. Where nothing is felt its field is 0 everywhere.
/// Grids may differ. Ready for the trilinear method and the scene's, but for the proxy: its surfaces come
/// with ready_for.
Result<std::shared_ptr<const Model>> build_model(const Scene& scene, SceneVolumes volumes,
                                                 const Progress& progress = {}, const Warn& warn = {},
                                                 const Foretell& foretell = {});
/// The same from copies, for who keeps the volumes. One of them may be null.
Result<std::shared_ptr<const Model>> build_model(const Scene& scene, const LabelMap* labels,
                                                 const Volume<float>* scan, const Progress& progress = {},
                                                 const Warn& warn = {}, bool oriented = true);

/// prepared_for (palpate/model/make_model.h), with what was prepared before where it is kept.
Result<std::shared_ptr<const Model>> ready_for(std::shared_ptr<const Model> model,
                                               std::span<const ForceMethod> methods,
                                               const Progress& progress = {});

/// What takes seconds of a model that changes (next_version, palpate/model/changed_model.h), likewise. For
/// one model.
std::unique_ptr<const Preparing> kept_preparing();

}  // namespace palpate
