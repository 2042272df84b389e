#include "servo/tool_contact.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "palpate/device/telemetry.h"

namespace palpate {
namespace {

// below this the halo of a smoothed structure is not called a touch
constexpr double kTouch_N = 0.02;

// in the patient
double most_stiffness_N_per_mm(const DeviceParameters& own) {
  const double most = own.most_stiffness_N_per_mm / (own.force_gain * own.scale);
  return most < 0 ? 0 : most;
}

// likewise
double most_damping_N_s_per_mm(const DeviceParameters& own) {
  return own.most_damping_N_s_per_mm > 0 ? own.most_damping_N_s_per_mm / (own.force_gain * own.scale)
                                         : std::numeric_limits<double>::infinity();
}

/// @param full_force_N     where the field is 1
/// @param most_N_s_per_mm  of all that damps at this point
PointContact touch(const Model& model, const Parameters& parameters, double full_force_N,
                   double most_N_s_per_mm, const Point<Patient>& x, const Vector<Patient>& velocity_mm_s) {
  const ForceField& field = model.force_field(parameters.method);
  PointContact contact;
  contact.proxy = x;
  contact.sample = field.sample(x);
  const Vector<Patient> normal_N = normal_force(contact.sample, full_force_N);
  contact.force_N = normal_N;
  contact.site = find_contact_site(model, x, contact.sample);
  if (contact.site.tissue < 0) return contact;

  const Tissue& tissue = model.tissues[contact.site.tissue];
  const double left_N_s_per_mm =
      parameters.viscosity ? std::max(0.0, most_N_s_per_mm - tissue.viscosity_N_s_per_mm) : most_N_s_per_mm;
  if (parameters.friction)
    contact.force_N += pseudo_friction(tissue, velocity_mm_s, normal_N, left_N_s_per_mm);
  if (parameters.viscosity)
    contact.force_N +=
        viscous_force(tissue, velocity_mm_s, contact.sample.value / contact.site.level, most_N_s_per_mm);
  return contact;
}

// viscosity is whole from this far inside
constexpr double kInside_mm = 1;

// of the voxel there; 0 outside the volume
LabelId label_at(const Model& model, const Point<Patient>& at) {
  const Point<Voxel> p = model.field->X_VoxelPatient() * at;
  const auto& dims = model.labels->geometry().dims;
  std::array<int, 3> index{};
  for (int axis = 0; axis < 3; ++axis) {
    if (!(p[axis] > -0.5 && p[axis] < dims[axis] - 0.5)) return 0;
    index[axis] = static_cast<int>(p[axis] + 0.5);
  }
  return model.labels->at(index[0], index[1], index[2]);
}

ContactSite site_of(const Model& model, LabelId label, double depth_mm) {
  ContactSite site;
  if (!model.is_felt(label)) return site;
  site.label = label;
  site.tissue = model.tissue_of_label[label];
  site.level = model.level_of_label[label];
  site.depth_mm = depth_mm;
  return site;
}

// the structure that a contact leans on: where structures touch or overlap, the one whose voxels lie there
LabelId label_under(const Model& model, const ProxyContact& contact, const Point<Patient>& at) {
  const double half_voxel_mm = 0.5 * model.labels->geometry().min_spacing_mm();
  const LabelId label = label_at(model, at - contact.normal * half_voxel_mm);
  if (model.is_felt(label)) return label;
  const int structure = owners_at(model.surfaces, contact.surface, at).largest();
  return model.label_of_surface[static_cast<std::size_t>(structure)];
}

// The normal of all that the proxies lean on together. Where one rests on an edge, or where the position
// bends more than its smoother normals say, the walls' own are not all that hold it: then it is the direction
// next to theirs from which the force is no farther than friction lets it be.
Vector<Patient> normal_of(const ProxyResult& result) {
  const Vector<Patient>& walls = result.normal;
  const Vector<Patient> along = result.force_N.normalized();
  if (along == Vector<Patient>()) return walls;
  const double ahead = walls.dot(along);
  const Vector<Patient> aside = walls - along * ahead;
  const double off = aside.norm();
  if (off <= result.friction * ahead || off == 0) return walls;
  return (along + aside * (result.friction / off)).normalized();
}

/// @param turn  of the tool in World
std::optional<Burr> burr_of(const Model& model, const MotorState& motor,
                            const Transform<Patient, World>& X_PatientWorld, const Eigen::Matrix3d& turn) {
  const Tool& tool = model.tool;
  if (!tool.burr) return std::nullopt;
  return Burr{tool.radius_mm,
              motor.runs ? tool.burr->revolutions_per_s : 0,
              X_PatientWorld * Vector<World>(turn * tool.burr->spindle),
              tool.burr->grip,
              motor.most_press_N,
              model.protected_structures,
              motor.stroke};
}

// a bit for each layer that has a proxy
unsigned coupled_layers(const ProxyState& proxy) {
  unsigned layers = 0;
  for (int n = 0; n < kMostLayers; ++n) layers |= static_cast<unsigned>(proxy.layer(n).coupled) << n;
  return layers;
}

// what the proxy leans on, as a contact of the direct methods: the structure on which it leans most
PointContact strongest_of(const Model& model, const ProxyState& proxy, std::span<const ToolSphere> spheres,
                          const Point<Patient>& tip, const ProxyResult& result,
                          const Vector<Patient>& force_N) {
  PointContact contact;
  contact.proxy = proxy.coupled ? proxy.position : tip;
  contact.force_N = force_N;
  const auto contacts = std::span(proxy.contact).first(static_cast<std::size_t>(proxy.contacts));
  const auto most = std::max_element(contacts.begin(), contacts.end(),
                                     [](const auto& a, const auto& b) { return a.pull_mm < b.pull_mm; });
  if (most == contacts.end()) return contact;
  const ToolSphere& sphere = spheres[static_cast<std::size_t>(most->sphere)];
  contact.sample.gradient = -normal_of(result);
  contact.site = site_of(model,
                         label_under(model, *most,
                                     proxy.position + sphere.offset_mm + sphere.along_mm * most->part -
                                         most->normal * sphere.radius_mm),
                         (proxy.position - tip).norm());
  return contact;
}

FeltStructure all_of_it(const PointContact& contact) {
  return {contact.site.label, contact.site.depth_mm, 1};
}

std::array<FeltStructure, kMostTold> felt_by_proxy(const Model& model, const ProxyResult& result,
                                                   const PointContact& strongest) {
  static_assert(kMostTold == kMostFeltParts);
  std::array<FeltStructure, kMostTold> felt;
  for (int n = 0; n < result.felt_parts; ++n) {
    const FeltPart& part = result.felt[static_cast<std::size_t>(n)];
    felt[static_cast<std::size_t>(n)] = {model.label_of_surface[static_cast<std::size_t>(part.structure)],
                                         part.depth_mm, part.share};
  }
  // within what was gone through nothing but viscosity is felt
  if (result.felt_parts == 0) felt[0] = all_of_it(strongest);
  return felt;
}

// Between tip and proxy: the spring's force over that with the stiffness of what is touched. The stiffness
// that is felt follows it slowly, so that the seam of two structures is no step; contact begins with it. The
// damper's velocity is a mean over a window of time that free space is part of, so that it comes in with the
// spring; it takes off what the spring gives and no more.
double coupled(const ProxyForce& spring, const Vector<Patient>& pull_mm, double damping_N_s_per_mm,
               double dt_s, CouplingState& state) {
  if (damping_N_s_per_mm > 0) state.pull_velocity.push(pull_mm - state.pull_mm, dt_s);
  state.pull_mm = pull_mm;
  const double stiffness = spring.stiffness_N_per_mm, length_mm = pull_mm.norm();
  if (!(stiffness > 0) || !(length_mm > 0)) {
    state.stiffness_N_per_mm = 0;
    return 1;
  }
  double& felt = state.stiffness_N_per_mm;
  felt = felt > 0 ? felt + (stiffness - felt) * -std::expm1(-dt_s / kSeam_s) : stiffness;
  const double speed_mm_s = state.pull_velocity.velocity_mm_s().dot(pull_mm) / length_mm;
  const double force_N = felt * length_mm + damping_N_s_per_mm * speed_mm_s;
  return std::max(0.0, force_N) / (stiffness * length_mm);
}

}  // namespace

bool PointContact::is_touch() const {
  const bool inside = sample.value >= 0.5 * site.level;
  return site.label != 0 && (inside || force_N.norm() >= kTouch_N);
}

ToolContact touch_with_tool(const Model& model, const Parameters& parameters, const DeviceParameters& gains,
                            const Eigen::Quaterniond& R_WorldTool, const Point<Patient>& tip,
                            const Vector<Patient>& velocity_mm_s,
                            const Transform<World, Patient>& X_WorldPatient,
                            const Transform<Patient, World>& X_PatientWorld) {
  const Eigen::Matrix3d turn = R_WorldTool.normalized().toRotationMatrix();
  ToolContact tool;
  // points that touch together add up
  const double stiffness_N_per_mm =
      model.greatest_stiffness_N_per_mm() * static_cast<double>(model.tool.points_mm.size());
  const double most_N_s_per_mm =
      most_damping_N_s_per_mm(gains) / static_cast<double>(model.tool.points_mm.size());
  const double softer = std::min(1.0, most_stiffness_N_per_mm(gains) / stiffness_N_per_mm);
  const double full_force_N = model.force_field(parameters.method).full_force_N() * softer;
  tool.stiffness_N_per_mm = stiffness_N_per_mm * softer * gains.force_gain * gains.scale;
  bool first = true;
  for (const Eigen::Vector3d& offset_mm : model.tool.points_mm) {
    const Vector<World> arm_mm(turn * offset_mm);
    const PointContact contact =
        touch(model, parameters, full_force_N, most_N_s_per_mm, tip + X_PatientWorld * arm_mm, velocity_mm_s);
    const Vector<World> force_N = X_WorldPatient * contact.force_N;
    tool.asked.force_N += force_N * gains.force_gain;
    tool.asked.torque_Nmm += arm_mm.cross(force_N) * (gains.force_gain / gains.scale);
    if (first || contact.force_N.squared_norm() > tool.strongest.force_N.squared_norm())
      tool.strongest = contact;
    first = false;
  }
  tool.felt[0] = all_of_it(tool.strongest);
  return tool;
}

ToolContact touch_by_proxy(const Model& model, const Parameters& parameters, const DeviceParameters& gains,
                           const Eigen::Quaterniond& R_WorldTool, const Point<Patient>& tip,
                           const Vector<Patient>& velocity_mm_s,
                           const Transform<World, Patient>& X_WorldPatient,
                           const Transform<Patient, World>& X_PatientWorld, double dt_s,
                           const ProxyChange& change, const MotorState& motor, SessionState::Hand& hand) {
  // the tool as it is turned now, in the patient
  const Eigen::Matrix3d turn = R_WorldTool.normalized().toRotationMatrix();
  std::array<ToolSphere, kMostToolSpheres> tool_spheres;
  std::size_t count = 0;
  for (const Eigen::Vector3d& offset_mm : model.tool.points_mm)
    tool_spheres[count++] = {X_PatientWorld * Vector<World>(turn * offset_mm), model.tool.radius_mm};
  for (const ToolCapsule& capsule : model.tool.capsules)
    tool_spheres[count++] = {X_PatientWorld * Vector<World>(turn * capsule.from_mm), capsule.radius_mm,
                             X_PatientWorld * Vector<World>(turn * (capsule.to_mm - capsule.from_mm))};
  const std::span<const ToolSphere> spheres{tool_spheres.data(), count};
  const ToolPose held_at(tip, Eigen::Quaterniond(Eigen::Matrix3d(X_PatientWorld.linear() * turn)));

  ProxyState& proxy = hand.proxy;
  const std::optional<Burr> burr = burr_of(model, motor, X_PatientWorld, turn);
  if (burr) {
    if (change.surfaces) settle_burr(model.surfaces, *burr, change.carved, proxy, hand.burr);
    tool_spheres[0].radius_mm = burr->radius_mm - hand.burr.inset_mm;
  }
  const unsigned coupled_before = coupled_layers(proxy);
  if (change.surfaces) keep_proxy(model.surfaces, spheres, held_at, change.before, proxy);
  const bool let_go = coupled_layers(proxy) != coupled_before;
  if (change.method && !proxy.coupled) give_birth_to_proxy(model.surfaces, spheres, held_at, proxy);
  const ProxyOptions options{parameters.friction, most_stiffness_N_per_mm(gains), dt_s};
  const ProxyResult result = burr ? advance_burr(model.surfaces, *burr, held_at, proxy, hand.burr, options)
                                  : advance_proxy(model.surfaces, spheres, held_at, proxy, options);
  if (burr) tool_spheres[0].radius_mm = burr->radius_mm - hand.burr.sunk_mm;
  // as the proxy holds it
  const TurnedTool held(spheres, held_at.attitude, proxy.attitude);
  const Vector<Patient> pull_mm = proxy.coupled ? (proxy.position - tip) * proxy.part : Vector<Patient>();
  const double most_N_s_per_mm = most_damping_N_s_per_mm(gains);
  const double damping_N_s_per_mm =
      std::min(model.method_settings.coupling_damping_N_s_per_mm, most_N_s_per_mm);
  // the layers within are met as they are: what is felt of them comes in with the depth
  const ProxyForce& outermost = result.of_layer[0];
  CouplingState& coupling = hand.coupling;
  const double less = 1 - coupled(outermost, pull_mm, damping_N_s_per_mm, dt_s, coupling);
  ToolContact tool;
  tool.let_go = let_go;
  tool.strongest =
      strongest_of(model, proxy, held.spheres(), tip, result, result.force_N - outermost.force_N * less);
  ContactSite& site = tool.strongest.site;
  if (site.tissue < 0 && proxy.punctured.any()) site = site_of(model, label_at(model, tip), kInside_mm);
  if (parameters.viscosity && site.tissue >= 0)
    tool.strongest.force_N +=
        viscous_force(model.tissues[static_cast<std::size_t>(site.tissue)], velocity_mm_s,
                      site.depth_mm / kInside_mm, most_N_s_per_mm - damping_N_s_per_mm);
  tool.felt = felt_by_proxy(model, result, tool.strongest);
  tool.asked.force_N = X_WorldPatient * tool.strongest.force_N * gains.force_gain;
  tool.asked.torque_Nmm =
      X_WorldPatient * (result.torque_Nmm - outermost.torque_Nmm * less) * (gains.force_gain / gains.scale);
  tool.stored_mJ =
      (0.5 * coupling.stiffness_N_per_mm * pull_mm.squared_norm() + result.stored_mJ - outermost.stored_mJ) *
      (gains.force_gain / gains.scale);
  tool.stiffness_N_per_mm =
      (coupling.stiffness_N_per_mm + result.stiffness_N_per_mm - outermost.stiffness_N_per_mm) *
      (gains.force_gain * gains.scale);
  if (!proxy.coupled) tool.flags |= kFlagInside;
  if (result.wedged) tool.flags |= kFlagWedged;
  if (result.ruptured) tool.flags |= kFlagRuptured;
  return tool;
}

}  // namespace palpate
