#include "recording/columns.h"

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
           "real clock: how late the tick began, 0 on the virtual clock"},
    Column{"compute_s", kF64, 1, PALPATE_TICK(compute_s), "s", "-",
           "real clock: time from reading the devices to the commands, 0 on the virtual clock"},
    Column{"model_version", kU32, 1, PALPATE_TICK(model_version), "1", "-",
           "version of the model that was felt"},
    Column{"yield_frame", kU32, 1, PALPATE_TICK(yield_frame), "1", "-",
           "input: newest solution of tissue that yields, 0 none"},
    Column{"method", kU8, 1, PALPATE_TICK(method), "1", "-", "force method", method_numbers},
    Column{"switches", kU8, 1, PALPATE_TICK(switches), "bits", "-", "what was switched on", switch_bits},
    Column{"max_force_N", kF64, 1, PALPATE_TICK(max_force_N), "N", "-", "input: the user's limit of force"},
    Column{"rotation_target_wxyz", kF64, 4, PALPATE_TICK(rotation_target_wxyz), "1", "World",
           "commanded rotation of the object, unit quaternion"},
    Column{"rotation_felt_wxyz", kF64, 4, PALPATE_TICK(rotation_felt_wxyz), "1", "World",
           "interpolated rotation of the object, the one that is felt, unit quaternion"},
    Column{"state_hash", kU64, 1, PALPATE_TICK(state_hash), "1", "-",
           "hash of the session state after the tick, what was sent included"},
};

// column of the n-th contact property of a model change
constexpr Column changed_property(std::size_t n, const char* meaning) {
  return {kContactProperties[n].name.data(),
          kF64,
          1,
          PALPATE_EVENT(change.contact) + n * sizeof(double),
          kContactProperties[n].ascii_unit.data(),
          "-",
          meaning};
}

constexpr std::array kEventColumns{
    Column{"tick", kU64, 1, PALPATE_EVENT(tick), "1", "-", "number of the first tick that had heard of it"},
    Column{"kind", kU8, 1, PALPATE_EVENT(kind), "1", "-", "what was asked for", event_kinds},
    Column{"asked_by", kU8, 1, PALPATE_EVENT(by.asker), "1", "-", "who asked for it", askers},
    Column{"viewer", kU32, 1, PALPATE_EVENT(by.viewer), "1", "-",
           "which viewer asked, from 1 in the order in which they said hello, 0 none"},
    Column{
        "number", kU32, 1, PALPATE_EVENT(number), "1", "-",
        "model: the version that it became; settings: which one, from 1; stop and rearm: which one of both, "
        "from 1; tissue solved: which solution, from 1"},
    Column{"tissue", kU32, 1, PALPATE_EVENT(change.tissue), "1", "-",
           "model: place of the changed tissue in the scene, from 0. 4294967295: the fields of the direct "
           "methods were made anew. 4294967294: it was cut by the sweeps before. 4294967293: the last stroke "
           "was undone; 4294967292: the last one that was undone was done again. 4294967280 ... 4294967283: "
           "soft tissue goes by the law layers, elastic, neo-hookean, chainmail from then on"},
    changed_property(
        0,
        "model: value that the tissue has from then on; of a law the factor by which its cells are "
        "longer than the scene's, 0: as before"),
    changed_property(1, "model: value that the tissue has from then on"),
    changed_property(2, "model: value that the tissue has from then on"),
    changed_property(3, "model: value that the tissue has from then on"),
    Column{"changed", kU8, 1, PALPATE_EVENT(changed), "bits", "-", "settings: what became different",
           setting_bits},
    Column{"method", kU8, 1, PALPATE_EVENT(method), "1", "-", "settings: force method from then on",
           method_numbers},
    Column{"switches", kU8, 1, PALPATE_EVENT(switches), "bits", "-",
           "settings: what is switched on from then on", switch_bits},
    Column{"max_force_N", kF64, 1, PALPATE_EVENT(max_force_N), "N", "-",
           "settings: the user's limit of force from then on"},
    Column{"rotation_target_wxyz", kF64, 4, PALPATE_EVENT(rotation_wxyz), "1", "World",
           "settings: commanded rotation of the object from then on, unit quaternion"},
    Column{"device", kU32, 1, PALPATE_EVENT(sweep.device), "1", "-", "sweep: whose burr it was, from 0"},
    Column{"from_patient_mm", kF64, 3, PALPATE_EVENT(sweep.from_mm), "mm", "Patient",
           "sweep: where the middle of the burr's ball was first, of a cylinder or cone of that at its tip"},
    Column{"to_patient_mm", kF64, 3, PALPATE_EVENT(sweep.to_mm), "mm", "Patient",
           "sweep: where it went from there, in a straight line"},
    Column{"radius_mm", kF64, 1, PALPATE_EVENT(sweep.radius_mm), "mm", "-", "sweep: of that ball"},
    Column{"stroke", kU32, 1, PALPATE_EVENT(sweep.stroke), "1", "-",
           "sweep: of which stroke it is, counted from the motor's first start"},
    Column{
        "axis_patient_mm", kF64, 3, PALPATE_EVENT(sweep.axis_mm), "mm", "Patient",
        "sweep: of a cylinder or cone, from the middle of the ball at its tip to that of the one at its far "
        "end; 0: a ball"},
    Column{"end_radius_mm", kF64, 1, PALPATE_EVENT(sweep.end_radius_mm), "mm", "-",
           "sweep: of the ball at the far end of a cylinder or cone"},
    Column{"input_tick", kU64, 1, PALPATE_EVENT(input_tick), "1", "-",
           "tissue solved: number of the tick that it was solved from"},
    Column{"frame_hash", kU64, 1, PALPATE_EVENT(frame_hash), "1", "-",
           "tissue solved: hash of what came out"},
};

