#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"
#include "palpate/volume/volume.h"

/// Generated stand-ins for patients, made of primitives (palpate/phantoms/primitives.h): a knee, a hollow
/// shell, a skull, a gland before a jaw, and three to be palpated through what yields: a block and a dome
/// with nodules, and an abdominal wall. Each has parameters. A phantom is told by a name with its
/// parameters, "knee-phantom:lesion=6,side=right", wherever the name of a data set stands.
/// docs/reference/phantom.md draws them and documents every key.
namespace palpate {

/// A generated volume: labels, and what a scanner would show of it, on one grid with the patient's axes.
struct Phantom {
  LabelMap labels;
  Volume<float> scan;  ///< with partial volume and seeded noise; MR in arbitrary units, CT in HU
};

/// What every phantom can be told. Ranges are those of the keys in docs/reference/phantom.md.
struct PhantomSettings {
  Eigen::Vector3d spacing_mm{0.6, 0.6, 0.6};
  /// Of natural variation and of the segmentation's noise; 0 is the mean shape.
  std::uint64_t seed = 0;
  double noise_mm = 0;          ///< standard deviation of the jitter of segmented borders
  std::uint64_t islands = 0;    ///< stray islands, and as many holes, in the segmentation
  std::uint64_t scan_seed = 1;  ///< of the noise in the scan
};

enum class KneeSide : std::uint8_t { kLeft, kRight };

/// A knee in extension with the structures, names and label numbers of the SPL knee atlas.
struct KneeParameters {
  PhantomSettings settings{};
  KneeSide side = KneeSide::kLeft;
  double size = 1;                              ///< of everything but what is in mm below
  double lesion_mm = 0;                         ///< radius; 0: none
  std::string lesion_in = "femur";              ///< structure
  double lesion_depth_mm = 0;                   ///< of its centre below the structure's surface
  double defect_mm = 0;                         ///< radius of a full-thickness defect; 0: none
  std::string defect_in = "femoral_cartilage";  ///< cartilage
  std::vector<std::string> missing{};           ///< cartilages, menisci, ligaments; ascending
  double burr_mm = 0;           ///< diameter of the burr that the phantom's own scene has for a tool; 0: none
  std::uint64_t lesion_at = 0;  ///< which of its structure's places; cartilages have several
  bool visible = true;          ///< whether the scan shows the lesion; labels always do
};

/// A closed hollow ball, air inside and outside.
struct ShellParameters {
  PhantomSettings settings{};
  double radius_mm = 30;    ///< outer
  double thickness_mm = 3;  ///< at least the diagonal of a voxel: it lets nothing through
};

/// A cranium with thin temporal walls, and orbits that open into it by a narrow canal only.
struct SkullParameters {
  PhantomSettings settings{.spacing_mm = {1, 1, 1}};
  double size = 1;          ///< of everything but the walls
  double thickness_mm = 6;  ///< of the wall
  double temporal_mm = 2;   ///< of the wall at the temples and of the orbits'; at most thickness_mm
  bool brain = true;
};

/// A soft gland that lies on a mandible-like arch from in front, below layers of fat and skin.
struct GlandParameters {
  PhantomSettings settings{};
  double size = 1;       ///< of the jaw
  double gland_mm = 25;  ///< length
  double fat_mm = 0;     ///< thickness of the layer over jaw and gland; 0: none
  double skin_mm = 0;    ///< thickness of the layer over that; 0: none
};

/// Hard balls of one size in soft tissue, no two nearer to each other than 1.5 diameters from middle to
/// middle. Where they lie follows from the seed.
struct NoduleParameters {
  std::uint64_t nodules = 1;
  double diameter_mm = 8;
  double depth_mm = 5;    ///< of soft tissue over each, along the surface's normal
  double stiffness = 10;  ///< Young's modulus of a nodule over that of the tissue, in the phantom's own scene
  bool visible = false;   ///< whether the scan shows them; labels always do
};

/// Soft tissue on a rigid plate.
struct BlockParameters {
  PhantomSettings settings{.spacing_mm = {1, 1, 1}};
  NoduleParameters nodules{};
  double width_mm = 80;  ///< along x and z
  double thickness_mm = 40;
};

/// The same as half an ellipsoid, as a breast.
struct DomeParameters {
  PhantomSettings settings{.spacing_mm = {1, 1, 1}};
  NoduleParameters nodules{};
  double radius_mm = 40;  ///< of its base
  double height_mm = 35;
};

/// Skin, fat and muscle over a liver with a firm lower edge and over a rib.
struct AbdomenParameters {
  PhantomSettings settings{.spacing_mm = {1, 1, 1}};
  double skin_mm = 2;
  double fat_mm = 10;  ///< 0: none
  double muscle_mm = 8;
  double edge_mm = 5;  ///< radius of the liver's firm edge; 0: none
  bool rib = true;
};

using PhantomParameters = std::variant<KneeParameters, ShellParameters, SkullParameters, GlandParameters,
                                       BlockParameters, DomeParameters, AbdomenParameters>;

/// The data sets that are phantoms: "knee-phantom", "shell-phantom", "skull-phantom", "gland-phantom",
/// "palpation-block", "palpation-dome", "abdominal-wall".
const std::vector<std::string>& phantom_names();
/// Whether a name is one of these, with or without parameters, right or wrong.
bool is_phantom_name(std::string_view name);

/// NAME or NAME:KEY=VALUE,KEY=VALUE... Error kBadInput for an unknown name or key, with the known ones and
/// their ranges, a key given twice, a value out of range, and what make_phantom() refuses.
Result<PhantomParameters> parse_phantom(std::string_view name);
/// The one name of these parameters: keys in alphabetical order, those with their default left out. It
/// parses to the same parameters.
std::string phantom_name(const PhantomParameters& parameters);

/// The same parameters give the same bits, with any number of threads.
/// Errors: kBadInput for a value out of range, a wall too thin or a lesion too small for the voxels, and more
/// than 200 million voxels, all before memory is taken; kInterrupted.
Result<Phantom> make_phantom(const PhantomParameters& parameters, const Progress& progress = {});
/// What of a phantom is known before it is made.
struct PhantomWithoutVoxels {
  GridGeometry grid;
  std::vector<Segment> segments;
};
/// Those of make_phantom() with the same parameters. Errors: kBadInput as there.
Result<PhantomWithoutVoxels> phantom_without_voxels(const PhantomParameters& parameters);
/// A nodule of a block or dome.
struct PhantomNodule {
  Point<Patient> centre;
  double radius_mm = 0;
  Point<Patient> surface;  ///< the place on the tissue's surface that is nearest to it
};
/// Where a phantom's nodules lie, in the order in which they were placed; of other phantoms than block and
/// dome none. Errors: kBadInput as of make_phantom().
Result<std::vector<PhantomNodule>> phantom_nodules(const PhantomParameters& parameters);
/// What a block or dome has besides its tissue; null: it is another phantom.
const NoduleParameters* nodule_parameters(const PhantomParameters& parameters);

/// The mean knee with voxels of `voxel_mm` and this seed of the scan's noise.
Result<Phantom> make_knee_phantom(double voxel_mm = 0.6, std::uint64_t scan_seed = 1,
                                  const Progress& progress = {});

/// Every key of every phantom as Markdown tables (key, value, default, unit, range, meaning), from the
/// declarations that the parser checks against.
std::string phantom_keys();

}  // namespace palpate
