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

#include "palpate/base/progress.h"
#include "palpate/haptics/distances.h"
#include "palpate/haptics/elastic_constants.h"
#include "palpate/haptics/feel.h"
#include "palpate/haptics/force_field.h"
#include "palpate/haptics/no_go.h"
#include "palpate/haptics/proxy.h"
#include "palpate/haptics/relaxation.h"
#include "palpate/volume/bricks.h"
#include "palpate/volume/volume.h"

/// What is felt, and the laws by which it is felt: pure functions of state.
namespace palpate {

/// What becomes of a structure that a burr comes to.
enum class Protection : std::uint8_t {
  kNone,   ///< it is cut as any other
  kAlarm,  ///< it is cut, and that is said: who trains is to see the damage
  kKeep,   ///< the burr is held out of it, and nothing of it is taken away
};

/// How soft tissue gives way to a tool.
enum class TissueLaw : std::uint8_t {
  kLayers,   ///< each structure holds the tool out by its own stiffness, and nothing moves
  kElastic,  ///< what has ElasticConstants is an elastic body that yields and spreads
             ///< (docs/concepts/tissue.md)
  /// The same body as a neo-Hookean one where that has a solution, else as a linear one.
  kNeoHookean,
  /// Forces of the layers, and what has ElasticConstants is seen to move as a chain mail does
  /// (palpate/tissue/chain_mail.h).
  kChainMail,
};
/// Whether what has ElasticConstants yields by it.
constexpr bool is_elastic(TissueLaw law) {
  return law == TissueLaw::kElastic || law == TissueLaw::kNeoHookean;
}
/// Whether it is seen to move.
constexpr bool is_moving(TissueLaw law) {
  return law != TissueLaw::kLayers;
}

/// A group of labels that feel alike.
struct Tissue {
  std::string name;
  bool felt = true;  ///< false: shown, not felt
  double stiffness_N_per_mm = 1.0;
  double friction_coefficient = 0.1;  ///< cap of the tangential force relative to the normal one
  double static_friction = 0.1;       ///< of the proxy: coefficient up to which it sticks
  double puncture_N = std::numeric_limits<double>::infinity();  ///< of the proxy: force that goes through
  bool stays_open = false;  ///< where it was gone through: no force is needed there a second time
  double friction_damping_N_s_per_mm = 0.005;
  double friction_max_N = 0.5;  ///< preset cap of the tangential force (as published)
  double viscosity_N_s_per_mm = 0.001;
  /// Of the tool's motor, to take a cubic millimetre away: specific energy of cutting, mJ/mm3. Above 0. The
  /// default is that of cortical bone under a burr (docs/decisions/0029-removal.md).
  double cutting_energy_mJ_per_mm3 = 100;
  Protection protection = Protection::kNone;
  /// Of the elastic laws, without effect under layers. Empty: it does not yield (bone, a tooth, an
  /// implant), and what is soft holds fast to it.
  std::optional<ElasticConstants> elastic;
  /// Of the same law: how its force falls while it is held; `elastic` is what it has at once.
  Relaxation relaxation;
  Rgb colour;
  double opacity = 1.0;
  std::vector<int> rests_on;  ///< indices of tissues that support this one
};

/// The largest radius of a tool's sphere or capsule: a finger's.
inline constexpr double kWidestTool_mm = 12;

/// A part of an instrument that is long: a shaft, a hook. A cylinder with round ends.
struct ToolCapsule {
  Eigen::Vector3d from_mm, to_mm;  ///< ends of its axis, in the tip's frame; not the same
  double radius_mm = 0;
};

/// What makes the tool's sphere a burr (palpate/tissue/removal.h): a head that turns and takes away what it
/// touches. The tool's sphere is a ball, or the first of a row of balls.
struct BurrSettings {
  double revolutions_per_s = 1000;      ///< while its motor runs; above 0
  double grip = 0.5;                    ///< Burr::grip
  Eigen::Vector3d spindle = {0, 0, 1};  ///< its axis, unit, in the tip's frame
  int pedal = -1;            ///< the device's button that runs the motor while it is held; -1: none does
  double length_mm = 0;      ///< Burr::length_mm: of the row, from middle to middle; 0: a ball
  double end_radius_mm = 0;  ///< Burr::end_radius_mm
  bool shaver = false;       ///< it is for what is soft, and is called so; nothing else follows from that
};

/// The instrument: spheres and capsules fixed to the tip's frame (a point tool has one sphere of radius 0, at
/// the origin). The direct methods feel the spheres' centres, the proxy feels all of it.
struct Tool {
  std::string name = "point";
  std::vector<Eigen::Vector3d> points_mm{Eigen::Vector3d::Zero()};  ///< 1 ... kMaxToolParts
  double radius_mm = 0;                                             ///< of every one
  std::vector<ToolCapsule> capsules;                                ///< with the points at most kMaxToolParts
  /// Then it has one sphere at the origin, from which the burr's row goes on, and nothing else, and the proxy
  /// alone feels what it takes away.
  std::optional<BurrSettings> burr;

