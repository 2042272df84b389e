#include "palpate/contact/tool_contact.h"

#include <algorithm>
#include <cmath>
#include <span>

#include "contact/proxy_parts.h"
#include "palpate/base/insertion_sort.h"
#include "palpate/contact/contact_settings.h"
#include "palpate/device/rendered_stiffness.h"

namespace palpate {
namespace {

// label of the voxel at a point; 0 outside the volume
LabelId label_at(const Model& model, const Point<Patient>& at) {
  const Point<Voxel> p = model.labels->X_VoxelPatient() * at;
  const auto& dims = model.labels->geometry().dims;
  std::array<int, 3> index{};
  for (int axis = 0; axis < 3; ++axis) {
    if (!(p[axis] > -0.5 && p[axis] < dims[axis] - 0.5)) return 0;
    index[axis] = static_cast<int>(p[axis] + 0.5);
  }
  return model.labels->at(index[0], index[1], index[2]);
}

// contact site of a touchable label; empty for other labels
ContactSite site_of(const Model& model, LabelId label, double depth_mm) {
  ContactSite site;
  if (!model.is_touchable(label)) return site;
  site.label = label;
  site.tissue = model.tissue_of_label[label];
  site.level = model.level_of_label[label];
  site.depth_mm = depth_mm;
  return site;
}

// structure in contact; where structures touch or overlap, the one whose voxels are half a voxel below the
// surface
LabelId label_under(const Model& model, const ProxyContact& contact, const Point<Patient>& at,
                    OwnerCache& owners) {
  const double half_voxel_mm = 0.5 * model.labels->geometry().min_spacing_mm();
  const LabelId label = label_at(model, at - contact.normal * half_voxel_mm);
  // a tissue softer than the layer's lower bound belongs to an outer layer
  const ContactSurface& surface = model.surfaces[static_cast<std::size_t>(contact.surface)];
  if (model.is_touchable(label) && model.tissue_of(label)->stiffness_N_per_mm > surface.lower_N_per_mm)
    return label;
  const int structure = owners.at(model.surfaces, contact.surface, at).largest();
  return model.label_of_surface[static_cast<std::size_t>(structure)];
}

// Normal of all contacts. On an edge, or where the surface has more curvature than its smoothed normals, the
// contact normals do not explain the whole force. The result is then the direction closest to theirs for
// which the force lies in the friction cone.
Vector<Patient> normal_of(const ProxyResult& result) {
  const Vector<Patient>& mean_normal = result.normal;
  const Vector<Patient> along = result.force_N.normalized();
  if (along == Vector<Patient>()) return mean_normal;
  const double axial = mean_normal.dot(along);
  const Vector<Patient> lateral = mean_normal - along * axial;
  const double lateral_length = lateral.norm();
  if (lateral_length <= result.friction * axial || lateral_length == 0) return mean_normal;
  return (along + lateral * (result.friction / lateral_length)).normalized();
}

// contact point on the surface
Point<Patient> position_of(const ProxyContact& contact, const ProxyLayer& layer,
                           std::span<const ToolPart> parts) {
  const ToolPart& part = parts[static_cast<std::size_t>(contact.part)];
  return layer.position + arm_of(contact, part);
}

// distribution of a layer's force over its contacts: along each normal, in sum the spring force
struct LayerContacts {
  const ProxyLayer& layer;
  OwnerCache& owners;
  double force_N_per_mm;  // force per multiplier
  std::span<const ToolPart> parts;
};

// appends a layer's contacts by decreasing force, up to the capacity; returns their number
std::size_t append_contacts(const Model& model, const LayerContacts& layer_contacts,
                            std::span<ContactPoint> contacts) {
  std::array<const ProxyContact*, kMaxContacts> order;
  const auto count = static_cast<std::size_t>(layer_contacts.layer.contact_count);
  for (std::size_t n = 0; n < count; ++n) order[n] = &layer_contacts.layer.contacts[n];
  insertion_sort(std::span(order).first(count),
                 [](const auto* a, const auto* b) { return a->multiplier_mm > b->multiplier_mm; });
  std::size_t n = 0;
  for (; n < std::min(count, contacts.size()); ++n) {
    const ProxyContact& contact = *order[n];
    const Point<Patient> position = position_of(contact, layer_contacts.layer, layer_contacts.parts);
    contacts[n] = {label_under(model, contact, position, layer_contacts.owners), contact.part, position,
                   std::max(0.0, contact.multiplier_mm * layer_contacts.force_N_per_mm)};
  }
  return n;
}

// the proxy's contacts summarised as one PointContact, attributed to the structure of the strongest contact
PointContact strongest_of(const Model& model, const ProxyState& proxy, const ContactPoint& most,
                          const Point<Patient>& tip, const ProxyResult& result,
                          const Vector<Patient>& force_N) {
  PointContact contact;
  contact.proxy = proxy.coupled ? proxy.position : tip;
  contact.force_N = force_N;
  if (proxy.contact_count == 0) return contact;
  contact.sample.gradient = -normal_of(result);
  const double depth_mm = (proxy.position - tip).norm();
  contact.site = site_of(model, most.label, depth_mm);
  contact.presses = depth_mm > kProxySettings.arrived_mm && most.force_N > 0;
  return contact;
}

PathStructure single_structure_path(const PointContact& contact) {
  return {contact.site.label, contact.site.depth_mm, 1};
}

std::array<PathStructure, kMaxStructuresReported> path_of_proxy(const Model& model, const ProxyResult& result,
                                                                const PointContact& strongest) {
  static_assert(kMaxStructuresReported == kMaxPathSegments);
  std::array<PathStructure, kMaxStructuresReported> path;
  for (int n = 0; n < result.path_segments; ++n) {
    const PathSegment& segment = result.path[static_cast<std::size_t>(n)];
    path[static_cast<std::size_t>(n)] = {model.label_of_surface[static_cast<std::size_t>(segment.structure)],
                                         segment.depth_mm, segment.fraction};
  }
  // inside a punctured structure only viscosity acts
  if (result.path_segments == 0) path[0] = single_structure_path(strongest);
  return path;
}

// Ratio of the spring-damper force between tip and proxy to the spring force at the contacts' current
// stiffness. The rendered stiffness is low-pass filtered, so that it is continuous across the seam of two
// structures; it starts at the contacts' value. The damper's velocity is averaged over a window that includes
// free space, so the damping builds up with the spring; it reduces the spring force to zero at most.
double coupling_force_ratio(const ProxyForce& spring, const Vector<Patient>& spring_mm,
                            double damping_N_s_per_mm, double dt_s, CouplingState& state) {
  if (damping_N_s_per_mm > 0) state.spring_velocity.push(spring_mm - state.spring_mm, dt_s);
  state.spring_mm = spring_mm;
  const double stiffness = spring.stiffness_N_per_mm, length_mm = spring_mm.norm();
  if (!(stiffness > 0) || !(length_mm > 0)) {
    state.stiffness_N_per_mm = 0;
    return 1;
  }
  double& rendered = state.stiffness_N_per_mm;
  // deformable tissue stiffens with depth, without a filter
  rendered =
      rendered > 0 && !spring.deformable
          ? rendered + (stiffness - rendered) * -std::expm1(-dt_s / kContactSettings.stiffness_filter_s)
          : stiffness;
  const double speed_mm_s = state.spring_velocity.velocity_mm_s().dot(spring_mm) / length_mm;
  const double force_N = rendered * length_mm + damping_N_s_per_mm * speed_mm_s;
  return std::max(0.0, force_N) / (stiffness * length_mm);
}

}  // namespace

bool PointContact::is_contact() const {
  const bool inside = sample.value >= 0.5 * site.level;
  return site.label != 0 && (presses || inside || force_N.norm() >= kContactSettings.min_N);
}

double DeviceContext::max_stiffness_N_per_mm() const {
  return RenderedStiffness(device).max_in_patient();
}

double DeviceContext::max_damping_N_s_per_mm() const {
  return device.max_damping_N_s_per_mm > 0
             ? RenderedStiffness(device).in_patient(device.max_damping_N_s_per_mm)
             : std::numeric_limits<double>::infinity();
}

double max_deformable_stiffness_N_per_mm(const Model& model) {
  constexpr double kUnlimited = std::numeric_limits<double>::infinity();
  if (!is_elastic(model.tissue_law)) return kUnlimited;
  const Tissue* stiffest = nullptr;
  for (const Tissue& tissue : model.tissues)
    if (tissue.touchable && (stiffest == nullptr || tissue.stiffness_N_per_mm > stiffest->stiffness_N_per_mm))
      stiffest = &tissue;
  return stiffest == nullptr || model.is_deformable(*stiffest) ? kUnlimited : stiffest->stiffness_N_per_mm;
}

PosedTool::PosedTool(const TickContext& tick, const DeviceContext& context)
    : pose_(context.tip,
            Eigen::Quaterniond(Eigen::Matrix3d(tick.X_PatientWorld.linear() * context.R_WorldTool))) {
  const auto in_patient = [&](const Eigen::Vector3d& of_tool) { return context.in_patient(tick, of_tool); };
  for (const Eigen::Vector3d& offset_mm : context.tool.points_mm)
    parts_[count_++] = {in_patient(offset_mm), context.tool.radius_mm};
  for (const ToolCapsule& capsule : context.tool.capsules)
    parts_[count_++] = {in_patient(capsule.from_mm), capsule.radius_mm,
                        in_patient(capsule.to_mm - capsule.from_mm)};
}

ProxyOptions proxy_options(const TickContext& tick, const DeviceContext& context) {
  const RelaxationTimes& times = tick.model.relaxation_times;
  const double peak_N = context.device.limits.peak_force_N;
  ProxyOptions options;
  options.friction = tick.friction;
  // fmin, because the device's limit is NaN if unknown. Rigid tissues never exceed the second limit.
  options.max_stiffness_N_per_mm =
      std::fmin(context.max_stiffness_N_per_mm(), max_deformable_stiffness_N_per_mm(tick.model));
  options.dt_s = tick.dt_s;
  options.max_slip_N_per_s = kProxySettings.max_slip_N_per_s / context.device.force_gain;
  options.compliance = tick.compliance;
  options.device = context.device_index;
  options.relaxation_times = times.any() ? &times : nullptr;
  options.holes = tick.holes;
  options.tissue_contacts = tick.tissue_contacts;
  if (peak_N > 0) options.max_force_N = peak_N / context.device.force_gain;
  return options;
}

ToolContact touch_by_proxy(const TickContext& tick, const DeviceContext& context, const PosedTool& posed_tool,
                           ProxyState& proxy, const ProxyResult& result, CouplingState& coupling) {
  const Model& model = tick.model;
  const DeviceParameters& gains = context.device;
  const Vector<Patient> spring_mm =
      proxy.coupled ? (proxy.position - context.tip) * proxy.stretch_fraction : Vector<Patient>();
  const double max_N_s_per_mm = context.max_damping_N_s_per_mm();
  const double damping_N_s_per_mm =
      std::min(model.method_settings.coupling_damping_N_s_per_mm, max_N_s_per_mm);
  // inner layers are not filtered: their force starts from zero depth anyway
  const ProxyForce& outermost = result.of_layer[0];
  const double force_ratio =
                   coupling_force_ratio(outermost, spring_mm, damping_N_s_per_mm, tick.dt_s, coupling),
               reduction = 1 - force_ratio;
  ToolContact tool;
  std::size_t contacts = 0;
  for (int n = 0; n < kMaxLayers; ++n) {
    const ProxyLayer& layer = proxy.layer(n);
    if (!layer.coupled || layer.contact_count == 0) continue;
    // tool parts in the proxy's attitude
    const ProxyParts turned(posed_tool.parts(), posed_tool.pose().attitude, layer.attitude);
    const double layer_N_per_mm =
        result.of_layer[static_cast<std::size_t>(n)].stiffness_N_per_mm * layer.stretch_fraction;
    const LayerContacts force{layer, proxy.cache(n).owners,
                              n == 0 ? layer_N_per_mm * force_ratio : layer_N_per_mm, turned.parts()};
    contacts += append_contacts(model, force, std::span(tool.contacts).subspan(contacts));
  }
  tool.strongest = strongest_of(model, proxy, tool.contacts[0], context.tip, result,
                                result.force_N - outermost.force_N * reduction);
  ContactSite& site = tool.strongest.site;
  if (site.tissue < 0 && proxy.punctured.any())
    site = site_of(model, label_at(model, context.tip), kContactSettings.full_viscosity_mm);
  if (tick.viscosity && site.tissue >= 0)
    tool.strongest.force_N += viscous_force(
        model.tissues[static_cast<std::size_t>(site.tissue)], context.velocity_mm_s,
        site.depth_mm / kContactSettings.full_viscosity_mm, max_N_s_per_mm - damping_N_s_per_mm);
  tool.path = path_of_proxy(model, result, tool.strongest);
  tool.requested.force_N = tick.X_WorldPatient * tool.strongest.force_N * gains.force_gain;
  tool.requested.torque_Nmm = tick.X_WorldPatient * (result.torque_Nmm - outermost.torque_Nmm * reduction) *
                              (gains.force_gain / gains.scale);
  const double stored_mJ = outermost.deformable
                               ? outermost.stored_mJ
                               : 0.5 * coupling.stiffness_N_per_mm * spring_mm.squared_norm();
  tool.stored_mJ = (stored_mJ + result.stored_mJ - outermost.stored_mJ) * (gains.force_gain / gains.scale);
  tool.tissue_contact = result.tissue_contact;
  if (context.device_index < tick.tissue_contacts.size()) {
    // evaluated at the last tick's contact point: work by the tool's own displacement is done by its operator
    const TissueContact& before = tick.tissue_contacts[context.device_index];
    const double now_mm = neighbour_effect(tick.tissue_contacts, context.device_index, before).displaced_mm;
    tool.received_mJ = before.force_N * (before.displaced_mm - now_mm) * (gains.force_gain / gains.scale);
  }
  const double stiffness_N_per_mm =
      outermost.deformable ? outermost.tangent_N_per_mm : coupling.stiffness_N_per_mm;
  tool.stiffness_N_per_mm = RenderedStiffness(gains).at_device(stiffness_N_per_mm + result.tangent_N_per_mm -
                                                               outermost.tangent_N_per_mm);
  if (!proxy.coupled) tool.flags |= kFlagInside;
  if (result.wedged) tool.flags |= kFlagWedged;
  if (result.ruptured) tool.flags |= kFlagRuptured;
  if (result.release.force_N != Vector<Patient>()) tool.flags |= kFlagRelease;
  return tool;
}

}  // namespace palpate
