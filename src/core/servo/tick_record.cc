#include "servo/tick_record.h"

namespace palpate {
namespace {

template <class Frame>
std::array<double, 3> plain(const Vector<Frame>& v) {
  return {v.x(), v.y(), v.z()};
}
template <class Frame>
std::array<double, 3> plain(const Point<Frame>& p) {
  return {p.x(), p.y(), p.z()};
}

}  // namespace

std::array<double, 4> plain(const Eigen::Quaterniond& q) {
  return {q.w(), q.x(), q.y(), q.z()};
}

std::uint8_t switches_of(const Parameters& parameters) {
  return static_cast<std::uint8_t>(switch_bits(parameters) |
                                   (parameters.emergency_stop ? kSwitchEmergencyStop : 0));
}

void record_inputs(const Model& model, const Parameters& parameters, const SessionState& state, double dt_s,
                   std::size_t devices, TickRecord& record) {
  record.tick = state.tick;
  record.time_s = state.time_s;
  record.dt_s = dt_s;
  record.lateness_s = record.compute_s = 0;
  record.model_version = model.version;
  record.solver_frame = parameters.compliance.number;
  record_settings(parameters, record);
  record.switches = switches_of(parameters);
  record.devices = static_cast<int>(devices);
}

void record_inputs(const DeviceState& device, const DeviceParameters& parameters, DeviceTick& out) {
  out = {};
  out.tip_world_mm = plain(device.tip);
  out.orientation_wxyz = plain(device.R_WorldTool);
  out.velocity_world_mm_s = plain(device.velocity_mm_s);
  out.angular_velocity_world_rad_s = plain(device.angular_velocity_rad_s);
  out.gripper_rad = device.gripper_rad;
  out.buttons = device.buttons;
  out.status = device.status;
  out.age_s = device.age_s;
  out.force_gain = parameters.force_gain;
  out.scale = parameters.scale;
  out.peak_force_N = parameters.limits.peak_force_N;
  out.continuous_force_N = parameters.limits.continuous_force_N;
  out.peak_torque_Nmm = parameters.limits.peak_torque_Nmm;
  out.peak_gripper_N = parameters.limits.peak_gripper_N;
  out.slew_N_per_s = parameters.limits.slew_N_per_s;
  out.max_stiffness_N_per_mm = parameters.max_stiffness_N_per_mm;
  out.position_step_mm = parameters.position_step_mm;
  out.max_damping_N_s_per_mm = parameters.max_damping_N_s_per_mm;
  out.delay_s = parameters.delay_s;
}

void record_outputs(const ToolContact& tool, const OutputRequest& request, const Output& sent,
                    const SessionState::DeviceSession& session, DeviceTick& out) {
  if (tool.strongest.is_contact()) {
    out.flags |= kFlagContact;
    out.label = tool.strongest.site.label;
    for (std::size_t n = 0; n < tool.contacts.size() && tool.contacts[n].label != 0; ++n) {
      const ContactPoint& contact = tool.contacts[n];
      out.contact_label[n] = contact.label;
      out.contact_part[n] = static_cast<std::uint16_t>(contact.part);
      for (int axis = 0; axis < 3; ++axis)
        out.contact_patient_mm[3 * n + static_cast<std::size_t>(axis)] = contact.position[axis];
      out.contact_N[n] = contact.force_N;
    }
    for (std::size_t n = 0; n < tool.path.size(); ++n) {
      out.path_label[n] = tool.path[n].label;
      out.path_depth_mm[n] = tool.path[n].depth_mm;
      out.path_share[n] = tool.path[n].fraction;
    }
  }
  out.flags |= sent.flags;
  out.force_N = plain(sent.wrench.force_N);
  out.torque_Nmm = plain(sent.wrench.torque_Nmm);
  out.gripper_N = sent.wrench.gripper_N;
  out.unclamped_force_N = request.unclamped_N;
  out.limit_N = sent.limit_N;
  out.heat = session.output.heat;
  out.energy_mJ = session.passivity.energy_mJ;
  out.turned_mJ = session.turned_mJ;
  if (session.has_previous) out.tip_patient_mm = plain(session.previous_tip);
  out.proxy_patient_mm = session.has_previous ? plain(tool.strongest.proxy) : out.tip_patient_mm;
  out.normal_patient = plain(-tool.strongest.sample.gradient.normalized());
  out.velocity_patient_mm_s = plain(session.velocity.velocity_mm_s());
  out.field = tool.strongest.sample.value;
  out.depth_mm = tool.strongest.site.depth_mm;
}

}  // namespace palpate
