#include <cmath>
#include <cstdio>

#include "palpate/loading/loading.h"

namespace palpate {
namespace {

// shares of labelled voxels inside the scan below which the files are refused, and below which a warning is
// given
constexpr double kRefusedBelow = 0.5, kDoubtedBelow = 0.95;

}  // namespace

LabelPlacement placement_of(const LabelMap& labels, const GridGeometry& scan) {
  LabelPlacement placement;
  const GridGeometry& grid = labels.geometry();
  const bool same = grid.same_grid(scan);
  const auto X_ScanLabels = scan.X_PatientVoxel().inverse() * grid.X_PatientVoxel();
  const Eigen::Matrix3d linear = X_ScanLabels.linear();
  // voxel centres are at integers; each voxel extends half a voxel around its centre
  const Eigen::Array3d end(scan.dims[0] - 0.5, scan.dims[1] - 0.5, scan.dims[2] - 0.5);
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j) {
      const Eigen::Vector3d row = (X_ScanLabels * Point<Voxel>(0, j, k)).eigen();
      const std::size_t first = grid.offset(0, j, k);
      for (int i = 0; i < grid.dims[0]; ++i) {
        bool labelled = false;
        for (const auto& layer : labels.layers)
          labelled = labelled || layer.voxels()[first + static_cast<std::size_t>(i)] != 0;
        if (!labelled) continue;
        ++placement.labelled;
        const Eigen::Array3d at = row + i * linear.col(0);
        placement.inside += same || ((at >= -0.5).all() && (at <= end).all());
      }
    }
  return placement;
}

std::string in_words(const LabelPlacement& placement) {
  char text[80];
  // rounded down, so that 100 % means all of them
  std::snprintf(text, sizeof text, "%.1f %% of the labelled voxels lie inside the scan",
                std::floor(1000 * placement.fraction()) / 10);
  return text;
}

std::string placement_warning(const LabelPlacement& placement) {
  if (placement.fraction() >= kDoubtedBelow) return "";
  return "only " + in_words(placement) +
         ": the scan may belong to another patient, or cover only part of the labelled region";
}

Result<void> check_placement(const LabelPlacement& placement, const std::filesystem::path& labels_file,
                             bool scan_is_cropped) {
  if (scan_is_cropped || placement.fraction() >= kRefusedBelow) return {};
  return Error{
      ErrorKind::kBadInput, "the labels do not seem to belong to the scan: only " + in_words(placement),
      labels_file.string(),
      "give the scan that they were made on; if they lost their position or their axes were negated, save "
      "them again with the geometry of the scan, for example in 3D Slicer; if the scan covers only part of "
      "the labelled region, add --cropped-scan (in a scene file: cropped_scan = true)"};
}

}  // namespace palpate