  /// Whether a burr's motor is on. @param switched_on  by its switch  @param buttons  of the device that
  /// holds it
  bool motor_is_on(bool switched_on, std::uint32_t buttons) const {
    return burr && (switched_on || (burr->pedal >= 0 && (buttons >> burr->pedal & 1u) != 0));
  }
};
inline constexpr int kMaxToolParts = static_cast<int>(kMostToolSpheres);

/// "ball", "cylinder" or "cone"; empty: the tool is no burr.
std::string burr_shape(const Tool& tool);
/// "burr" or "shaver"; empty: the tool is neither.
std::string cutter_name(const Tool& tool);
/// In words, such as "burr: a cone of 2.3 mm, 1.2 mm at its tip, 8 mm long"; empty: the tool is no burr.
std::string burr_in_words(const Tool& tool);

/// Whose side a scan shows: of a limb, or of both (head, torso) where no side mark is needed.
enum class Side : std::uint8_t { kUnknown, kLeft, kRight, kBoth };

/// What a limitation of a model concerns.
enum class CaveatKind : std::uint8_t {
  kPlacement,  ///< where labels or scan lie in the patient
  kSide,       ///< which side of the patient the scan shows
  kForce,      ///< what is felt
};
/// A limitation of a model that loading found.
struct Caveat {
  CaveatKind kind = CaveatKind::kForce;
  std::string text;  ///< one sentence without file names, for report and page
};

class Carving;

/// Everything a tick reads, prepared once and never edited: a new version replaces it. Parts that did
/// not change are shared between versions.
struct Model {
  std::uint32_t version = 1;
  /// So many of the versions up to this one were local edits, which took away or put back and changed nothing
  /// else: their forces are not blended in, and what they left alone is felt on as if there had been none.
  std::uint32_t edits = 0;
  std::uint64_t content_hash = 0;  ///< of field, labels, tissues, tools, limits and the methods' settings
  std::uint64_t uncut_hash = 0;    ///< what it would be with nothing taken away
  std::string title;
  Side side = Side::kUnknown;
  bool side_from_anatomy = false;  ///< the scene does not say it; it follows from where the fibula lies
  bool oriented = true;            ///< false: the files do not say how the volume lies in the patient
  std::vector<Caveat> caveats;

  std::shared_ptr<const Field> field;  ///< what the direct methods read: ramps, or smoothed labels
  /// Flattened, on the field's grid, background around it (label_bricks).
  std::shared_ptr<const Bricks<LabelId>> labels;
  std::shared_ptr<const Volume<float>> scan;  ///< on the same grid; may be null
  std::vector<Segment> segments;              ///< names and colours by id
  /// The segments in which each one is nested (palpate/volume/overlaps.h), smallest first. Index by LabelId;
  /// labels beyond the end are nested in none.
  std::vector<std::vector<LabelId>> enclosing;
  std::vector<Tissue> tissues;
  std::vector<std::int16_t> tissue_of_label;  ///< index by LabelId; -1: belongs to no tissue
  /// Stiffness over the greatest, 0 ... 1; what smoothed labels have deep inside that label.
  std::vector<float> level_of_label;

