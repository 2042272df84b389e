#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "palpate/base/force_method.h"
#include "palpate/contact/contact_settings.h"
#include "palpate/contact/distances.h"
#include "palpate/contact/method_settings.h"
#include "palpate/contact/no_go.h"
#include "palpate/contact/proxy.h"
#include "palpate/contact/tissue.h"
#include "palpate/contact/tool.h"
#include "palpate/sampling/sampling.h"
#include "palpate/volume/bricks.h"
#include "palpate/volume/label_map.h"
#include "palpate/volume/volume.h"

/// The model that is rendered, and its force laws as pure functions of state.
namespace palpate {

/// Body side shown by a scan. kBoth: a scan of head or torso, which needs no side mark.
enum class Side : std::uint8_t { kUnknown, kLeft, kRight, kBoth };

/// Subject of a limitation of a model.
enum class CaveatKind : std::uint8_t {
  kPlacement,  ///< Position or orientation of labels or scan in the patient
  kSide,       ///< Side of the patient that the scan shows
  kForce,      ///< Rendered force
};
/// A limitation of a model that loading found.
struct Caveat {
  CaveatKind kind = CaveatKind::kForce;
  std::string text;  ///< One sentence without file names, for report and page
};

class Carving;
class ForceField;

/// Immutable snapshot of everything a tick reads. A new version replaces it; unchanged parts are shared
/// between versions.
struct Model {
  std::uint32_t version = 1;
  /// Number of versions up to this one that were local edits, i.e. only removed or restored tissue. Their
  /// forces are not blended in, and contact with surfaces they did not change continues without interruption.
  std::uint32_t edits = 0;
  /// Hash of labels, tissues, tools, limits and settings, and of a smoothed field
  std::uint64_t content_hash = 0;
  std::uint64_t hash_before_removal = 0;  ///< content_hash of the same model without any removal
  std::string title;
  Side side = Side::kUnknown;
  bool side_from_anatomy = false;  ///< Whether `side` was derived from the position of the fibula because
                                   ///< the scene does not state it
  bool oriented = true;            ///< false: the files do not state the patient orientation
  std::vector<Caveat> caveats;

  /// Scalar field of the direct methods on the grid of `labels`: inward ramps or smoothed labels. null: no
  /// direct method is prepared, as in a model for the proxy alone.
  std::shared_ptr<const Field> field;
  bool field_in_eight_bits = false;  ///< Resolution of the field's values; else 16 bits
  /// Segmentation flattened to one label per voxel, with a margin of background (label_bricks).
  std::shared_ptr<const Bricks<LabelId>> labels;
  std::shared_ptr<const Volume<float>> scan;  ///< Scan on the grid of `labels`; may be null
  std::vector<Segment> segments;              ///< Names and colours of the labels
  /// Segments in which each label is nested (palpate/volume/overlaps.h), smallest first, by LabelId. Labels
  /// beyond the end are nested in none.
  std::vector<std::vector<LabelId>> enclosing;
  std::vector<Tissue> tissues;
  std::vector<std::int16_t> tissue_of_label;  ///< Index into `tissues` by LabelId. -1: belongs to no tissue
  /// Field value deep inside each label for smoothed labels: its stiffness over the greatest stiffness, 0 ...
  /// 1.
  std::vector<float> level_of_label;

  /// Prepared force field of each direct method (palpate/direct/force_field.h), by ForceMethod. null: not
  /// prepared. With `field` the trilinear one is always prepared.
  std::array<std::shared_ptr<const ForceField>, kDirectMethods.size()> methods;
  /// Surfaces for the proxy: one per touchable structure, then the common surfaces of touching structures and
  /// layers. Empty: not prepared.
  std::vector<ContactSurface> surfaces;
  /// Label of each structure surface, i.e. of the first entries of `surfaces`.
  std::vector<LabelId> label_of_surface;
  /// Touchable structures with a Protection other than kNone, with their surfaces before any removal. Empty
  /// without a burr.
  std::vector<ProtectedStructure> protected_structures;
  /// Voxels of bone that is too thin for the material ahead of a burr to be measured from its surface
  /// (palpate/tissue/thin_voxels.h). null: none, or no tool is a burr.
  std::shared_ptr<const Bricks<std::uint8_t>> thin_voxels;
  /// Attenuation at which touchable rigid tissue has exactly its tissue's cutting energy; at any other
  /// attenuation the energy is scaled by density_ratio(), with the HU of `scan`, which is a calibrated CT
  /// (palpate/tissue/bone_density.h). 0: the energy does not depend on density.
  double full_density_HU = 0;
  /// Ratio of every voxel's cutting energy to its tissue's, where kDensityRatioOne is 1. null: 1 everywhere.
  std::shared_ptr<const Bricks<std::uint16_t>> density_ratios;
  /// Structures whose distance to the tool is reported in every tick.
  ReportedDistances reported_distances;
  /// Regions that the tool is pushed out of; at most kMaxNoGo.
  std::vector<NoGoRegion> no_go;
  /// Distance trees of the structures in reported_distances and no_go. Empty: not prepared, or no structures.
  DistanceTrees distance_trees;
  /// Tissue removed from the surfaces (palpate/tissue/carving.h). null: nothing was removed.
  std::shared_ptr<const Carving> carving;
  MethodSettings method_settings;
  TissueLaw tissue_law = TissueLaw::kLayers;
  double tissue_cell_mm = 0;  ///< Cell edge of the elastic solver. 0: chosen from the voxel size
  /// Factor by which the elastic solver's cells are enlarged, and their number per axis reduced, on a machine
  /// on which a frame would otherwise exceed its time budget. At least 1. A property of the session, not of
  /// the scene, and therefore not part of any content hash.
  double tissue_cell_factor = 1;
  /// Relaxation times of all elastic tissues. Empty: nothing relaxes.
  RelaxationTimes relaxation_times;

