#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "palpate/scene/scene.h"
#include "palpate/volume/label_map.h"

/// Proposal of a scene file for a scan or a label map.
namespace palpate {

/// Input of new_scene_text: a label map with its file `labels`, or a scan alone.
struct NewSceneInput {
  std::optional<std::filesystem::path> scan = {}, labels = {}, names = {};
  std::string names_from = {};  ///< Origin of the label names, written as a comment
  const LabelMap* label_map = nullptr;
  const Volume<float>* scan_volume = nullptr;  ///< Scan; with labels only its grid is used
  std::string title = {};
  Side side = Side::kUnknown;
  Modality modality = Modality::kUnknown;
  /// Empty: elastic if any structure gets a preset with a modulus, otherwise by layers.
  std::optional<TissueLaw> law = {};
  std::optional<int> volume_of_scan = {};      ///< Number of the volume if `scan` holds several
  std::optional<SurfaceAxes> mesh_space = {};  ///< Axis convention given for `labels`
  std::optional<SurfaceUnit> mesh_unit = {};
  std::optional<Eigen::Vector3d> image_spacing_mm = {};
  std::optional<HeaderForm> nifti_form = {};
  bool scan_is_cropped = false;
  /// If no structure's name suggests a tissue: whether structures of unknown names are touchable, all with
  /// the stiffness of a raw scan's threshold, instead of shown only.
  bool touch_unknown = false;
  /// Whether to add a tissue of the unlabelled voxels inside the body, as soft as fat. If a scan determines
  /// where the body ends, its threshold by Otsu's method (1979) is written.
  bool embed = false;
};
/// Text of a scene file for these files. Every structure is assigned the tissue that its name suggests; each
/// structure without a suggestion gets its own tissue that is shown but exerts no force (one common tissue if
/// there are too many; see `touch_unknown`). Paths are relative to `folder` if below it, otherwise absolute.
/// Without labels (a raw scan) the scene has one tissue by threshold, derived from the scan's values by
/// Otsu's method (1979). Sigma is the largest voxel spacing, and at least 1 mm. Errors: neither labels nor
/// scan, no structure, a constant scan, a path that is not UTF-8.
Result<std::string> new_scene_text(const NewSceneInput& input, const std::filesystem::path& folder);
/// Writes the text atomically. Errors are kOutput.
Result<void> write_scene_text(const std::filesystem::path& file, std::string_view text);

}  // namespace palpate
