#pragma once

#include <filesystem>
#include <optional>

#include "apps/command/console.h"
#include "palpate/loading/loading.h"
#include "palpate/volume_io/volume_io.h"

namespace palpate::app {

/// Input volumes of a scene: a label map, a scan or both.
struct SceneData {
  std::optional<ScanFile> scan;
  std::optional<LabelFile> labels;

  const GridGeometry* scan_grid() const { return scan ? &scan->scan.geometry() : nullptr; }
  const GridGeometry* labels_grid() const { return labels ? &labels->labels.geometry() : nullptr; }
  /// Whether every file states its orientation in the patient.
  bool oriented() const {
    return (!scan || scan->header.has_geometry) && (!labels || labels->header.has_geometry);
  }
};

/// Reads the named files completely, so that a scene is accepted only for data that can be used.
/// @param volume  number of the volume to use as the scan, if the file holds several
Result<SceneData> read_data(const std::optional<std::filesystem::path>& scan, std::optional<int> volume,
                            const std::optional<std::filesystem::path>& labels,
                            const std::optional<std::filesystem::path>& names,
                            const PlacementOptions& placement_options, Console& console);
/// Reads a file whose kind is not stated.
Result<SceneData> read_one(const std::filesystem::path& file, std::optional<int> number,
                           const std::optional<std::filesystem::path>& names, Console& console);
/// Checks scan and labels on different grids, which will be resampled onto field_grid(). Notes the fraction
/// of the labels inside the scan; an error if it is too small.
Result<void> compare_grids(const SceneData& data, const std::filesystem::path& labels_file,
                           bool scan_is_cropped, Console& console);

}  // namespace palpate::app
