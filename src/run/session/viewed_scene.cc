#include "session/viewed_scene.h"

#include "palpate/base/hash.h"
#include "palpate/contact/colours.h"
#include "palpate/rendering/rendering.h"
#include "palpate/scene/named_values.h"

namespace palpate {
namespace {

// only the Hounsfield scale has values this low: air is -1000
constexpr float kOnlyHounsfield = -500;

constexpr std::array kCaveatKinds{NamedValue<CaveatKind>{CaveatKind::kPlacement, "placement"},
                                  NamedValue<CaveatKind>{CaveatKind::kSide, "side"},
                                  NamedValue<CaveatKind>{CaveatKind::kForce, "force"}};

// declared modality; if unknown, inferred from the scan's values
Modality modality_of(Modality declared, const Volume<float>* scan) {
  if (declared != Modality::kUnknown || !scan) return declared;
  const auto& voxels = scan->voxels();
  const bool air = std::any_of(voxels.begin(), voxels.end(), [](float v) { return v <= kOnlyHounsfield; });
  return air ? Modality::kCt : Modality::kUnknown;
}

void hash_dims(const GridGeometry& grid, std::uint64_t& hash) {
  for (const int dim : grid.dims) hash_word(hash, static_cast<std::uint64_t>(dim));
}

std::uint64_t hash_of_voxels(const Model& model) {
  std::uint64_t hash = kHashSeed;
  hash_dims(model.labels->geometry(), hash);
  hash_word(hash, model.labels->content_hash());
  if (model.scan) {
    hash_dims(model.scan->geometry(), hash);
    const std::vector<float>& voxels = model.scan->voxels();
    hash_bytes(hash, voxels.data(), voxels.size() * sizeof voxels[0]);
  }
  return hash_finish(hash);
}

std::array<std::array<double, 4>, 4> rows_of(const Transform<World, Patient>& X) {
  std::array<std::array<double, 4>, 4> rows{};
  for (std::size_t r = 0; r < 3; ++r) {
    for (std::size_t c = 0; c < 3; ++c) rows[r][c] = X.linear()(static_cast<int>(r), static_cast<int>(c));
    rows[r][3] = X.translation()[static_cast<int>(r)];
  }
  rows[3][3] = 1;
  return rows;
}

const char* name_of(Protection protection) {
  return protection == Protection::kBlock ? "keep" : protection == Protection::kAlarm ? "alarm" : "none";
}

std::array<double, 3> coordinates_of(const auto& point) {
  return {point.x(), point.y(), point.z()};
}

ViewedTool viewed_tool(const Tool& tool) {
  ViewedTool viewed{tool.name, tool.radius_mm, tool.burr.has_value(), {}, {}, {}};
  if (tool.burr) {
    viewed.burr = burr_shape(tool);
    viewed.shaver = tool.burr->shaver;
    viewed.revolutions_per_s = tool.burr->revolutions_per_s;
    viewed.flutes = tool.burr->flutes;
  }
  for (const Eigen::Vector3d& point : tool.points_mm) viewed.points_mm.push_back(coordinates_of(point));
  for (const ToolCapsule& capsule : tool.capsules)
    viewed.capsules.push_back({coordinates_of(capsule.from_mm), coordinates_of(capsule.to_mm),
                               capsule.radius_mm, capsule.radius_mm});
  if (const auto& burr = tool.burr; burr && burr->length_mm > 0)
    viewed.capsules.push_back(
        {{}, coordinates_of(burr->spindle * burr->length_mm), tool.radius_mm, burr->end_radius_mm});
  return viewed;
}

ViewedNoGo viewed_no_go(const NoGoRegion& region) {
  ViewedNoGo viewed{region.name, region.keep_away_mm, {}};
  if (const auto* structure = std::get_if<NoGoStructure>(&region.shape)) viewed.shape = structure->label;
  if (const auto* plane = std::get_if<NoGoPlane>(&region.shape))
    viewed.shape = ViewedNoGo::Plane{coordinates_of(plane->point), coordinates_of(plane->outward)};
  if (const auto* ball = std::get_if<NoGoSphere>(&region.shape))
    viewed.shape = ViewedNoGo::Ball{coordinates_of(ball->centre), ball->radius_mm};
  return viewed;
}

}  // namespace

ViewedScene viewed_scene(const Model& model, std::size_t devices, Modality declared) {
  ViewedScene scene;
  scene.side = name_of(model.side, kSides);
  scene.oriented = model.oriented;
  for (const Caveat& caveat : model.caveats)
    scene.caveats.push_back({std::string(name_of(caveat.kind, kCaveatKinds)), caveat.text});
  scene.modality = name_of(modality_of(declared, model.scan.get()), kModalities);
  scene.content_hash = hash_of_voxels(model);
  scene.scan = model.scan;
  scene.labels = model.labels;
  if (model.scan) scene.window = scan_window(*model.scan);
  scene.world_from_patient = rows_of(model.X_WorldPatient);

  // names and colours
  for (const Segment& segment : model.segments) {
    const bool known = segment.id < model.tissue_of_label.size();
    scene.structures.push_back(
        {segment.id,
         model.name_of(segment.id),
         segment.colour,
         known ? model.tissue_of_label[segment.id] : -1,
         {model.enclosing_of(segment.id).begin(), model.enclosing_of(segment.id).end()}});
  }
  for (std::size_t t = 0; t < model.tissues.size(); ++t) {
    const Tissue& tissue = model.tissues[t];
    scene.tissues.push_back({tissue.name, tissue.touchable, colour_of_tissue(model, t), tissue.opacity,
                             tissue.rests_on, name_of(tissue.protection)});
  }
  for (std::size_t d = 0; d < devices; ++d) scene.tools.push_back(viewed_tool(model.tool_of(d)));
  if (!model.reported_distances.structures.empty())
    scene.distance_reach_mm = model.reported_distances.reach_mm;
  for (const NoGoRegion& region : model.no_go) scene.no_go.push_back(viewed_no_go(region));
  return scene;
}

std::vector<ContactProperties> viewed_tissues(const Model& model) {
  return {model.tissues.begin(), model.tissues.end()};
}

double deformable_stiffness_N_per_mm(const DeviceTick& device) {
  return device.depth_mm > 0 ? device.unclamped_force_N * device.scale / device.depth_mm : 0;
}

}  // namespace palpate
