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

#include "palpate/base/contact_properties.h"
#include "palpate/base/force_method.h"
#include "palpate/contact/contact_settings.h"
#include "palpate/contact/distances.h"
#include "palpate/contact/elastic_constants.h"
#include "palpate/contact/method_settings.h"
#include "palpate/contact/no_go.h"
#include "palpate/contact/proxy.h"
#include "palpate/contact/relaxation.h"
#include "palpate/sampling/sampling.h"
#include "palpate/volume/bricks.h"
#include "palpate/volume/volume.h"

/// The model that is rendered, and its force laws as pure functions of state.
namespace palpate {

/// Effect of a burr on a structure.
enum class Protection : std::uint8_t {
  kNone,   ///< The structure is cut like any other
  kAlarm,  ///< The structure is cut, and the damage is reported, e.g. to a trainee
  kBlock,  ///< The burr cannot enter the structure or remove any of it
};

/// Constitutive law of soft tissue under a tool.
enum class TissueLaw : std::uint8_t {
  kLayers,   ///< Rigid geometry: each structure resists by its own spring stiffness
  kElastic,  ///< Tissues with ElasticConstants are linear elastic bodies (docs/concepts/tissue.md)
  /// Tissues with ElasticConstants are neo-Hookean bodies where the solver finds such a solution, otherwise
  /// linear elastic.
  kNeoHookean,
  /// Forces as in kLayers; tissues with ElasticConstants move visibly as a chain mail
  /// (palpate/tissue/chain_mail.h).
  kChainMail,
  /// As kNeoHookean; tissues with ElasticConstants::stiffening also stiffen exponentially with strain.
  kExponential,
};
/// Whether bodies under this law are solved with large strains.
constexpr bool is_hyperelastic(TissueLaw law) {
  return law == TissueLaw::kNeoHookean || law == TissueLaw::kExponential;
}
/// Whether tissues with ElasticConstants deform elastically under this law.
constexpr bool is_elastic(TissueLaw law) {
  return law == TissueLaw::kElastic || is_hyperelastic(law);
}
/// Whether tissues with ElasticConstants move visibly under this law.
constexpr bool is_moving(TissueLaw law) {
  return law != TissueLaw::kLayers;
}

/// Mechanical and visual properties of a tissue that stay the same while it is rendered.
struct FixedProperties {
  bool touchable = true;  ///< Whether it can be touched; false: displayed only
  /// Proxy: normal force above which the tool punctures it; infinite: never.
  double puncture_N = std::numeric_limits<double>::infinity();
  bool stays_open = false;  ///< Whether a puncture leaves a permanent hole, passed again without force
  /// Direct methods: viscous coefficient of the pseudo-friction.
  double friction_damping_N_s_per_mm = 0.005;
  /// Direct methods: limit of the tangential force of the preset (as published)
  double friction_max_N = 0.5;
  /// Specific cutting energy: work of a burr's motor per volume removed, mJ/mm^3; above 0. The default is
  /// that of cortical bone under a burr (docs/decisions/0029-removal.md).
  double cutting_energy_mJ_per_mm3 = 100;
  Protection protection = Protection::kNone;  ///< Protection from burrs; applies only to touchable tissue
  /// Elastic constants for the elastic laws; ignored by kLayers. Empty: rigid (bone, a tooth, an implant),
  /// and soft tissue adheres to it.
  std::optional<ElasticConstants> elastic;
  /// Stress relaxation under the elastic laws; `elastic` has the instantaneous constants.
  Relaxation relaxation;
  double opacity = 1.0;  ///< Opacity in rendered images, 0 ... 1
};

/// All properties of a tissue, as set in a scene.
struct TissueProperties : ContactProperties, FixedProperties {};

/// A group of labels with common properties.
struct Tissue : TissueProperties {
  std::string name;
  Rgb colour;
  std::vector<int> rests_on;  ///< Indices of tissues that support this one
};

/// Maximum radius of a tool's sphere or capsule, that of a finger.
inline constexpr double kMaxToolRadius_mm = 12;

/// A capsule of a tool, for a shaft or a hook: a cylinder with hemispherical ends.
struct ToolCapsule {
  Eigen::Vector3d from_mm, to_mm;  ///< End points of the axis in the tip's frame; distinct
  double radius_mm = 0;
};

/// Burr settings of a tool (palpate/tissue/removal.h): a rotating head that removes the tissue it touches.
/// The head is the tool's sphere (a ball), or a row of balls that starts with it.
struct BurrSettings {
  double revolutions_per_s = 1000;      ///< Rotation rate while the motor runs; above 0
  double grip = 0.5;                    ///< As Burr::grip
  Eigen::Vector3d spindle = {0, 0, 1};  ///< Axis of rotation in the tip's frame; unit
  int pedal = -1;                       ///< Button of the device that runs the motor while pressed. -1: none
  /// Burr::length_mm: distance between the first and last centre of the row. 0: a ball.
  double length_mm = 0;
  double end_radius_mm = 0;  ///< As Burr::end_radius_mm
  bool shaver = false;       ///< Whether it is a shaver for soft tissue; affects the name only
  int flutes = 8;            ///< Number of cutting edges around the head; at least 1
  bool irrigation = true;    ///< Whether the head is cooled; otherwise the heating of the bone is estimated
};

/// Geometry of the instrument: spheres and capsules fixed in the tip's frame. A point tool is one sphere of
/// radius 0 at the origin. Direct methods evaluate the spheres' centres, the proxy uses the whole geometry.
struct Tool {
  std::string name = "point";
  /// Sphere centres in the tip's frame; 1 ... kMaxToolParts.
  std::vector<Eigen::Vector3d> points_mm{Eigen::Vector3d::Zero()};
  double radius_mm = 0;               ///< Radius of every sphere
  std::vector<ToolCapsule> capsules;  ///< Capsules; at most kMaxToolParts together with the spheres
  /// Burr settings. If set, the tool is a single sphere at the origin, from which the burr's row extends, and
  /// the removal is rendered by the proxy only.
  std::optional<BurrSettings> burr;