  /// What the direct methods' forces are computed from, by ForceMethod; null: not prepared. The trilinear one
  /// always is.
  std::array<std::shared_ptr<const ForceField>, kDirectMethods.size()> methods;
  /// What the proxy leans on: one for each felt structure, then the outer surfaces of those that touch.
  /// Empty: not prepared.
  std::vector<FeltSurface> surfaces;
  /// Of the structures' surfaces.
  std::vector<LabelId> label_of_surface;
  /// Felt structures that a burr is to spare, with what they were before anything was taken away. Without a
  /// burr none.
  std::vector<ProtectedStructure> protected_structures;
  /// Of what the tool's distances are to be told in every tick.
  ToldDistances told_distances;
  /// What the tool is to keep out of, at most kMostNoGo.
  std::vector<NoGoRegion> no_go;
  /// The structures of both. None: not prepared, or there are none.
  Distances distances;
  /// What was taken from the surfaces (palpate/tissue/carving.h). null: nothing.
  std::shared_ptr<const Carving> carving;
  MethodSettings method_settings;
  TissueLaw tissue_law = TissueLaw::kLayers;
  double tissue_cell_mm = 0;  ///< edge of the elastic laws' cells; 0: chosen from the voxels
  /// They are so many times as long, and as many fewer along each axis, as a machine asks for on which a
  /// frame would take too long. At least 1; of a session and not of a scene, and so in no content hash.
  double tissue_coarsened = 1;
  /// Those of all tissues that yield and relax; none: nothing relaxes.
  RelaxationTimes relaxation_times;

  double sigma_mm = 1.0;  ///< smoothing that made the field, unless it has ramps
  double ramp_width_mm =
      0;  ///< of the inward ramps that the field has (palpate/surfaces/ramps.h); 0: it has none
  /// How far to look for the structure that is felt at a place, and for its surface: a smoothed field is felt
  /// that far from it, ramps only inside, at most that deep.
  double reach_mm = 5.0;
  /// What the first device of a session holds, what the second holds, and so on: at least one.
  std::vector<Tool> tools{Tool()};
  double scene_max_force_N = std::numeric_limits<double>::infinity();  ///< infinite: the scene sets none
  /// Where the patient lies in the workspace when the object is not rotated: the volume's centre at
  /// World's origin, patient supine, seen from the feet (right = patient's left, forward = superior,
  /// up = anterior).
  Transform<World, Patient> X_WorldPatient;