  double sigma_mm = 1.0;  ///< Standard deviation of the Gaussian that smoothed the field; unused with ramps
  /// Width of the field's inward ramps (palpate/surfaces/ramps.h). 0: smoothed labels
  double ramp_width_mm = 0;
  /// Search distance for the structure in contact at a point, and for its surface. It is the reach of a
  /// smoothed field outside a structure; for ramps, which act only inside, their maximum depth.
  double reach_mm = 5.0;
  /// Tools of the session's devices in order; at least one.
  std::vector<Tool> tools{Tool()};
  /// Force limit of the scene. Infinite: none.
  double scene_max_force_N = std::numeric_limits<double>::infinity();
  /// Pose of the patient in the world with the object not rotated: centre of the volume at the world's
  /// origin, patient supine and viewed from the feet (right = patient's left, forward = superior, up =
  /// anterior).
  Transform<World, Patient> X_WorldPatient;

  /// Tool of a device, index from 0. Devices beyond the list have the first tool.
  const Tool& tool_of(std::size_t device) const { return tools[device < tools.size() ? device : 0]; }
  /// Whether any tool is a burr.
  bool has_burr() const {
    return std::any_of(tools.begin(), tools.end(), [](const Tool& tool) { return tool.burr.has_value(); });
  }
  const Segment* find(const std::string& name) const;
  const Segment* find(LabelId id) const;
  /// Tissue of a label; nullptr if it belongs to none.
  const Tissue* tissue_of(LabelId id) const {
    const int tissue = id < tissue_of_label.size() ? tissue_of_label[id] : -1;
    return tissue >= 0 ? &tissues[tissue] : nullptr;
  }
  /// Whether the tissue deforms elastically under the model's law.
  bool is_deformable(const Tissue& tissue) const {
    return is_elastic(tissue_law) && tissue.elastic.has_value();
  }
  /// Whether the tissue moves visibly under the model's law.
  bool moves_visibly(const Tissue& tissue) const {
    return is_moving(tissue_law) && tissue.elastic.has_value();
  }
  /// Whether the method is prepared.
  bool has(ForceMethod method) const {
    return method == ForceMethod::kProxy ? !surfaces.empty() : methods[index_of(method)] != nullptr;
  }
  /// Method by which a tick renders: the requested one if it is prepared, otherwise the trilinear one, or the
  /// proxy in a model without direct methods.
  ForceMethod rendered_method(ForceMethod method) const {
    if (has(method)) return method;
    return has(ForceMethod::kTrilinear) ? ForceMethod::kTrilinear : ForceMethod::kProxy;
  }
  /// Force field of a direct method; of the trilinear method if it is not prepared or not direct. Requires
  /// `field`.
  const ForceField& force_field(ForceMethod method) const {
    return *methods[has(method) && method != ForceMethod::kProxy ? index_of(method) : 0];
  }
  /// Maximum stiffness of the touchable tissues, N/mm; the stiffness at field value 1.
  double max_stiffness_N_per_mm() const;
  /// Name of the label, or e.g. "label 7" if it has none.
  std::string name_of(LabelId id) const;
  /// Structures in which the label is nested, as a suffix of its name: " (within liver)". Empty: none.
  std::string enclosing_suffix(LabelId id) const;
  /// Labels in which this one is nested, smallest first.
  std::span<const LabelId> enclosing_of(LabelId id) const {
    return id < enclosing.size() ? std::span<const LabelId>(enclosing[id]) : std::span<const LabelId>();
  }
  /// Whether the label belongs to a tissue that can be touched.
  bool is_touchable(LabelId id) const {
    const Tissue* tissue = tissue_of(id);
    return tissue != nullptr && tissue->touchable;
  }
};

/// Collective name of the model's burrs, e.g. "burr or shaver". Empty: there is none.
std::string cutter_name(const Model& model);

/// Pose of a supine patient viewed from the feet, with the centre of the grid at World's origin
/// (Model::X_WorldPatient).
Transform<World, Patient> supine_from_feet(const GridGeometry& grid);
/// Pose of the patient while the object is rotated by `rotation` about the world's origin.
inline Transform<World, Patient> rotated_object_pose(const Transform<World, Patient>& X_WorldPatient,
                                                     const Eigen::Quaterniond& rotation) {
  return Transform<World, World>(Rotation<World, World>(rotation), Vector<World>()) * X_WorldPatient;
}

/// Viscous force -c v, N. It is scaled by the relative depth, so that it sets in continuously.
/// @param inside          field value over the tissue's level, clamped to 0 ... 1
/// @param max_N_s_per_mm  limit of the viscosity
Vector<Patient> viscous_force(const Tissue& tissue, const Vector<Patient>& velocity_mm_s, double inside,
                              double max_N_s_per_mm = std::numeric_limits<double>::infinity());

}  // namespace palpate