  /// Whether the burr's motor runs.
  /// @param switched_on  state of the motor's switch
  /// @param buttons      button bit mask of the tool's device
  bool motor_is_on(bool switched_on, std::uint32_t buttons) const {
    return burr && (switched_on || (burr->pedal >= 0 && (buttons >> burr->pedal & 1u) != 0));
  }
};
inline constexpr int kMaxToolParts = static_cast<int>(kMaxToolSpheres);

/// Shape of the burr: "ball", "cylinder" or "cone". Empty: the tool is not a burr.
std::string burr_shape(const Tool& tool);
/// Name of the burr: "burr" or "shaver". Empty: the tool is neither.
std::string cutter_name(const Tool& tool);
/// Description such as "burr: a cone of 2.3 mm, 1.2 mm at its tip, 8 mm long". Empty: the tool is no burr.
std::string burr_description(const Tool& tool);

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
  Distances distances;
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

/// The pose described at Model::X_WorldPatient for a grid.
Transform<World, Patient> supine_from_feet(const GridGeometry& grid);
/// Pose of the patient while the object is rotated by `rotation` about the world's origin.
inline Transform<World, Patient> rotated_object_pose(const Transform<World, Patient>& X_WorldPatient,
                                                     const Eigen::Quaterniond& rotation) {
  return Transform<World, World>(Rotation<World, World>(rotation), Vector<World>()) * X_WorldPatient;
}

/// Structure in contact at a point of the field, and the depth below its surface.
struct ContactSite {
  LabelId label = 0;  ///< Label of the structure. 0: none within reach
  /// Index of the label's tissue. -1: none.
  int tissue = -1;
  /// Field value at which the structure counts as entered: deep inside it for smoothed labels, at a depth of
  /// 1 mm for ramps.
  double level = 0;
  double depth_mm = 0;  ///< Depth of the tip along the normal; > 0 below the structure's surface, < 0 above
};

/// Velocity over a sliding time window: sum of displacements over sum of times of the last `window_s` seconds
/// (MERL c. 1997; 0.01 s), never a one-tick difference. Stored as running sums, so that a push costs the same
/// at every tick rate.
class VelocityWindow {
 public:
  static constexpr int kCapacity = 128;  ///< Entries; 0.01 s at up to 10 kHz with margin
  void push(const Vector<Patient>& displacement_mm, double dt_s,
            double window_s = kContactSettings.velocity_window_s);
  /// Mean velocity in the window, mm/s; zero before the first push.
  Vector<Patient> velocity_mm_s() const;
  void clear() { *this = {}; }
  /// Mixes all pushes since the last clear() into a state hash.
  void hash_into(std::uint64_t& hash) const;

 private:
  // running sums after a push
  struct Sum {
    Vector<Patient> displacement_mm;
    double time_s = 0;
  };
  Sum now_, before_window_;
  std::array<Sum, kCapacity> sums_;
  int first_ = 0, count_ = 0;
  std::uint64_t pushed_ = 0;  // hash of all pushes
};

/// Viscous force -c v, N. It is scaled by the relative depth, so that it sets in continuously.
/// @param inside           field value over the tissue's level, clamped to 0 ... 1
/// @param max_N_s_per_mm  limit of the viscosity
Vector<Patient> viscous_force(const Tissue& tissue, const Vector<Patient>& velocity_mm_s, double inside,
                              double max_N_s_per_mm = std::numeric_limits<double>::infinity());

}  // namespace palpate
