#include <cerrno>
#include <cmath>
#include <cstdio>
#include <memory>

#include "attachment.h"
#include "input_files.h"
#include "palpate/base/file.h"
#include "palpate/base/output.h"
#include "palpate/loading/loading.h"
#include "palpate/palpation/palpation.h"
#include "palpate/volume/label_map.h"
#include "palpate/volume/resample.h"
#include "palpate/volume/volume.h"
#include "palpate/volume_io/dicom_export.h"
#include "palpate/volume_io/volume_io.h"
#include "scene_options.h"
#include "verb.h"

namespace palpate::app {
namespace {

struct ExportOptions {
  std::filesystem::path source;  ///< Recording or label map
  SceneSource made_with;         ///< Scene of the recording; for a label map its target is the scan
  std::filesystem::path output;
  bool keep_identifiers = false;
};

bool ends_in(const std::filesystem::path& file, std::string_view ending) {
  return file.extension() == ending;
}

Result<void> write_exported(const ExportOptions& options, const LabelMap& labels,
                            const std::optional<DicomAttachment>& attached, const Progress& progress) {
  if (ends_in(options.output, ".dcm"))
    return write_dicom_segmentation(options.output, labels, attached, progress);
  return write_labels(options.output, labels);
}

// ---- label maps ---------------------------------------------------------------------------------

// Labels must not be exported with the identity of another patient: labels that reference their images must
// reference this study, and all must lie within its scan.
Result<std::optional<int>> volume_of_labels(const ExportOptions& options, const std::filesystem::path& scan,
                                            Console& console) {
  const auto study = find_study(scan, options.source, options.made_with.volume, console.progress());
  if (!study) return study.error();
  if (options.keep_identifiers && !study->is_declared)
    return Error{ErrorKind::kBadInput, "does not state that it was made on images of " + scan.string(),
                 options.source.string(),
                 "name the study that it was made on, or leave --keep-identifiers out"};
  for (const std::string& note : study->notes) console.note(note);
  return study->volume;
}

Result<void> check_grids(const LabelMap& labels, const GridGeometry& scan, const std::filesystem::path& file,
                         Console& console) {
  const LabelPlacement placement = placement_of(labels, scan);
  if (auto together = check_placement(placement, file, placement_options().scan_is_cropped); !together)
    return together;
  const std::string doubt = placement_warning(placement);
  doubt.empty() ? console.note(in_words(placement) + ".") : console.warn()(doubt);
  if (labels.geometry().same_grid(scan)) return {};
  const auto moved = resample_nearest(labels, scan);
  if (moved) return {};
  return Error{moved.error().kind, moved.error().what, file.string(), moved.error().remedy};
}

int export_label_map(const ExportOptions& options, Console& console) {
  const Progress progress = console.progress();
  std::optional<std::filesystem::path> scan;
  if (!options.made_with.target.empty()) scan = options.made_with.target;
  if (options.made_with.volume && !scan)
    return console.fail({ErrorKind::kUsage, "the volume does not state which study it belongs to", "--volume",
                         "name the study after the labels: palpate export LABELS STUDY"});
  std::optional<DicomAttachment> attached;
  if (options.keep_identifiers) {
    if (!scan)
      return console.fail({ErrorKind::kUsage, "no study is given to attach the result to",
                           "--keep-identifiers",
                           "name the study after the labels: palpate export LABELS STUDY"});
    attached = DicomAttachment{*scan, options.made_with.volume};
  }
  std::optional<ScanFile> read;
  if (scan) {
    const auto volume = volume_of_labels(options, *scan, console);
    if (!volume) return console.fail(volume.error());
    if (attached) attached->volume = *volume;
    auto found = read_scan(*scan, progress, console.warn(), VoxelCaching::kOff, *volume);
    if (!found) return console.fail(found.error());
    read = *std::move(found);
  }
  const AmbiguousLabels ambiguous =
      read_as() == ReadAs::kLabels ? AmbiguousLabels::kWarn : AmbiguousLabels::kReject;
  const auto labels =
      read_labels(options.source, options.made_with.names, progress, console.warn(), ambiguous,
                  VoxelCaching::kOff, read ? &read->scan.geometry() : nullptr, {}, scan);
  if (!labels) return console.fail(labels.error());
  console.note(origin_of_names(*labels));
  if (read)
    if (auto checked = check_grids(labels->labels, read->scan.geometry(), options.source, console); !checked)
      return console.fail(checked.error());
  if (auto written = write_exported(options, labels->labels, attached, progress); !written)
    return console.fail(written.error());
  console.note("labels: " + options.output.string());
  return kExitOk;
}

// ---- recordings ---------------------------------------------------------------------------------

int export_labels(const ExportOptions& options, const RecordingSource& recording, Console& console) {
  const Progress progress = console.progress();
  const auto loaded =
      load_scene_of_recording(recording.head().header, options.made_with, progress, console.warn());
  if (!loaded) return console.fail(loaded.error());
  const auto attached = attachment_of(*loaded, options.keep_identifiers);
  if (!attached) return console.fail(attached.error());
  SceneSource scene = options.made_with;
  if (scene.target.empty()) scene.target = recording.head().header.data_set;
  const auto layers = labels_of_scene(scene, *loaded->model, progress);
  if (!layers) return console.fail(layers.error());
  const auto left = remaining_labels(recording, *loaded->model, *layers ? &**layers : nullptr, progress);
  if (!left) {
    Error error = left.error();
    if (error.where.empty()) error.where = options.source.string();
    return console.fail(error);
  }
  if (auto written = write_exported(options, left->labels, *attached, progress); !written)
    return console.fail(written.error());
  print_removed(left->removed);
  if (left->removed.empty()) console.note("nothing was removed in this recording");
  console.note("labels: " + options.output.string());
  return kExitOk;
}

void print_path_row(std::FILE* out, const TickRecord& tick, int device) {
  const DeviceTick& at = tick.device[static_cast<std::size_t>(device)];
  const auto& [fx, fy, fz] = at.force_N;
  std::fprintf(out, "%llu,%.6f,%d", static_cast<unsigned long long>(tick.tick), tick.time_s, device + 1);
  for (const auto* point : {&at.tip_patient_mm, &at.proxy_patient_mm})
    for (const double value : *point) std::fprintf(out, ",%.5f", value);
  std::fprintf(out, ",%.5f,%d\n", std::sqrt(fx * fx + fy * fy + fz * fz), at.label);
}

int export_paths(const ExportOptions& options, const RecordingSource& recording, Console& console) {
  if (options.keep_identifiers)
    return console.fail(
        {ErrorKind::kUsage, "a path has no identifiers", "--keep-identifiers", "leave it out"});
  if (!options.made_with.target.empty())
    console.note(options.made_with.target + " is not needed to export a path, and is ignored");
  auto pending = PendingFile::create(options.output);
  if (!pending) return console.fail(pending.error());
  const auto failed = [&](int number) { return console.fail(output_error(options.output, number)); };
  std::FILE* out = std::fopen(pending->path().c_str(), "w");
  if (!out) return failed(errno);
  std::fputs("tick,time_s,device,tip_x_mm,tip_y_mm,tip_z_mm,proxy_x_mm,proxy_y_mm,proxy_z_mm,force_N,label\n",
             out);
  const auto read = recording.read(
      [&](const RecordingPart& part) {
        for (const TickRecord& tick : part.ticks)
          for (int device = 0; device < tick.devices; ++device) print_path_row(out, tick, device);
        return std::ferror(out) ? Result<void>(output_error(options.output, errno)) : Result<void>();
      },
      console.progress());
  const bool closed = std::fclose(out) == 0;
  if (!read) return console.fail(read.error());
  if (!closed) return failed(errno);
  if (auto committed = pending->commit(); !committed) return console.fail(committed.error());
  console.note("path: " + options.output.string() + ", LPS mm of the volume");
  return kExitOk;
}

/// Identifies which of the two files is the scan and which the label map; they may be given in either order.
Result<void> order_labels_and_scan(ExportOptions& options) {
  SceneSource& with = options.made_with;
  if (with.segmentation)
    return Error{ErrorKind::kUsage, "more files than a scan and a label map", with.segmentation->string(),
                 "palpate export LABELS STUDY"};
  // --labels and --scan state what the two files LABELS STUDY are
  if (with.target.empty() || read_as() != ReadAs::kByContent) return {};
  auto files = identify_scan_and_labels(with.target, options.source, with.names);
  if (!files) return files.error();
  with.target = files->scan.string();
  options.source = std::move(files->labels);
  return {};
}

int run_export(ExportOptions options, Console& console) {
  if (options.keep_identifiers && !ends_in(options.output, ".dcm"))
    return console.fail({ErrorKind::kUsage, "only DICOM can keep identifiers", "--keep-identifiers",
                         "write a file that ends in .dcm, or leave it out"});
  // if neither file is a recording, a missing file is reported as a missing volume
  std::error_code unknown;
  const bool is_missing = !std::filesystem::exists(options.source, unknown);
  const bool labels = is_volume(options.source) || is_structure_set(options.source) ||
                      (is_missing && is_volume(options.made_with.target));
  std::vector<std::filesystem::path> inputs;
  std::optional<RecordingSource> recording;
  if (labels) {
    if (auto ordered = order_labels_and_scan(options); !ordered) return console.fail(ordered.error());
    inputs = input_files(options.made_with);
  } else {
    auto opened = RecordingSource::open(options.source, console.progress());
    if (!opened) return console.fail(opened.error());
    recording = *std::move(opened);
    inputs = recorded_inputs(options.made_with, recording->head().header);
  }
  add_input(options.source, inputs);
  const auto claimed = claim_output(options.output, inputs);
  if (!claimed) return console.fail(claimed.error());
  if (labels && ends_in(options.output, ".csv"))
    return console.fail({ErrorKind::kUsage, "labels have no path", options.output.string(),
                         "name a recording, or write .dcm, .seg.nrrd, .nrrd, .nii or .nii.gz"});
  if (labels) return export_label_map(options, console);
  return ends_in(options.output, ".csv") ? export_paths(options, *recording, console)
                                         : export_labels(options, *recording, console);
}

}  // namespace

void add_export(CLI::App& app, Run& run) {
  auto options = std::make_shared<ExportOptions>();
  CLI::App* verb = app.add_subcommand(
      "export",
      "Export labels, also as cut in a recording (DICOM SEG, .seg.nrrd), or the path of a recording (CSV)");
  verb->add_option("source", options->source,
                   "Recording made by palpate simulate or explore; or labels in any supported format")
      ->required();
  add_source_options(*verb, options->made_with,
                     "Scene file or volume of the recording, not needed for data sets; or the scan that the "
                     "labels were made on, in either order");
  verb->add_option("-o,--output", options->output,
                   "Labels to write: .dcm (DICOM SEG), .seg.nrrd, .nrrd, .nii or .nii.gz; or a path: .csv")
      ->required();
  verb->add_flag("--keep-identifiers", options->keep_identifiers,
                 "Attach a DICOM SEG to the patient, study and frame of reference of the scan; default: new "
                 "ones, and a patient without a name");
  verb->footer(
      "Examples:\n"
      "  palpate export run.h5 scene.toml -o left.seg.nrrd\n"
      "  palpate export run.h5 scene.toml -o left.dcm                       without a patient\n"
      "  palpate export run.h5 scene.toml -o left.dcm --keep-identifiers    for the study of the scan\n"
      "  palpate export run.h5 -o path.csv                                  tip and proxy, LPS mm, tick by "
      "tick\n"
      "  palpate export labels.nii.gz STUDY -o labels.dcm\n"
      "  palpate export structures.dcm STUDY --keep-identifiers -o seg.dcm  RTSTRUCT as SEG\n\n"
      "A voxel is removed if the tool has swept its centre. Prints the removed volume of each structure, to\n"
      "1/64 of a voxel. docs/guide/burr.md describes burrs, docs/guide/export.md the files written.");
  verb->callback(
      [options, &run] { run = [options](Console& console) { return run_export(*options, console); }; });
}

}  // namespace palpate::app