constexpr std::array kDeviceColumns{
    Column{"tip_world_mm", kF64, 3, PALPATE_DEVICE(tip_world_mm), "mm", "World",
           "input: position of the tip"},
    Column{"orientation_wxyz", kF64, 4, PALPATE_DEVICE(orientation_wxyz), "1", "World",
           "input: rotation from the tool's axes to World, unit quaternion"},
    Column{"velocity_world_mm_s", kF64, 3, PALPATE_DEVICE(velocity_world_mm_s), "mm/s", "World",
           "input: velocity of the tip as the device estimates it, NaN: it does not"},
    Column{"angular_velocity_world_rad_s", kF64, 3, PALPATE_DEVICE(angular_velocity_world_rad_s), "rad/s",
           "World", "input: angular velocity as the device estimates it, NaN: it does not"},
    Column{"gripper_rad", kF64, 1, PALPATE_DEVICE(gripper_rad), "rad", "-",
           "input: opening of the gripper, NaN: there is none"},
    Column{"buttons", kU32, 1, PALPATE_DEVICE(buttons), "bits", "-",
           "input: bit n is set while button n is held"},
    Column{"status", kU32, 1, PALPATE_DEVICE(status), "bits", "-", "input: why the device gets no force",
           status_bits},
    Column{"age_s", kF64, 1, PALPATE_DEVICE(age_s), "s", "-",
           "input: how long before the tick the pose was true"},
    Column{"force_gain", kF64, 1, PALPATE_DEVICE(force_gain), "1", "-",
           "input: N at the device for one N in the patient"},
    Column{"scale", kF64, 1, PALPATE_DEVICE(scale), "1", "-",
           "input: mm in the patient for one mm of the device"},
    Column{"peak_force_N", kF64, 1, PALPATE_DEVICE(peak_force_N), "N", "-",
           "input: most force of the device, NaN: not known"},
    Column{"continuous_force_N", kF64, 1, PALPATE_DEVICE(continuous_force_N), "N", "-",
           "input: force that the device bears for ever, NaN: not known, no thermal budget"},
    Column{"peak_torque_Nmm", kF64, 1, PALPATE_DEVICE(peak_torque_Nmm), "N mm", "-",
           "input: most torque of the device, NaN: not known, none is sent"},
    Column{"peak_gripper_N", kF64, 1, PALPATE_DEVICE(peak_gripper_N), "N", "-",
           "input: most force of the gripper, NaN: not known, none is sent"},
    Column{"slew_N_per_s", kF64, 1, PALPATE_DEVICE(slew_N_per_s), "N/s", "-", "input: most change of force"},
    Column{"max_stiffness_N_per_mm", kF64, 1, PALPATE_DEVICE(max_stiffness_N_per_mm), "N/mm", "-",
           "input: stiffness of the device that a hand holds; stiffer tissues are felt as this stiff"},
    Column{"position_step_mm", kF64, 1, PALPATE_DEVICE(position_step_mm), "mm", "-",
           "input: step of the device's encoders, NaN: not known"},
    Column{"max_damping_N_s_per_mm", kF64, 1, PALPATE_DEVICE(max_damping_N_s_per_mm), "N s/mm", "-",
           "input: damping that the device bears; more is felt as so much, NaN: not known"},
    Column{"delay_s", kF64, 1, PALPATE_DEVICE(delay_s), "s", "-",
           "input: from a command to its force, as counted: 0 is none"},
    Column{"force_N", kF64, 3, PALPATE_DEVICE(force_N), "N", "World", "output: force sent to the device"},
    Column{"torque_Nmm", kF64, 3, PALPATE_DEVICE(torque_Nmm), "N mm", "World",
           "output: torque about the tip sent to the device"},
    Column{"gripper_N", kF64, 1, PALPATE_DEVICE(gripper_N), "N", "-",
           "output: force sent to the gripper, above 0 opens"},
    Column{"unclamped_force_N", kF64, 1, PALPATE_DEVICE(unclamped_force_N), "N", "-",
           "magnitude of the force before the output stage"},
    Column{"limit_N", kF64, 1, PALPATE_DEVICE(limit_N), "N", "-",
           "least of the device's, the user's, the scene's and the thermal limit, 0 when the output was off "
           "at once"},
    Column{"heat", kF64, 1, PALPATE_DEVICE(heat), "1", "-",
           "part of the thermal budget that is used, 0 to 1"},
    Column{"energy_mJ", kF64, 1, PALPATE_DEVICE(energy_mJ), "mJ", "-",
           "passivity observer: energy that the hand has put in and not got back, below 0 what it got more"},
    Column{"damping_N_s_per_m", kF64, 1, PALPATE_DEVICE(damping_N_s_per_m), "N s/m", "-",
           "damping along the force that the passivity controller added"},
    Column{"turned_mJ", kF64, 1, PALPATE_DEVICE(turned_mJ), "mJ", "-",
           "work that the turning object has done on the hand since the run began, not in energy_mJ"},
    Column{"tip_patient_mm", kF64, 3, PALPATE_DEVICE(tip_patient_mm), "mm", "Patient", "position of the tip"},
    Column{"proxy_patient_mm", kF64, 3, PALPATE_DEVICE(proxy_patient_mm), "mm", "Patient",
           "position of the proxy; of a burr in the layer in which it cuts; by a direct method, that of the "
           "tip"},
    Column{"normal_patient", kF64, 3, PALPATE_DEVICE(normal_patient), "1", "Patient",
           "outward unit normal, zero in free space"},
    Column{"velocity_patient_mm_s", kF64, 3, PALPATE_DEVICE(velocity_patient_mm_s), "mm/s", "Patient",
           "velocity of the tip relative to the object, over a window of time"},
    Column{"field", kF64, 1, PALPATE_DEVICE(field), "1", "-", "value of the field at the tip, 0 to 1"},
    Column{"depth_mm", kF64, 1, PALPATE_DEVICE(depth_mm), "mm", "-",
           "depth of the tip below the surface of the touched structure, negative in front of it, NaN when "
           "no surface is within reach, 0 where nothing is felt"},
    Column{"label", kU16, 1, PALPATE_DEVICE(label), "1", "-", "label of the touched structure, 0 none"},
    Column{"felt_label", kU16, kMaxStructuresReported, PALPATE_DEVICE(felt_label), "1", "-",
           "labels of the structures that the force comes from, outermost first, 0 no more"},
    Column{"felt_depth_mm", kF64, kMaxStructuresReported, PALPATE_DEVICE(felt_depth_mm), "mm", "-",
           "how much of the tip's way in lies within each of these, NaN: deeper than is measured"},
    Column{"felt_share", kF64, kMaxStructuresReported, PALPATE_DEVICE(felt_share), "1", "-",
           "share of the force that each of these gives, 0 to 1"},
    Column{"contact_label", kU16, kMaxContactsReported, PALPATE_DEVICE(contact_label), "1", "-",
           "labels of the structures that the tool leans on: those of the outermost layer first, in each the "
           "strongest first, 0 no more"},
    Column{"contact_part", kU16, kMaxContactsReported, PALPATE_DEVICE(contact_part), "1", "-",
           "part of the tool that leans there: its points, then its capsules, from 0"},
    Column{"contact_patient_mm", kF64, 3 * kMaxContactsReported, PALPATE_DEVICE(contact_patient_mm), "mm",
           "Patient", "where it leans: three numbers for each"},
    Column{"contact_N", kF64, kMaxContactsReported, PALPATE_DEVICE(contact_N), "N", "-",
           "force along the surface's normal there, in the patient"},
    Column{"near_label", kU16, kMaxNearReported, PALPATE_DEVICE(near_label), "1", "-",
           "labels of the structures near the tool, nearest first, 0 no more"},
    Column{"near_mm", kF64, kMaxNearReported, PALPATE_DEVICE(near_mm), "mm", "-",
           "from the tool's outline to the surface of each of these, below 0 inside"},
    Column{"no_go", kU16, 1, PALPATE_DEVICE(no_go), "1", "-",
           "no-go region that the tool is deepest in, by its place in the scene from 1, 0 none"},
    Column{"no_go_depth_mm", kF64, 1, PALPATE_DEVICE(no_go_depth_mm), "mm", "-",
           "how deep the tool is in what it is to keep out of"},
    Column{"no_go_N", kF64, 1, PALPATE_DEVICE(no_go_N), "N", "-",
           "force of all no-go regions beside what the tool leans on, before the output stage"},
    Column{"flags", kU32, 1, PALPATE_DEVICE(flags), "bits", "-",
           "what was met, and why the output was changed", flag_bits},
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
