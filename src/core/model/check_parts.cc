#include "model/check_parts.h"

#include <cmath>
#include <limits>
#include <sstream>
#include <string>

#include "palpate/volume/grid.h"

namespace palpate {
namespace {

// maximum distance of a tool's parts from its tip
constexpr double kMaxToolReach_mm = 1000;
constexpr int kMaxPedal = 31, kMaxFlutes = 100;

template <class... Parts>
Error bad_part(const std::string& member, const char* remedy, const Parts&... parts) {
  std::ostringstream what;
  (what << ... << parts);
  return {ErrorKind::kBadInput, what.str(), member, remedy};
}

std::string element(const char* list, std::size_t index) {
  return std::string(list) + "[" + std::to_string(index) + "]";
}

// at least 0 and finite; false for NaN
bool is_amount(double value) {
  return value >= 0 && std::isfinite(value);
}

Result<void> check_tissue(const std::vector<Tissue>& tissues, std::size_t index) {
  const Tissue& tissue = tissues[index];
  const std::string where = element("tissues", index);
  for (const ContactProperty& property : kContactProperties)
    if (!is_amount(tissue.*property.value))
      return bad_part(where, "give a finite number, at least 0", property.display_name, " is ",
                      tissue.*property.value);
  if (tissue.touchable && tissue.stiffness_N_per_mm == 0)
    return bad_part(where, "set a stiffness above 0, or set touchable to false",
                    "a touchable tissue has no stiffness");
  if (!(tissue.puncture_N > 0))
    return bad_part(where, "give a force above 0; infinite: never", "the puncture force is ",
                    tissue.puncture_N, " N");
  for (const double value : {tissue.friction_damping_N_s_per_mm, tissue.friction_max_N, tissue.opacity})
    if (!is_amount(value)) return bad_part(where, "give a finite number, at least 0", "a value is ", value);
  if (!(tissue.cutting_energy_mJ_per_mm3 > 0) || !std::isfinite(tissue.cutting_energy_mJ_per_mm3))
    return bad_part(where, "give a finite energy above 0", "the cutting energy is ",
                    tissue.cutting_energy_mJ_per_mm3, " mJ/mm^3");
  for (const int support : tissue.rests_on)
    if (support < 0 || static_cast<std::size_t>(support) >= tissues.size())
      return bad_part(where, "tissues are counted from 0", "a tissue rests on tissue ", support, " of ",
                      tissues.size());
  return {};
}

Result<void> check_burr(const Tool& tool, const std::string& where) {
  const BurrSettings& burr = *tool.burr;
  if (tool.points_mm.size() != 1 || !tool.points_mm.front().isZero() || !tool.capsules.empty() ||
      !(tool.radius_mm > 0))
    return bad_part(where, "give it one sphere at the tip, with its radius",
                    "the tool of the burr is not a single sphere");
  if (!is_amount(burr.revolutions_per_s) || burr.revolutions_per_s == 0 || !is_amount(burr.grip))
    return bad_part(where, "give finite numbers above 0", "the burr has ", burr.revolutions_per_s,
                    " revolutions per second and a grip of ", burr.grip);
  if (burr.flutes < 1 || burr.flutes > kMaxFlutes)
    return bad_part(where, "give 1 to 100 flutes", "the burr has ", burr.flutes, " flutes");
  if (!(std::abs(burr.spindle.norm() - 1) < 1e-3))
    return bad_part(where, "give a unit vector", "the burr's spindle has the length ", burr.spindle.norm());
  if (burr.pedal < -1 || burr.pedal > kMaxPedal)
    return bad_part(where, "give a button from 0 to 31, or -1", "the burr's pedal is button ", burr.pedal);
  if (!(burr.length_mm >= 0 && burr.length_mm <= kMaxToolReach_mm) ||
      (burr.length_mm > 0 && !(burr.end_radius_mm > 0 && burr.end_radius_mm <= kMaxToolRadius_mm)))
    return bad_part(where, "give a length, and a radius of its end above 0", "the burr has a length of ",
                    burr.length_mm, " mm and an end radius of ", burr.end_radius_mm, " mm");
  return {};
}

Result<void> check_tool(const Tool& tool, std::size_t index) {
  const std::string where = element("tools", index);
  const std::size_t parts = tool.points_mm.size() + tool.capsules.size();
  if (tool.points_mm.empty() || parts > kMaxToolParts)
    return bad_part(where, "give at least one point, and at most 4 points and capsules together",
                    "the tool has ", tool.points_mm.size(), " points and ", tool.capsules.size(),
                    " capsules");
  const auto is_near = [](const Eigen::Vector3d& at) { return at.norm() <= kMaxToolReach_mm; };
  const auto is_radius = [](double radius_mm) { return radius_mm >= 0 && radius_mm <= kMaxToolRadius_mm; };
  if (!is_radius(tool.radius_mm))
    return bad_part(where, "give 0 to 12 mm", "the tool radius is ", tool.radius_mm, " mm");
  for (const Eigen::Vector3d& point : tool.points_mm)
    if (!is_near(point))
      return bad_part(where, "give points within a metre of the tip", "a point of the tool is ", point.norm(),
                      " mm from its tip");
  for (const ToolCapsule& capsule : tool.capsules)
    if (!is_radius(capsule.radius_mm) || !is_near(capsule.from_mm) || !is_near(capsule.to_mm) ||
        !((capsule.to_mm - capsule.from_mm).norm() > 0))
      return bad_part(where, "give two distinct ends within a metre of the tip, and a radius of 0 to 12 mm",
                      "a capsule has a radius of ", capsule.radius_mm, " mm and ends that are ",
                      (capsule.to_mm - capsule.from_mm).norm(), " mm apart");
  return tool.burr ? check_burr(tool, where) : Result<void>();
}

Result<void> check_labels(const ModelParts& parts) {
  if (parts.labels == nullptr)
    return bad_part("labels", "give the result of label_bricks()", "there are no labels");
  if (auto fine = check_grid(parts.labels->geometry()); !fine) return fine.error();
  const std::size_t tissues = parts.tissues.size();
  if (tissues > static_cast<std::size_t>(std::numeric_limits<std::int16_t>::max()))
    return bad_part("tissues", "give at most 32767", "there are ", tissues, " tissues");
  if (parts.tissue_of_label.size() > std::numeric_limits<LabelId>::max() + std::size_t{1})
    return bad_part("tissue_of_label", "labels are 0 to 65535", "there are ", parts.tissue_of_label.size(),
                    " labels with tissues");
  for (std::size_t label = 0; label < parts.tissue_of_label.size(); ++label) {
    const int tissue = parts.tissue_of_label[label];
    if (tissue < -1 || (tissue >= 0 && static_cast<std::size_t>(tissue) >= tissues))
      return bad_part(element("tissue_of_label", label), "tissues are counted from 0; -1: none", "label ",
                      label, " has tissue ", tissue, " of ", tissues);
  }
  if (!parts.tissue_of_label.empty() && parts.tissue_of_label.front() != -1)
    return bad_part("tissue_of_label[0]", "give -1: label 0 is the background",
                    "the background has a tissue");
  return {};
}

Result<void> check_settings(const ModelParts& parts) {
  if (!(parts.max_force_N >= 0))
    return bad_part("max_force_N", "give at least 0 N; infinite: none", "the force limit is ",
                    parts.max_force_N, " N");
  for (const double value : {parts.sigma_mm, parts.method_settings.sphere_sigma_voxels,
                             parts.method_settings.coupling_damping_N_s_per_mm, parts.smoothed_reach_mm,
                             parts.reported_distances.reach_mm})
    if (!is_amount(value))
      return bad_part("method_settings", "give finite numbers, at least 0", "a setting is ", value);
  if (parts.smoothed != nullptr && parts.smoothed->geometry().dims != parts.labels->geometry().dims)
    return bad_part("smoothed", "compute it on the labels' grid",
                    "the smoothed field is not on the grid of the labels");
  return {};
}

Result<void> check_density(const ModelParts& parts) {
  if (!is_amount(parts.full_density_HU))
    return bad_part("full_density_HU", "give an attenuation above 0, or 0: energies do not follow density",
                    "a full density of ", parts.full_density_HU, " HU");
  if (parts.scan != nullptr && !parts.scan->geometry().same_grid(parts.labels->geometry()))
    return bad_part("scan", "resample it to the grid of the labels",
                    "the scan has another grid than the labels");
  if (parts.full_density_HU > 0 && parts.scan == nullptr)
    return bad_part("full_density_HU", "give a scan, or 0",
                    "cutting energies follow a scan, but there is none");
  return {};
}

}  // namespace

Result<void> check_parts(const ModelParts& parts) {
  if (auto fine = check_labels(parts); !fine) return fine;
  for (std::size_t index = 0; index < parts.tissues.size(); ++index)
    if (auto fine = check_tissue(parts.tissues, index); !fine) return fine;
  if (parts.tools.empty() || parts.tools.size() > kMaxDevices)
    return bad_part("tools", "give one for each device, at least one", "there are ", parts.tools.size(),
                    " tools");
  for (std::size_t index = 0; index < parts.tools.size(); ++index)
    if (auto fine = check_tool(parts.tools[index], index); !fine) return fine;
  if (auto fine = check_density(parts); !fine) return fine;
  return check_settings(parts);
}

}  // namespace palpate
