#include "recording/columns.h"

#include <algorithm>
#include <array>
#include <bit>

#include "palpate/recording/recording.h"
#include "recording/bits.h"
#include "recording/header_fields.h"

namespace palpate::internal {
namespace {

// rows are copied bytewise between memory and file
static_assert(std::endian::native == std::endian::little);

using enum Number;

#define PALPATE_TICK(field) offsetof(TickRecord, field)
#define PALPATE_DEVICE(field) offsetof(DeviceTick, field)
#define PALPATE_EVENT(field) offsetof(RecordingEvent, field)

constexpr std::array kTickColumns{
    Column{"tick", kU64, 1, PALPATE_TICK(tick), "1", "-", "number of the tick, from 0"},
    Column{"time_s", kF64, 1, PALPATE_TICK(time_s), "s", "-",
           "0 in the first tick, then the sum of the dt_s of the ticks before"},
    Column{"dt_s", kF64, 1, PALPATE_TICK(dt_s), "s", "-", "time step of the tick"},
    Column{"lateness_s", kF64, 1, PALPATE_TICK(lateness_s), "s", "-",
           "real clock: lateness of the start of the tick, 0 on the virtual clock"},
    Column{"compute_s", kF64, 1, PALPATE_TICK(compute_s), "s", "-",
           "real clock: time from reading the devices to the commands, 0 on the virtual clock"},
    Column{"model_version", kU32, 1, PALPATE_TICK(model_version), "1", "-",
           "version of the model used for the force"},
    Column{"yield_frame", kU32, 1, PALPATE_TICK(solver_frame), "1", "-",
           "input: newest solution of yielding tissue, 0 none"},
    Column{"method", kU8, 1, PALPATE_TICK(method), "1", "-", "force method", method_numbers},
    Column{"switches", kU8, 1, PALPATE_TICK(switches), "bits", "-", "switches that are on", switch_bits},
    Column{"max_force_N", kF64, 1, PALPATE_TICK(max_force_N), "N", "-", "input: the user's force limit"},
    Column{"rotation_target_wxyz", kF64, 4, PALPATE_TICK(rotation_target_wxyz), "1", "World",
           "commanded rotation of the object, unit quaternion"},
    Column{"rotation_applied_wxyz", kF64, 4, PALPATE_TICK(rotation_applied_wxyz), "1", "World",
           "interpolated rotation of the object, used for the force, unit quaternion"},
    Column{"state_hash", kU64, 1, PALPATE_TICK(state_hash), "1", "-",
           "hash of the session state after the tick, including the output"},
};

constexpr std::array kEventColumnsBeforeProperties{
    Column{"tick", kU64, 1, PALPATE_EVENT(tick), "1", "-", "number of the first tick in effect"},
    Column{"kind", kU8, 1, PALPATE_EVENT(kind), "1", "-", "kind of request", event_kinds},
    Column{"requested_by", kU8, 1, PALPATE_EVENT(by.originator), "1", "-", "source of the request",
           originators},
    Column{"viewer", kU32, 1, PALPATE_EVENT(by.viewer), "1", "-",
           "viewer that sent the request, from 1 in the order of their hello, 0 none"},
    Column{"number", kU32, 1, PALPATE_EVENT(number), "1", "-",
           "model: new version; settings: number of the change, from 1; stop and rearm: number among both, "
           "from 1; tissue solved: number of the solution, from 1"},
    Column{
        "tissue", kU32, 1, PALPATE_EVENT(change.tissue), "1", "-",
        "model: place of the changed tissue in the scene, from 0. 4294967295: the fields of the direct "
        "methods were prepared again. 4294967294: it was cut by the preceding sweeps. 4294967293: the "
        "last stroke was undone; 4294967292: the last undone stroke was redone. 4294967280 ... "
        "4294967284: the law of soft tissue becomes layers, elastic, neo-hookean, chainmail, exponential"}};
constexpr std::array kEventColumnsAfterProperties{
    Column{"changed", kU16, 1, PALPATE_EVENT(changed), "bits", "-", "settings: fields that changed",
           setting_bits},
    Column{"method", kU8, 1, PALPATE_EVENT(method), "1", "-", "settings: new force method", method_numbers},
    Column{"switches", kU8, 1, PALPATE_EVENT(switches), "bits", "-", "settings: switches that are on",
           switch_bits},
    Column{"max_force_N", kF64, 1, PALPATE_EVENT(max_force_N), "N", "-",
           "settings: new force limit of the user"},
    Column{"rotation_target_wxyz", kF64, 4, PALPATE_EVENT(rotation_target_wxyz), "1", "World",
           "settings: new commanded rotation of the object, unit quaternion"},
    Column{"device", kU32, 1, PALPATE_EVENT(sweep.device), "1", "-",
           "sweep: device of the burr, from 0; 4294967295: removal of a fragment that was cut loose"},
    Column{"from_patient_mm", kF64, 3, PALPATE_EVENT(sweep.from_mm), "mm", "Patient",
           "sweep: start of the centre of the burr's ball; for a cylinder or cone, of the ball at its tip"},
    Column{"to_patient_mm", kF64, 3, PALPATE_EVENT(sweep.to_mm), "mm", "Patient",
           "sweep: end of the centre, along a straight line"},
    Column{"radius_mm", kF64, 1, PALPATE_EVENT(sweep.radius_mm), "mm", "-", "sweep: radius of that ball"},
    Column{"stroke", kU32, 1, PALPATE_EVENT(sweep.stroke), "1", "-",
           "sweep: number of its stroke, from the motor's first start"},
    Column{"axis_patient_mm", kF64, 3, PALPATE_EVENT(sweep.axis_mm), "mm", "Patient",
           "sweep: for a cylinder or cone, vector from the centre of the ball at its tip to that at its far "
           "end; 0: a ball"},
    Column{"end_radius_mm", kF64, 1, PALPATE_EVENT(sweep.end_radius_mm), "mm", "-",
           "sweep: radius of the ball at the far end of a cylinder or cone"},
    Column{"input_tick", kU64, 1, PALPATE_EVENT(input_tick), "1", "-",
           "tissue solved: number of the tick that it was solved for"},
    Column{"frame_hash", kU64, 1, PALPATE_EVENT(frame_hash), "1", "-",
           "tissue solved: hash of the solution; 0: memory ran out, and the solver starts again"},
};

// the contact properties of a model change stand between the two
constexpr auto kEventColumns = [] {
  std::array<Column, kEventColumnsBeforeProperties.size() + kContactProperties.size() +
                         kEventColumnsAfterProperties.size()>
      columns{};
  auto next = std::ranges::copy(kEventColumnsBeforeProperties, columns.begin()).out;
  for (std::size_t n = 0; n < kContactProperties.size(); ++n)
    *next++ = {kContactProperties[n].name.data(),
               kF64,
               1,
               PALPATE_EVENT(change.contact) + n * sizeof(double),
               kContactProperties[n].ascii_unit.data(),
               "-",
               n == 0 ? "model: new value of the tissue; for a law the ratio of its cell size to the "
                        "scene's, 0: unchanged"
                      : "model: new value of the tissue"};
  std::ranges::copy(kEventColumnsAfterProperties, next);
  return columns;
}();

constexpr std::array kDeviceColumns{
    Column{"tip_world_mm", kF64, 3, PALPATE_DEVICE(tip_world_mm), "mm", "World",
           "input: position of the tip"},
    Column{"orientation_wxyz", kF64, 4, PALPATE_DEVICE(orientation_wxyz), "1", "World",
           "input: rotation from the tool's axes to World, unit quaternion"},
    Column{"velocity_world_mm_s", kF64, 3, PALPATE_DEVICE(velocity_world_mm_s), "mm/s", "World",
           "input: velocity of the tip estimated by the device, NaN: none"},
    Column{"angular_velocity_world_rad_s", kF64, 3, PALPATE_DEVICE(angular_velocity_world_rad_s), "rad/s",
           "World", "input: angular velocity estimated by the device, NaN: none"},
    Column{"gripper_rad", kF64, 1, PALPATE_DEVICE(gripper_rad), "rad", "-",
           "input: opening of the gripper, NaN: no gripper"},
    Column{"buttons", kU32, 1, PALPATE_DEVICE(buttons), "bits", "-",
           "input: bit n is set while button n is pressed"},
    Column{"status", kU32, 1, PALPATE_DEVICE(status), "bits", "-", "input: conditions of the device",
           status_bits},
    Column{"age_s", kF64, 1, PALPATE_DEVICE(age_s), "s", "-", "input: age of the pose at the tick"},
    Column{"force_gain", kF64, 1, PALPATE_DEVICE(force_gain), "1", "-",
           "input: newtons at the device per newton in the patient"},
    Column{"scale", kF64, 1, PALPATE_DEVICE(scale), "1", "-",
           "input: millimetres in the patient per millimetre of the device"},
    Column{"peak_force_N", kF64, 1, PALPATE_DEVICE(peak_force_N), "N", "-",
           "input: maximum force of the device, NaN: unknown"},
    Column{"continuous_force_N", kF64, 1, PALPATE_DEVICE(continuous_force_N), "N", "-",
           "input: continuous force of the device, NaN: unknown, no thermal budget"},
    Column{"peak_torque_Nmm", kF64, 1, PALPATE_DEVICE(peak_torque_Nmm), "N mm", "-",
           "input: maximum torque of the device, NaN: unknown, none is sent"},
    Column{"peak_gripper_N", kF64, 1, PALPATE_DEVICE(peak_gripper_N), "N", "-",
           "input: maximum force of the gripper, NaN: unknown, none is sent"},
    Column{"slew_N_per_s", kF64, 1, PALPATE_DEVICE(slew_N_per_s), "N/s", "-",
           "input: maximum rate of change of the force"},
    Column{"max_stiffness_N_per_mm", kF64, 1, PALPATE_DEVICE(max_stiffness_N_per_mm), "N/mm", "-",
           "input: maximum stable stiffness of the device; stiffer tissues are rendered with it"},
    Column{"position_step_mm", kF64, 1, PALPATE_DEVICE(position_step_mm), "mm", "-",
           "input: step of the device's encoders, NaN: unknown"},
    Column{"max_damping_N_s_per_mm", kF64, 1, PALPATE_DEVICE(max_damping_N_s_per_mm), "N s/mm", "-",
           "input: maximum stable damping of the device; higher damping is rendered with it, NaN: unknown"},
    Column{"delay_s", kF64, 1, PALPATE_DEVICE(delay_s), "s", "-",
           "input: delay from a command to its force that is taken into account, 0 none"},
    Column{"force_N", kF64, 3, PALPATE_DEVICE(force_N), "N", "World", "output: force sent to the device"},
    Column{"torque_Nmm", kF64, 3, PALPATE_DEVICE(torque_Nmm), "N mm", "World",
           "output: torque about the tip sent to the device"},
    Column{"gripper_N", kF64, 1, PALPATE_DEVICE(gripper_N), "N", "-",
           "output: force sent to the gripper, positive opens"},
    Column{"unclamped_force_N", kF64, 1, PALPATE_DEVICE(unclamped_force_N), "N", "-",
           "magnitude of the force before the output stage"},
    Column{"limit_N", kF64, 1, PALPATE_DEVICE(limit_N), "N", "-",
           "least of the device's, the user's, the scene's and the thermal limit, 0 when the output was "
           "switched off immediately"},
    Column{"heat", kF64, 1, PALPATE_DEVICE(heat), "1", "-", "fraction of the thermal budget used, 0 to 1"},
    Column{"energy_mJ", kF64, 1, PALPATE_DEVICE(energy_mJ), "mJ", "-",
           "passivity observer: energy that the hand has put in minus the energy returned"},
    Column{"damping_N_s_per_m", kF64, 1, PALPATE_DEVICE(damping_N_s_per_m), "N s/m", "-",
           "damping along the force that the passivity controller added"},
    Column{"turned_mJ", kF64, 1, PALPATE_DEVICE(turned_mJ), "mJ", "-",
           "work of the turning object on the hand since the start of the run, not in energy_mJ"},
    Column{"cutting_N", kF64, 1, PALPATE_DEVICE(cutting_N), "N", "-",
           "press force of a burr while it cuts, in the patient, 0 where it cuts nothing", nullptr, 1},
    Column{"cutting_energy_mJ_per_mm3", kF64, 1, PALPATE_DEVICE(cutting_energy_mJ_per_mm3), "mJ/mm^3", "-",
           "mean specific cutting energy of the material ahead of a burr while it cuts", nullptr, 1},
    Column{"vibration_hz", kF64, 1, PALPATE_DEVICE(vibration_hz), "Hz", "-",
           "frequency of a burr's rendered vibration, 0 none", nullptr, 1},
    Column{"vibration_N", kF64, 1, PALPATE_DEVICE(vibration_N), "N", "-",
           "amplitude of a burr's rendered vibration, before the output stage", nullptr, 1},
    Column{"kick_N", kF64, 1, PALPATE_DEVICE(kick_N), "N", "-",
           "force of a burr's kick along its rolling direction, signed, before the output stage", nullptr, 1},
    Column{"bone_rise_K", kF64, 1, PALPATE_DEVICE(bone_rise_K), "K", "-",
           "estimated temperature rise of the bone at a burr without irrigation", nullptr, 1},
    Column{"tip_patient_mm", kF64, 3, PALPATE_DEVICE(tip_patient_mm), "mm", "Patient", "position of the tip"},
    Column{"proxy_patient_mm", kF64, 3, PALPATE_DEVICE(proxy_patient_mm), "mm", "Patient",
           "position of the proxy; for a burr that of the layer in which it cuts; with a direct method that "
           "of the tip"},
    Column{"normal_patient", kF64, 3, PALPATE_DEVICE(normal_patient), "1", "Patient",
           "outward unit normal, zero in free space"},
    Column{"velocity_patient_mm_s", kF64, 3, PALPATE_DEVICE(velocity_patient_mm_s), "mm/s", "Patient",
           "velocity of the tip relative to the object, over a time window"},
    Column{"field", kF64, 1, PALPATE_DEVICE(field), "1", "-", "value of the field at the tip, 0 to 1"},
    Column{"depth_mm", kF64, 1, PALPATE_DEVICE(depth_mm), "mm", "-",
           "depth of the tip below the surface of the touched structure, negative in front of it, NaN when "
           "no surface is within reach, 0 where nothing is felt"},
    Column{"label", kU16, 1, PALPATE_DEVICE(label), "1", "-", "label of the touched structure, 0 none"},
    Column{"path_label", kU16, kMaxStructuresReported, PALPATE_DEVICE(path_label), "1", "-",
           "labels of the structures that contribute to the force, outermost first, 0 unused"},
    Column{"path_depth_mm", kF64, kMaxStructuresReported, PALPATE_DEVICE(path_depth_mm), "mm", "-",
           "length of the tip's path inside each of these, NaN: deeper than measured"},
    Column{"path_share", kF64, kMaxStructuresReported, PALPATE_DEVICE(path_share), "1", "-",
           "fraction of the force from each of these, 0 to 1"},
    Column{"contact_label", kU16, kMaxContactsReported, PALPATE_DEVICE(contact_label), "1", "-",
           "labels of the structures in contact with the tool: outermost layer first, in each the strongest "
           "first, 0 unused"},
    Column{"contact_part", kU16, kMaxContactsReported, PALPATE_DEVICE(contact_part), "1", "-",
           "part of the tool in contact: its points, then its capsules, from 0"},
    Column{"contact_patient_mm", kF64, 3 * kMaxContactsReported, PALPATE_DEVICE(contact_patient_mm), "mm",
           "Patient", "contact points: three numbers for each"},
    Column{"contact_N", kF64, kMaxContactsReported, PALPATE_DEVICE(contact_N), "N", "-",
           "normal force at each contact, in the patient"},
    Column{"near_label", kU16, kMaxNearReported, PALPATE_DEVICE(near_label), "1", "-",
           "labels of the structures near the tool, nearest first, 0 unused"},
    Column{"near_mm", kF64, kMaxNearReported, PALPATE_DEVICE(near_mm), "mm", "-",
           "distance from the tool's outline to the surface of each of these, negative inside"},
    Column{"no_go", kU16, 1, PALPATE_DEVICE(no_go), "1", "-",
           "no-go region that the tool is deepest in, by its order in the scene from 1, 0 none"},
    Column{"no_go_depth_mm", kF64, 1, PALPATE_DEVICE(no_go_depth_mm), "mm", "-",
           "penetration of the tool into it"},
    Column{"no_go_N", kF64, 1, PALPATE_DEVICE(no_go_N), "N", "-",
           "force of all no-go regions, without contact forces, before the output stage"},
    Column{"flags", kU32, 1, PALPATE_DEVICE(flags), "bits", "-",
           "events of the tick, and reasons why the output was changed", flag_bits},
};

#undef PALPATE_TICK
#undef PALPATE_DEVICE
#undef PALPATE_EVENT

std::size_t sum_of_rows(std::span<const Column> columns) {
  std::size_t bytes = 0;
  for (const Column& column : columns) bytes += column.row_bytes();
  return bytes;
}

}  // namespace

std::size_t size_of(Number number) {
  switch (number) {
    case kU8:
      return 1;
    case kU16:
      return 2;
    case kU32:
      return 4;
    case kU64:
    case kF64:
      break;
  }
  return 8;
}

std::span<const Column> tick_columns() {
  return kTickColumns;
}
std::span<const Column> device_columns() {
  return kDeviceColumns;
}
std::span<const Column> event_columns() {
  return kEventColumns;
}

std::size_t tick_bytes(int devices) {
  return sum_of_rows(kTickColumns) + static_cast<std::size_t>(devices) * sum_of_rows(kDeviceColumns);
}

}  // namespace palpate::internal