  /// What a device of a session holds, 0 the first. Beyond the last of the tools it holds what the first
  /// does.
  const Tool& tool_of(std::size_t device) const { return tools[device < tools.size() ? device : 0]; }
  /// Whether any of the tools takes tissue away.
  bool cuts() const {
    return std::any_of(tools.begin(), tools.end(), [](const Tool& tool) { return tool.burr.has_value(); });
  }
  const Segment* find(const std::string& name) const;
  const Segment* find(LabelId id) const;
  /// The tissue of a label, or nullptr when it belongs to none.
  const Tissue* tissue_of(LabelId id) const {
    const int tissue = id < tissue_of_label.size() ? tissue_of_label[id] : -1;
    return tissue >= 0 ? &tissues[tissue] : nullptr;
  }
  /// Whether it gives way as an elastic body.
  bool yields(const Tissue& tissue) const { return is_elastic(tissue_law) && tissue.elastic.has_value(); }
  bool moves(const Tissue& tissue) const { return is_moving(tissue_law) && tissue.elastic.has_value(); }
  bool has(ForceMethod method) const {
    return method == ForceMethod::kProxy ? !surfaces.empty() : methods[index_of(method)] != nullptr;
  }
  /// The direct method, or the trilinear one where it is not prepared or not direct.
  const ForceField& force_field(ForceMethod method) const {
    return *methods[has(method) && method != ForceMethod::kProxy ? index_of(method) : 0];
  }
  /// N/mm, of the tissues that are felt: where the field is 1.
  double greatest_stiffness_N_per_mm() const;
  /// Its name, or "label 7" where it has none.
  std::string name_of(LabelId id) const;
  /// The segments in which it is nested, to stand behind its name: " (within liver)"; empty where there are
  /// none.
  std::string enclosing_in_words(LabelId id) const;
  /// The labels in which this one is nested, smallest first.
  std::span<const LabelId> enclosing_of(LabelId id) const {
    return id < enclosing.size() ? std::span<const LabelId>(enclosing[id]) : std::span<const LabelId>();
  }
  bool is_felt(LabelId id) const {
    const Tissue* tissue = tissue_of(id);
    return tissue != nullptr && tissue->felt;
  }
};

/// Of all tools of a model, such as "burr or shaver"; empty: none cuts.
std::string cutter_name(const Model& model);

/// One method for a model whose field, labels, levels, tissues and settings are there. Every method pushes
/// with the stiffest tissue's stiffness at that tissue's flat surface; how far the force climbs from there
/// follows from the method's own width (docs/concepts/methods.md). Errors: kBadInput where a sphere's width
/// does not suit the voxels.
Result<std::shared_ptr<const ForceField>> make_force_field(const Model& model, ForceMethod method);

/// Whether make_force_field would make it, as far as that is known before anything is made. Errors: its own.
Result<void> check_force_field(const Model& model, ForceMethod method);
/// What making it takes at most at a time, besides the model; bytes.
std::uint64_t memory_of_force_field(const Model& model, ForceMethod method);

/// The same model, ready for these methods as well; itself where it already is. What is added changes neither
/// version nor content hash. Direct methods alone; palpate/loading/loading.h prepares the proxy's surfaces
/// too. Errors: those of make_force_field, kInterrupted.
Result<std::shared_ptr<const Model>> with_methods(std::shared_ptr<const Model> model,
                                                  std::span<const ForceMethod> methods,
                                                  const Progress& progress = {});

/// The placement that Model::X_WorldPatient describes, for a grid.
Transform<World, Patient> supine_from_feet(const GridGeometry& grid);
/// Where the patient lies while the object is turned by `felt` about World's origin.
inline Transform<World, Patient> turned_object(const Transform<World, Patient>& X_WorldPatient,
                                               const Eigen::Quaterniond& felt) {
  return Transform<World, World>(Rotation<World, World>(felt), Vector<World>()) * X_WorldPatient;
}

/// Which structure is met at a point of the field, and how deep.
struct ContactSite {
  LabelId label = 0;  ///< 0: none within reach
  int tissue = -1;
  double level = 0;     ///< field value where it is entered: of smoothed labels deep inside, of ramps at 1 mm
  double depth_mm = 0;  ///< tip below (> 0) or above (< 0) the structure's surface, along the normal
};

/// The first felt label on the way inward along the normal, within Model::reach_mm, in half voxels; where
/// that way meets none (in a valley between two structures, deep inside where there is no normal) the nearest
/// one along 14 directions. Its surface is the same place for every force method: where a smoothed field is
/// midway between its own level and that of the felt label that covers it, or free space; of ramps the border
/// of its voxels. Bounded: at most a few hundred voxels are looked at.
/// @param sample  the force method's, whose gradient tells the normal
ContactSite find_contact_site(const Model& model, const Point<Patient>& x, const FieldSample& sample);

/// Velocity over a window of time: sum of displacements over sum of times of the last
/// `window_s` seconds (MERL c. 1997; 0.01 s), never a one-tick difference. Kept as running sums, so that a
/// push costs the same at every rate.
class VelocityWindow {
 public:
  static constexpr int kCapacity = 128;  ///< holds 0.01 s at up to 10 kHz with room to spare
  void push(const Vector<Patient>& displacement_mm, double dt_s,
            double window_s = kTouchFeel.velocity_window_s);
  /// mm/s; zero before the first push.
  Vector<Patient> velocity_mm_s() const;
  void clear() { *this = {}; }
  /// Mixes everything pushed since it was cleared into a state hash.
  void hash_into(std::uint64_t& hash) const;

 private:
  // where the sum of all pushes stood after one of them
  struct Sum {
    Vector<Patient> way_mm;
    double time_s = 0;
  };
  Sum now_, before_window_;
  std::array<Sum, kCapacity> sums_;
  int first_ = 0, count_ = 0;
  std::uint64_t pushed_ = 0;  // hash of every push
};

/// Viscosity: -c v, scaled by how far the tip is inside (field over the tissue's level, 0 ... 1), so
/// that it enters without a step. N.
/// @param most_N_s_per_mm  of its viscosity
Vector<Patient> viscous_force(const Tissue& tissue, const Vector<Patient>& velocity_mm_s, double inside,
                              double most_N_s_per_mm = std::numeric_limits<double>::infinity());

/// The published pseudo-friction: a viscous force along the surface, capped at the tissue's maximum
/// and at mu |F_n|. N.
/// @param most_N_s_per_mm  of its damping
Vector<Patient> pseudo_friction(const Tissue& tissue, const Vector<Patient>& velocity_mm_s,
                                const Vector<Patient>& normal_force_N,
                                double most_N_s_per_mm = std::numeric_limits<double>::infinity());

}  // namespace palpate
