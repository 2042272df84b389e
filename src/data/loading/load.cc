#include <algorithm>
#include <system_error>

#include "loading/cached_preparation.h"
#include "loading/proposed_scene.h"
#include "loading/read_scene.h"
#include "palpate/catalog/catalog.h"
#include "palpate/loading/loading.h"
#include "palpate/phantoms/phantoms.h"
#include "palpate/volume_io/volume_io.h"

namespace palpate {
namespace {

Result<Scene> scene_of_data_set(const std::string& data_set) {
  const auto text = embedded_scene(data_set);
  PALPATE_CHECK(text.has_value());
  return parse_scene(std::string(*text), embedded_source(data_set));
}

// identifies a file by its role, because a path may contain a patient's name and reports are shared
std::string doubt_of_file(const char* what, const VolumeHeader& header) {
  return header.placement_doubt.empty() ? "" : what + (" " + header.placement_doubt);
}

void record_doubt(std::string doubt, const Warn& warn, SceneVolumes& volumes) {
  if (doubt.empty()) return;
  if (warn) warn(doubt);
  volumes.caveats.push_back({CaveatKind::kPlacement, std::move(doubt)});
}

// volumes read from a scene's files
struct FileVolumes {
  SceneVolumes volumes;
  std::optional<std::filesystem::path> names_table = {};  // found next to the labels
  std::string origin_of_names = {}, names_from = {};      // as in LoadedScene
};

void take_labels(LabelFile labels, FileVolumes& files) {
  if (labels.name_source != NameSource::kSuppliedTable) {
    files.origin_of_names = origin_of_names(labels);
    files.names_table = std::move(labels.names_table);
  }
  files.names_from = description_of(labels.name_source);
  files.volumes.labels = std::move(labels.labels);
}

// reads the files that a scene names
Result<FileVolumes> volumes_of_files(const std::optional<std::filesystem::path>& labels_file,
                                     const std::optional<std::filesystem::path>& names_file,
                                     const std::optional<std::filesystem::path>& scan_file,
                                     std::optional<int> scan_volume,
                                     const PlacementOptions& placement_options, const Progress& progress,
                                     const Warn& warn) {
  std::optional<LabelFile> labels;
  std::optional<ScanFile> scan;
  if (scan_file) {
    auto read = read_scan(*scan_file, progress, warn, VoxelCaching::kOn, scan_volume, placement_options);
    if (!read) return read.error();
    scan = std::move(*read);
    if (warn && (scan->header.has_segments || scan->header.meaning == ValueMeaning::kLabels))
      warn(scan_file->string() + " states that it holds labels, but the scene uses it as the scan");
  }
  if (progress.stopped()) return Progress::interrupted();
  if (labels_file) {
    const AmbiguousLabels ambiguous =
        read_as() == ReadAs::kLabels ? AmbiguousLabels::kWarn : AmbiguousLabels::kReject;
    auto read = read_labels(*labels_file, names_file, progress, warn, ambiguous, VoxelCaching::kOn,
                            scan ? &scan->scan.geometry() : nullptr, placement_options, scan_file);
    if (!read) return read.error();
    labels = std::move(*read);
  }
  if (progress.stopped()) return Progress::interrupted();
  const bool oriented = (!labels || labels->header.has_geometry) && (!scan || scan->header.has_geometry);
  FileVolumes files{{{}, {}, oriented}};
  if (labels && scan) {
    files.volumes.label_placement = placement_of(labels->labels, scan->scan.geometry());
    const bool cropped = placement_options.scan_is_cropped || palpate::placement_options().scan_is_cropped;
    if (auto together = check_placement(*files.volumes.label_placement, *labels_file, cropped); !together)
      return together.error();
    record_doubt(placement_warning(*files.volumes.label_placement), warn, files.volumes);
  }
  if (scan) record_doubt(doubt_of_file("The scan", scan->header), {}, files.volumes);
  if (labels) record_doubt(doubt_of_file("The label map", labels->header), {}, files.volumes);
  if (labels) take_labels(*std::move(labels), files);
  if (scan) files.volumes.scan = std::make_shared<const Volume<float>>(std::move(scan->scan));
  return files;
}

Result<ReadScene> read_data_set(const std::string& data_set, const Progress& progress, const Warn& warn,
                                std::optional<PreparationMethod> preparation) {
  if (is_phantom_name(data_set)) return read_phantom(data_set, progress, preparation);
  auto scene = scene_of_data_set(data_set);
  if (!scene) return scene.error();
  prepare_by(preparation, scene->preparation);
  const auto local = locate(data_set);
  if (!local) return local.error();
  auto files = volumes_of_files(local->labels, local->names, local->scan, {}, {}, progress, warn);
  if (!files) return files.error();
  return ReadScene{*std::move(scene),           std::move(files->volumes), data_set, "", "",
                   std::move(files->names_from)};
}

Error names_without_labels(const std::string& where) {
  return {ErrorKind::kUsage, "a table of names needs a label map", where,
          "give the label map as well, or leave out --names; in a scene file: names = \"TABLE\""};
}

// reads a scan, a label map or a study of both, with the scene proposed for it
Result<ReadScene> read_with_proposal(const Study& study, const SceneSource& source, const Progress& progress,
                                     const Warn& warn, std::optional<PreparationMethod> preparation) {
  const std::optional<std::filesystem::path>& names = source.names;
  FileVolumes files;
  SceneVolumes& volumes = files.volumes;
  NewSceneInput input;
  std::string evidence;
  if (study.labels) {
    auto read = volumes_of_files(study.labels, names, study.scan, study.volume, {}, progress, warn);
    if (!read) return read.error();
    files = *std::move(read);
    input.labels = study.labels;
    input.scan = study.scan;
  } else {
    auto volume = read_volume(study.scan, names, progress, warn, VoxelCaching::kOn, study.volume);
    if (!volume) return volume.error();
    if (names && std::holds_alternative<ScanFile>(*volume)) return names_without_labels(study.scan.string());
    if (auto* labels = std::get_if<LabelFile>(&*volume)) {
      volumes.oriented = labels->header.has_geometry;
      record_doubt(doubt_of_file("The label map", labels->header), {}, volumes);
      evidence = labels->evidence;
      take_labels(std::move(*labels), files);
      input.labels = study.scan;
    } else {
      ScanFile& scan = std::get<ScanFile>(*volume);
      volumes.oriented = scan.header.has_geometry;
      record_doubt(doubt_of_file("The scan", scan.header), {}, volumes);
      evidence = scan.evidence;
      volumes.scan = std::make_shared<const Volume<float>>(std::move(scan.scan));
      input.scan = study.scan;
    }
  }
  if (input.scan) input.volume_of_scan = study.volume;
  input.label_map = volumes.labels ? &*volumes.labels : nullptr;
  input.names = names ? names : files.names_table;
  input.names_from = files.names_from;
  input.scan_volume = volumes.scan.get();
  input.law = source.law;
  input.touch_unknown = source.touch_unknown;
  auto proposed = propose_scene(input);
  if (!proposed) return proposed.error();
  prepare_by(preparation, proposed->scene.preparation);
  const auto is_unknown = [](const TissueSettings& tissue) {
    return tissue.touchable && tissue.preset.empty();
  };
  if (volumes.labels && std::ranges::any_of(proposed->scene.tissues, is_unknown))
    volumes.caveats.push_back({CaveatKind::kForce,
                               "no name of the label map is known, so all structures feel alike: name them "
                               "after tissues, in a table"});
  if (!evidence.empty())
    proposed->note += "\nit was taken as " + std::string(volumes.labels ? "labels" : "a scan") + " because " +
                      evidence +
                      (volumes.labels ? " (--scan takes it as a scan)" : " (--labels takes it as labels)");
  for (const std::string& note : study.notes) proposed->note += "\n" + note;
  return ReadScene{std::move(proposed->scene), std::move(files.volumes),         "",
                   std::move(proposed->note),  std::move(files.origin_of_names), std::move(files.names_from)};
}

Error neither_file_nor_data_set(const std::string& what, Error error) {
  std::error_code unreadable;
  if (!std::filesystem::exists(what, unreadable) && !unreadable) {
    error.what = "no such file, and no data set with that name";
    error.remedy =
        "palpate data list shows the data sets; palpate scene new writes a scene file for a scan and "
        "labels";
  }
  return error;
}

Result<FileVolumes> volumes_of_scene(const Scene& scene, const Progress& progress, const Warn& warn) {
  const auto resolved = [&](const std::optional<std::filesystem::path>& file) {
    return file ? std::optional(scene.resolve(*file)) : std::nullopt;
  };
  return volumes_of_files(resolved(scene.labels), resolved(scene.names), resolved(scene.scan),
                          scene.scan_volume, placement_options_of(scene), progress, warn);
}

// whether a source names volumes rather than a scene file or a data set
bool names_volumes(const SceneSource& source) {
  const bool is_scene = std::filesystem::path(source.target).extension() == ".toml";
  return !find_entry(source.target) && !is_scene && (source.segmentation || is_volume(source.target));
}

Result<ReadScene> read_scene_or_data_set(const SceneSource& source, const Progress& progress,
                                         const Warn& warn, std::optional<PreparationMethod> preparation) {
  const std::string& what = source.target;
  if (names_volumes(source)) {
    const auto study = study_of(source, progress);
    if (!study) return study.error();
    return read_with_proposal(*study, source, progress, warn, preparation);
  }
  if (source.segmentation)
    return Error{ErrorKind::kUsage, "a segmentation needs a scan", what,
                 "give the scan that it was made on, a DICOM folder or another volume, before it"};
  if (source.volume)
    return Error{ErrorKind::kUsage, "a volume number needs a DICOM file or folder", what,
                 "leave out --volume; in a scene file: scan_volume = N"};
  if (find_entry(what)) {
    if (source.names) return names_without_labels(what);
    return read_data_set(what, progress, warn, preparation);
  }
  if (auto other = describe_non_volume(what)) return *std::move(other);
  auto scene = load_scene(what);
  if (!scene) return neither_file_nor_data_set(what, scene.error());
  if (source.names) return names_without_labels(what);
  prepare_by(preparation, scene->preparation);
  auto files = volumes_of_scene(*scene, progress, warn);
  if (!files) return files.error();
  return ReadScene{*std::move(scene),
                   std::move(files->volumes),
                   "",
                   "",
                   files->names_table ? std::move(files->origin_of_names) : "",
                   std::move(files->names_from)};
}

}  // namespace

PlacementOptions placement_options_of(const Scene& scene) {
  PlacementOptions placement_options;
  if (scene.mesh_space)
    placement_options.mesh.space = *scene.mesh_space == SurfaceAxes::kLps ? MeshSpace::kLps : MeshSpace::kRas;
  if (scene.mesh_unit)
    placement_options.mesh.unit_mm = *scene.mesh_unit == SurfaceUnit::kMm   ? 1.0
                                     : *scene.mesh_unit == SurfaceUnit::kCm ? 10.0
                                                                            : 1000.0;
  placement_options.image_spacing_mm = scene.image_spacing_mm;
  if (scene.nifti_form)
    placement_options.nifti_form =
        *scene.nifti_form == HeaderForm::kQform ? NiftiForm::kQform : NiftiForm::kSform;
  placement_options.scan_is_cropped = scene.scan_is_cropped;
  return placement_options;
}

Result<Study> study_of(const SceneSource& source, const Progress& progress) {
  if (!source.segmentation) return find_study(source.target, {}, source.volume, progress);
  const auto files = identify_scan_and_labels(source.target, *source.segmentation, source.names);
  if (!files) return files.error();
  return find_study(files->scan, files->labels, source.volume, progress);
}

Result<LoadedScene> load_scene_or_data_set(const SceneSource& source, const Progress& progress,
                                           const Warn& warn, std::optional<PreparationMethod> preparation,
                                           const MemoryCallback& report_memory) {
  auto read = read_scene_or_data_set(source, progress, warn, preparation);
  if (!read) return read.error();
  return with_model(*std::move(read), progress, warn, report_memory);
}

Result<std::optional<LabelMap>> labels_of_scene(const SceneSource& source, const Model& model,
                                                const Progress& progress) {
  auto read = read_scene_or_data_set(source, progress, {}, {});
  if (!read) return read.error();
  std::optional<LabelMap>& labels = read->volumes.labels;
  const GridGeometry& grid = model.labels->geometry();
  if (!labels || labels->geometry().same_grid(grid)) return std::move(labels);
  auto moved = cached_resampled(*labels, grid, progress);
  if (!moved) return moved.error();
  return std::optional(*std::move(moved));
}

Result<ReadVolumes> read_volumes(const SceneSource& source, const Progress& progress, const Warn& warn) {
  if (!names_volumes(source)) {
    auto read = read_scene_or_data_set(source, progress, warn, {});
    if (!read) return read.error();
    return ReadVolumes{std::move(read->volumes), std::move(read->origin_of_names)};
  }
  const auto study = study_of(source, progress);
  if (!study) return study.error();
  // a single file is the label map
  const bool has_scan = study->labels.has_value();
  auto files = volumes_of_files(has_scan ? study->labels : study->scan, source.names,
                                has_scan ? std::optional(study->scan) : std::nullopt,
                                has_scan ? study->volume : std::nullopt, {}, progress, warn);
  if (!files) return files.error();
  return ReadVolumes{std::move(files->volumes), std::move(files->origin_of_names)};
}

Result<SceneMemory> memory_of_scene_or_data_set(const SceneSource& source, const Progress& progress) {
  auto read = read_scene_or_data_set(source, progress, {}, {});
  if (!read) return read.error();
  return memory_of(read->scene, std::move(read->volumes), progress);
}

Result<LoadedScene> load_scene_of_recording(const RecordingHeader& recording, SceneSource source,
                                            const Progress& progress, const Warn& warn) {
  if (source.target.empty()) source.target = recording.data_set;
  if (source.target.empty())
    return Error{ErrorKind::kUsage, "the recording was made with a scene file that it does not contain", "",
                 "give the scene file after the recording: RECORDING SCENE"};
  return load_scene_or_data_set(source, progress, warn);
}

}  // namespace palpate
