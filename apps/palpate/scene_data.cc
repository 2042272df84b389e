#include "scene_data.h"
#include "palpate/volume/resample.h"

#include <utility>
#include <variant>

namespace palpate::app {
namespace {

void warn_if_silent(const VolumeHeader& header, const std::filesystem::path& file, Console& console) {
  if (header.has_geometry) return;
  console.warn()(
      file.string() +
      " does not state its orientation in the patient: its axes are taken as LPS, sides are unknown");
}

}  // namespace

Result<SceneData> read_data(const std::optional<std::filesystem::path>& scan, std::optional<int> volume,
                            const std::optional<std::filesystem::path>& labels,
                            const std::optional<std::filesystem::path>& names,
                            const PlacementOptions& placement_options, Console& console) {
  SceneData data;
  if (scan) {
    auto read =
        read_scan(*scan, console.progress(), console.warn(), VoxelCaching::kOff, volume, placement_options);
    if (!read) return read.error();
    data.scan = std::move(*read);
    warn_if_silent(data.scan->header, *scan, console);
  }
  if (labels) {
    auto read = read_labels(*labels, names, console.progress(), console.warn(), AmbiguousLabels::kReject,
                            VoxelCaching::kOff, data.scan_grid(), placement_options, scan);
    if (!read) return read.error();
    data.labels = std::move(*read);
    warn_if_silent(data.labels->header, *labels, console);
  }
  return data;
}

Result<SceneData> read_one(const std::filesystem::path& file, std::optional<int> number,
                           const std::optional<std::filesystem::path>& names, Console& console) {
  auto volume = read_volume(file, names, console.progress(), console.warn(), VoxelCaching::kOff, number);
  if (!volume) return volume.error();
  SceneData data;
  if (auto* labels = std::get_if<LabelFile>(&*volume)) {
    warn_if_silent(labels->header, file, console);
    data.labels = std::move(*labels);
    if (!data.labels->evidence.empty())
      console.note(file.string() + " is taken as labels, because " + data.labels->evidence +
                   "; --scan takes it as a scan");
  } else {
    data.scan = std::get<ScanFile>(*std::move(volume));
    warn_if_silent(data.scan->header, file, console);
    console.note(file.string() + " is taken as a scan, felt where it is bright, because " +
                 data.scan->evidence + "; --labels takes it as a label map");
  }
  return data;
}

Result<void> compare_grids(const SceneData& data, const std::filesystem::path& labels_file,
                           bool scan_is_cropped, Console& console) {
  if (!data.scan || !data.labels) return {};
  const LabelPlacement placement = placement_of(data.labels->labels, *data.scan_grid());
  if (auto together = check_placement(placement, labels_file, scan_is_cropped); !together)
    return together.error();
  const std::string doubt = placement_warning(placement);
  doubt.empty() ? console.note(in_words(placement) + ".") : console.warn()(doubt);
  if (data.scan_grid()->same_grid(*data.labels_grid())) return {};
  if (&field_grid(data.labels_grid(), data.scan_grid()) == data.labels_grid()) {
    if (const auto moved = resample_linear(data.scan->scan, *data.labels_grid(), 0); !moved)
      return moved.error();
  } else if (const auto moved = resample_nearest(data.labels->labels, *data.scan_grid()); !moved) {
    return moved.error();
  }
  console.note("The scan and the labels are on different grids; they will be resampled.");
  return {};
}

}  // namespace palpate::app
