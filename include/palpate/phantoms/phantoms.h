#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"
#include "palpate/volume/label_map.h"
#include "palpate/volume/volume.h"

/// Generated phantoms, composed of geometric primitives (palpate/phantoms/primitives.h): a knee, a hollow
/// shell, a skull, a gland in front of a jaw, three for palpation of deformable tissue (a block and a dome
/// with nodules, and an abdominal wall), and a temporal bone to drill. Each has parameters. A phantom is
/// referred to by a name with its parameters, "knee-phantom:lesion=6,side=right", wherever the name of a data
/// set is accepted. docs/reference/phantom.md shows them and documents every key.
namespace palpate {

/// Generated volume: labels and a simulated scan, on one grid aligned with the patient's axes.
struct Phantom {
  LabelMap labels;
  Volume<float> scan;  ///< With partial volume and seeded noise; MR in arbitrary units, CT in HU.
};

/// Parameters common to all phantoms. The ranges are those of the keys in docs/reference/phantom.md.
struct PhantomSettings {
  Eigen::Vector3d spacing_mm{0.6, 0.6, 0.6};
  /// Seed of the natural variation and of the segmentation noise; 0: the mean shape.
  std::uint64_t seed = 0;
  double noise_mm = 0;          ///< Standard deviation of the jitter of segmented borders.
  std::uint64_t islands = 0;    ///< Number of stray islands, and of holes, in the segmentation.
  std::uint64_t scan_seed = 1;  ///< Seed of the scan noise.
};

enum class BodySide : std::uint8_t { kLeft, kRight };

/// Knee in extension, with the structures, names and label numbers of the SPL knee atlas.
struct KneeParameters {
  PhantomSettings settings{};
  BodySide side = BodySide::kLeft;
  double size = 1;                              ///< Scale of all dimensions except those in mm below.
  double lesion_mm = 0;                         ///< Radius of a lesion; 0: none.
  std::string lesion_in = "femur";              ///< Structure that contains the lesion.
  double lesion_depth_mm = 0;                   ///< Depth of the lesion's centre below the structure's
                                                ///< surface.
  double defect_mm = 0;                         ///< Radius of a full-thickness cartilage defect; 0: none.
  std::string defect_in = "femoral_cartilage";  ///< Cartilage with the defect.
  std::vector<std::string> missing{};           ///< Omitted cartilages, menisci and ligaments; ascending.
  double burr_mm = 0;           ///< Diameter of the burr used as tool in the phantom's own scene; 0: none.
  std::uint64_t lesion_at = 0;  ///< Index of the lesion's site on its structure; cartilages have several.
  bool visible = true;          ///< The scan shows the lesion; labels always do.
};

/// Closed hollow sphere with air inside and outside.
struct ShellParameters {
  PhantomSettings settings{};
  double radius_mm = 30;    ///< Outer radius.
  double thickness_mm = 3;  ///< Wall thickness; at least the diagonal of a voxel, so that the wall is closed.
};

/// Cranium with thin temporal walls, and orbits connected to it only by narrow canals.
struct SkullParameters {
  PhantomSettings settings{.spacing_mm = {1, 1, 1}};
  double size = 1;          ///< Scale of everything except the walls.
  double thickness_mm = 6;  ///< Thickness of the wall.
  double temporal_mm = 2;   ///< Thickness of the wall at the temples and of the orbits; at most thickness_mm.
  bool brain = true;
};

/// Soft gland on the front of a mandible-like arch, below layers of fat and skin.
struct GlandParameters {
  PhantomSettings settings{};
  double size = 1;       ///< Scale of the jaw.
  double gland_mm = 25;  ///< Length of the gland.
  double fat_mm = 0;     ///< Thickness of the layer over jaw and gland; 0: none.
  double skin_mm = 0;    ///< Thickness of the layer over the fat; 0: none.
};

/// Hard spheres of equal size in soft tissue, with centres at least 1.5 diameters apart. Their positions are
/// determined by the seed.
struct NoduleParameters {
  std::uint64_t nodules = 1;
  double diameter_mm = 8;
  double depth_mm = 5;    ///< Soft tissue over each nodule, along the surface normal.
  double stiffness = 10;  ///< Ratio of the Young's moduli of nodule and tissue, in the phantom's own scene.
  bool visible = false;   ///< The scan shows the nodules; labels always do.
};

/// Soft tissue on a rigid plate, with nodules.
struct BlockParameters {
  PhantomSettings settings{.spacing_mm = {1, 1, 1}};
  NoduleParameters nodules{};
  double width_mm = 80;  ///< Extent along x and z.
  double thickness_mm = 40;
};

/// Soft tissue with nodules on a rigid plate, in the shape of half an ellipsoid, like a breast.
struct DomeParameters {
  PhantomSettings settings{.spacing_mm = {1, 1, 1}};
  NoduleParameters nodules{};
  double radius_mm = 40;  ///< Radius of the base.
  double height_mm = 35;
};

/// Skin, fat and muscle over a liver with a firm lower edge and over a rib.
struct AbdomenParameters {
  PhantomSettings settings{.spacing_mm = {1, 1, 1}};
  double skin_mm = 2;
  double fat_mm = 10;  ///< 0: none.
  double muscle_mm = 8;
  double edge_mm = 5;  ///< Radius of the liver's firm edge; 0: none.
  bool rib = true;
};

/// Temporal bone: a mastoid with cortex and air cells between ear canal, sigmoid sinus and dura, with facial
/// nerve and ossicles, as it is drilled in a mastoidectomy.
struct TemporalBoneParameters {
  PhantomSettings settings{.spacing_mm = {0.4, 0.4, 0.4}};
  BodySide side = BodySide::kLeft;
  double cells_mm = 3;    ///< Mean diameter of the air cells; 0: a mastoid without cells.
  double cortex_mm = 2;   ///< Thickness of the cortex over the air cells.
  double plate_mm = 1.2;  ///< Thickness of the plates of bone over dura and sigmoid sinus.
};

using PhantomParameters =
    std::variant<KneeParameters, ShellParameters, SkullParameters, GlandParameters, BlockParameters,
                 DomeParameters, AbdomenParameters, TemporalBoneParameters>;

/// Names of the data sets that are phantoms: "knee-phantom", "shell-phantom", "skull-phantom",
/// "gland-phantom", "palpation-block", "palpation-dome", "abdominal-wall", "temporal-bone".
const std::vector<std::string>& phantom_names();
/// True if a name is one of these, with or without parameters, which are not checked.
bool is_phantom_name(std::string_view name);

/// Parses NAME or NAME:KEY=VALUE,KEY=VALUE... Errors: kBadInput for an unknown name or key, with the known
/// ones and their ranges; for a key given twice, a value out of range, and parameters rejected by
/// make_phantom().
Result<PhantomParameters> parse_phantom(std::string_view name);
/// Canonical name of the parameters: keys in alphabetical order, without those at their default. It parses to
/// the same parameters.
std::string phantom_name(const PhantomParameters& parameters);

/// Generates a phantom; bit-identical for equal parameters and any number of threads. Errors: kBadInput for a
/// value out of range, a wall too thin or a lesion too small for the voxels, and more than 200 million
/// voxels, all before memory is allocated; kInterrupted.
Result<Phantom> make_phantom(const PhantomParameters& parameters, const Progress& progress = {});
/// Properties of a phantom that are known before it is generated.
struct PhantomWithoutVoxels {
  GridGeometry grid;
  std::vector<Segment> segments;
};
/// Grid and segments that make_phantom() will produce for the same parameters. Errors: kBadInput as there.
Result<PhantomWithoutVoxels> phantom_without_voxels(const PhantomParameters& parameters);
/// Nodule of a block or dome.
struct PhantomNodule {
  Point<Patient> centre;
  double radius_mm = 0;
  Point<Patient> surface;  ///< Nearest point of the tissue's surface.
};
/// Nodules of a block or dome in the order in which they were placed; empty for other phantoms. Errors:
/// kBadInput as for make_phantom().
Result<std::vector<PhantomNodule>> phantom_nodules(const PhantomParameters& parameters);
/// Nodule parameters of a block or dome; nullptr for other phantoms.
const NoduleParameters* nodule_parameters(const PhantomParameters& parameters);

/// Generates the mean knee with voxels of `voxel_mm` and this seed of the scan noise.
Result<Phantom> make_knee_phantom(double voxel_mm = 0.6, std::uint64_t scan_seed = 1,
                                  const Progress& progress = {});

/// Markdown tables of every key of every phantom (key, value, default, unit, range, meaning), from the
/// declarations that the parser uses.
std::string phantom_keys();

}  // namespace palpate
