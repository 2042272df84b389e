#include <cstdio>

#include "phantoms/knee_phantom_anatomy.h"
#include "phantoms/palpation_phantoms.h"
#include "phantoms/phantom_keys.h"
#include "phantoms/phantom_plan.h"

namespace palpate {
namespace {

constexpr double kMaxVoxels = 200e6;

Error refused(const PhantomParameters& parameters, std::string what, std::string remedy) {
  return {ErrorKind::kBadInput, std::move(what), base_name(parameters), std::move(remedy)};
}

std::string millimetres(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g mm", value);
  return text;
}

std::string quoted(const char* key) {
  std::string text(1, '`');
  text += key;
  return text += '`';
}

// a thinner layer would be open where voxels meet at a corner
Result<void> check_thickness(const PhantomParameters& parameters, const char* key, double thickness_mm) {
  const double diagonal_mm = settings_of(parameters).spacing_mm.norm();
  if (thickness_mm >= diagonal_mm) return {};
  return refused(parameters,
                 quoted(key) + " of " + millimetres(thickness_mm) +
                     " is less than the diagonal of a voxel, " + millimetres(diagonal_mm) +
                     ", and would have holes",
                 "make it thicker, or the spacing finer");
}

Result<void> check_together(const PhantomParameters& all, const KneeParameters& knee) {
  const KneeParameters mean;
  const auto needs = [&](const char* key, const char* other) {
    return refused(all, quoted(key) + " without `" + other + "` changes nothing",
                   "give the radius of the " + std::string(other) + " as well");
  };
  if (knee.lesion_mm == 0 && knee.lesion_in != mean.lesion_in) return needs("lesion-in", "lesion");
  if (knee.lesion_mm == 0 && knee.lesion_depth_mm != mean.lesion_depth_mm)
    return needs("lesion-depth", "lesion");
  if (knee.lesion_mm == 0 && knee.lesion_at != mean.lesion_at) return needs("lesion-at", "lesion");
  if (knee.lesion_mm == 0 && knee.visible != mean.visible) return needs("visible", "lesion");
  if (const std::size_t count = knee_site_count(knee.lesion_in); knee.lesion_at >= count)
    return refused(all,
                   quoted("lesion-at") + " of " + std::to_string(knee.lesion_at) + " is not a place on " +
                       knee.lesion_in + ", which has " + std::to_string(count),
                   "count them from 0; cartilages have several");
  if (knee.defect_mm == 0 && knee.defect_in != mean.defect_in) return needs("defect-in", "defect");
  const auto present = [&](const char* key, const std::string& structure) -> Result<void> {
    for (const std::string& name : knee.missing)
      if (name == structure)
        return refused(all, quoted(key) + " is " + structure + ", which is `missing`",
                       "name another structure");
    return {};
  };
  const double widest_mm = knee.settings.spacing_mm.maxCoeff();
  constexpr double kMinBurr_mm = 1;
  if (knee.burr_mm > 0 && knee.burr_mm < std::max(kMinBurr_mm, 2 * widest_mm))
    return refused(all,
                   quoted("burr") + " of " + millimetres(knee.burr_mm) + " is too small for voxels of " +
                       millimetres(widest_mm),
                   "its diameter is at least two voxels, and 1 mm");
  for (const auto& [key, radius_mm, structure] :
       {std::tuple{"lesion", knee.lesion_mm, knee.lesion_in}, {"defect", knee.defect_mm, knee.defect_in}}) {
    if (radius_mm == 0) continue;
    if (radius_mm < 1.5 * widest_mm)
      return refused(all,
                     quoted(key) + " of " + millimetres(radius_mm) + " is too small for voxels of " +
                         millimetres(widest_mm),
                     "its radius is at least one and a half voxels");
    if (auto there = present((std::string(key) + "-in").c_str(), structure); !there) return there;
  }
  return {};
}

Result<void> check_together(const PhantomParameters& all, const ShellParameters& shell) {
  if (shell.thickness_mm >= shell.radius_mm)
    return refused(all, "a wall as thick as the ball's radius leaves no cavity",
                   "make `thickness` less than `radius`");
  return check_thickness(all, "thickness", shell.thickness_mm);
}

Result<void> check_together(const PhantomParameters& all, const SkullParameters& skull) {
  if (skull.temporal_mm > skull.thickness_mm)
    return refused(all, "the temples are thicker than the rest of the wall",
                   "make `temporal` at most `thickness`");
  return check_thickness(all, "temporal", skull.temporal_mm);
}

Result<void> check_together(const PhantomParameters& all, const GlandParameters& gland) {
  for (const auto& [key, layer_mm] : {std::pair{"fat", gland.fat_mm}, {"skin", gland.skin_mm}}) {
    if (layer_mm == 0) continue;
    if (auto closed = check_thickness(all, key, layer_mm); !closed) return closed;
  }
  return {};
}

// requirements of nodules on the voxels and on the tissue around them
Result<void> check_nodules(const PhantomParameters& all, const NoduleParameters& nodules, bool fit,
                           const std::string& tissue, const char* more) {
  if (nodules.nodules == 0) return {};
  if (auto closed = check_thickness(all, "depth", nodules.depth_mm); !closed) return closed;
  const double widest_mm = settings_of(all).spacing_mm.maxCoeff();
  if (nodules.diameter_mm < 3 * widest_mm)
    return refused(all,
                   "`diameter` of " + millimetres(nodules.diameter_mm) + " is too small for voxels of " +
                       millimetres(widest_mm),
                   "it is at least three voxels");
  if (fit) return {};
  return refused(all,
                 std::to_string(nodules.nodules) + (nodules.nodules == 1 ? " nodule of " : " nodules of ") +
                     millimetres(nodules.diameter_mm) + " with " + millimetres(nodules.depth_mm) +
                     " of tissue over each do not fit into " + tissue,
                 std::string("make `depth`, `diameter` or `nodules` less, or ") + more + " more");
}

Result<void> check_together(const PhantomParameters& all, const BlockParameters& block) {
  return check_nodules(all, block.nodules, nodules_of(block).has_value(),
                       "a block of " + millimetres(block.width_mm) + " by " + millimetres(block.thickness_mm),
                       "`thickness` or `width`");
}

Result<void> check_together(const PhantomParameters& all, const DomeParameters& dome) {
  return check_nodules(
      all, dome.nodules, nodules_of(dome).has_value(),
      "a dome of radius " + millimetres(dome.radius_mm) + " and height " + millimetres(dome.height_mm),
      "`height` or `radius`");
}

Result<void> check_together(const PhantomParameters& all, const AbdomenParameters& abdomen) {
  for (const auto& [key, layer_mm] : {std::pair{"skin", abdomen.skin_mm},
                                      {"fat", abdomen.fat_mm},
                                      {"muscle", abdomen.muscle_mm},
                                      {"edge", abdomen.edge_mm}}) {
    if (layer_mm == 0) continue;
    if (auto closed = check_thickness(all, key, layer_mm); !closed) return closed;
  }
  return {};
}

Result<void> check_together(const PhantomParameters& all, const TemporalBoneParameters& bone) {
  const double widest_mm = bone.settings.spacing_mm.maxCoeff();
  if (bone.cells_mm > 0 && bone.cells_mm < 3 * widest_mm)
    return refused(
        all,
        "`cells` of " + millimetres(bone.cells_mm) + " are too small for voxels of " + millimetres(widest_mm),
        "their diameter is at least three voxels, or 0 for none");
  if (auto closed = check_thickness(all, "cortex", bone.cortex_mm); !closed) return closed;
  return check_thickness(all, "plate", bone.plate_mm);
}

Result<void> check_voxels(const PhantomParameters& parameters, const PhantomField& field) {
  const Eigen::Vector3d& spacing_mm = settings_of(parameters).spacing_mm;
  const double volume_mm3 = field.extent_mm.cwiseProduct(field.scale).prod();
  const double voxels = volume_mm3 / spacing_mm.prod();
  if (voxels <= kMaxVoxels) return {};
  char what[128];
  std::snprintf(what, sizeof what,
                "this spacing makes %.0f million voxels; a phantom has at most %.0f million", 1e-6 * voxels,
                1e-6 * kMaxVoxels);
  // rounded up, so that the suggested spacing is accepted
  char remedy[64];
  std::snprintf(remedy, sizeof remedy, "use spacing=%.2f or more",
                std::ceil(100 * std::cbrt(volume_mm3 / kMaxVoxels)) / 100);
  return refused(parameters, what, remedy);
}

}  // namespace

Result<void> check_phantom(const PhantomParameters& parameters) {
  if (auto ranges = check_key_ranges(parameters); !ranges) return ranges;
  return std::visit(
      [&](const auto& p) -> Result<void> {
        if (auto together = check_together(parameters, p); !together) return together;
        return check_voxels(parameters, field_of(p));
      },
      parameters);
}

Result<Phantom> make_phantom(const PhantomParameters& parameters, const Progress& progress) {
  if (const auto checked = check_phantom(parameters); !checked) return checked.error();
  const PhantomPlan plan = std::visit([](const auto& p) { return plan_of(p); }, parameters);
  return paint_phantom(plan, settings_of(parameters), progress);
}

Result<PhantomWithoutVoxels> phantom_without_voxels(const PhantomParameters& parameters) {
  if (const auto checked = check_phantom(parameters); !checked) return checked.error();
  const PhantomPlan plan = std::visit([](const auto& p) { return plan_of(p); }, parameters);
  return PhantomWithoutVoxels{plan.field.grid(settings_of(parameters).spacing_mm), segments_of(plan)};
}

const NoduleParameters* nodule_parameters(const PhantomParameters& parameters) {
  if (const auto* block = std::get_if<BlockParameters>(&parameters)) return &block->nodules;
  if (const auto* dome = std::get_if<DomeParameters>(&parameters)) return &dome->nodules;
  return nullptr;
}

Result<std::vector<PhantomNodule>> phantom_nodules(const PhantomParameters& parameters) {
  if (const auto checked = check_phantom(parameters); !checked) return checked.error();
  if (const auto* block = std::get_if<BlockParameters>(&parameters)) return nodules_of(*block).value();
  if (const auto* dome = std::get_if<DomeParameters>(&parameters)) return nodules_of(*dome).value();
  return std::vector<PhantomNodule>();
}

Result<Phantom> make_knee_phantom(double voxel_mm, std::uint64_t scan_seed, const Progress& progress) {
  KneeParameters knee;
  knee.settings.spacing_mm.setConstant(voxel_mm);
  knee.settings.scan_seed = scan_seed;
  return make_phantom(knee, progress);
}

}  // namespace palpate
