#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>

#include "c/guard.h"
#include "palpate/contact/model.h"
#include "palpate/rendering/rendering.h"
#include "palpate/rendering/volume_renderer.h"
#include "palpate/servo/servo.h"

/// Defaults of the structs of palpate.h, and their members for bindings of other languages.
namespace palpate::c {
namespace {

// ---- members

template <class Member>
constexpr plp_type type_of() {
  using Value = std::remove_cv_t<std::remove_all_extents_t<Member>>;
  if constexpr (std::is_same_v<Value, const char*>)
    return PLP_STRING;
  else if constexpr (std::is_pointer_v<Value>)
    return PLP_POINTER;
  else if constexpr (std::is_same_v<Value, double>)
    return PLP_FLOAT64;
  else if constexpr (std::is_same_v<Value, std::uint8_t>)
    return PLP_UINT8;
  else if constexpr (std::is_same_v<Value, std::int32_t>)
    return PLP_INT32;
  else if constexpr (std::is_same_v<Value, std::uint32_t>)
    return PLP_UINT32;
  else if constexpr (std::is_same_v<Value, std::int64_t>)
    return PLP_INT64;
  else {
    static_assert(std::is_same_v<Value, std::uint64_t>, "add the type to plp_type");
    return PLP_UINT64;
  }
}

template <class Member>
constexpr std::uint32_t count_of() {
  return std::is_array_v<Member> ? std::extent_v<Member> : 1;
}

#define PALPATE_FIELD(Struct, member)                                                          \
  plp_field {                                                                                  \
    sizeof(plp_field), type_of<decltype(Struct::member)>(), #member, offsetof(Struct, member), \
        count_of<decltype(Struct::member)>()                                                   \
  }

constexpr std::array k_plp_labels{
    PALPATE_FIELD(plp_labels, size),       PALPATE_FIELD(plp_labels, type),
    PALPATE_FIELD(plp_labels, voxels),     PALPATE_FIELD(plp_labels, dims),
    PALPATE_FIELD(plp_labels, reserved),   PALPATE_FIELD(plp_labels, strides_bytes),
    PALPATE_FIELD(plp_labels, spacing_mm), PALPATE_FIELD(plp_labels, direction),
    PALPATE_FIELD(plp_labels, origin_mm),
};

constexpr std::array k_plp_tissue{
    PALPATE_FIELD(plp_tissue, size),
    PALPATE_FIELD(plp_tissue, touchable),
    PALPATE_FIELD(plp_tissue, name),
    PALPATE_FIELD(plp_tissue, stiffness_N_per_mm),
    PALPATE_FIELD(plp_tissue, static_friction),
    PALPATE_FIELD(plp_tissue, friction),
    PALPATE_FIELD(plp_tissue, viscosity_N_s_per_mm),
    PALPATE_FIELD(plp_tissue, puncture_N),
};

constexpr std::array k_plp_structure{
    PALPATE_FIELD(plp_structure, size), PALPATE_FIELD(plp_structure, label),
    PALPATE_FIELD(plp_structure, name), PALPATE_FIELD(plp_structure, tissue),
    PALPATE_FIELD(plp_structure, rgb),  PALPATE_FIELD(plp_structure, reserved),
};

constexpr std::array k_plp_tool{
    PALPATE_FIELD(plp_tool, size),          PALPATE_FIELD(plp_tool, point_count),
    PALPATE_FIELD(plp_tool, name),          PALPATE_FIELD(plp_tool, points_mm),
    PALPATE_FIELD(plp_tool, radius_mm),     PALPATE_FIELD(plp_tool, capsules),
    PALPATE_FIELD(plp_tool, capsule_count), PALPATE_FIELD(plp_tool, reserved),
};

constexpr std::array k_plp_model_options{
    PALPATE_FIELD(plp_model_options, size),
    PALPATE_FIELD(plp_model_options, method),
    PALPATE_FIELD(plp_model_options, title),
    PALPATE_FIELD(plp_model_options, max_force_N),
};

constexpr std::array k_plp_cut{
    PALPATE_FIELD(plp_cut, size),  PALPATE_FIELD(plp_cut, reserved),  PALPATE_FIELD(plp_cut, from_mm),
    PALPATE_FIELD(plp_cut, to_mm), PALPATE_FIELD(plp_cut, radius_mm),
};

constexpr std::array k_plp_model_info{
    PALPATE_FIELD(plp_model_info, size),         PALPATE_FIELD(plp_model_info, version),
    PALPATE_FIELD(plp_model_info, content_hash), PALPATE_FIELD(plp_model_info, title),
    PALPATE_FIELD(plp_model_info, dims),         PALPATE_FIELD(plp_model_info, method),
    PALPATE_FIELD(plp_model_info, spacing_mm),   PALPATE_FIELD(plp_model_info, direction),
    PALPATE_FIELD(plp_model_info, origin_mm),    PALPATE_FIELD(plp_model_info, world_patient),
    PALPATE_FIELD(plp_model_info, max_force_N),  PALPATE_FIELD(plp_model_info, tissues),
    PALPATE_FIELD(plp_model_info, structures),   PALPATE_FIELD(plp_model_info, tools),
    PALPATE_FIELD(plp_model_info, has_scan),
};

constexpr std::array k_plp_section{
    PALPATE_FIELD(plp_section, size),          PALPATE_FIELD(plp_section, outlines),
    PALPATE_FIELD(plp_section, width_px),      PALPATE_FIELD(plp_section, height_px),
    PALPATE_FIELD(plp_section, centre_mm),     PALPATE_FIELD(plp_section, right),
    PALPATE_FIELD(plp_section, down),          PALPATE_FIELD(plp_section, width_mm),
    PALPATE_FIELD(plp_section, window_low),    PALPATE_FIELD(plp_section, window_high),
    PALPATE_FIELD(plp_section, label_opacity),
};

constexpr std::array k_plp_camera{
    PALPATE_FIELD(plp_camera, size),     PALPATE_FIELD(plp_camera, reserved),
    PALPATE_FIELD(plp_camera, width_px), PALPATE_FIELD(plp_camera, height_px),
    PALPATE_FIELD(plp_camera, focus_mm), PALPATE_FIELD(plp_camera, right),
    PALPATE_FIELD(plp_camera, down),     PALPATE_FIELD(plp_camera, width_mm),
    PALPATE_FIELD(plp_camera, eye_mm),
};

constexpr std::array k_plp_pose{
    PALPATE_FIELD(plp_pose, size),     PALPATE_FIELD(plp_pose, buttons),
    PALPATE_FIELD(plp_pose, tip_mm),   PALPATE_FIELD(plp_pose, orientation_wxyz),
    PALPATE_FIELD(plp_pose, age_s),    PALPATE_FIELD(plp_pose, status),
    PALPATE_FIELD(plp_pose, reserved),
};

constexpr std::array k_plp_wrench{
    PALPATE_FIELD(plp_wrench, size),
    PALPATE_FIELD(plp_wrench, reserved),
    PALPATE_FIELD(plp_wrench, force_N),
    PALPATE_FIELD(plp_wrench, torque_Nmm),
};

constexpr std::array k_plp_record{
    PALPATE_FIELD(plp_record, size),
    PALPATE_FIELD(plp_record, device),
    PALPATE_FIELD(plp_record, tick),
    PALPATE_FIELD(plp_record, state_hash),
    PALPATE_FIELD(plp_record, time_s),
    PALPATE_FIELD(plp_record, dt_s),
    PALPATE_FIELD(plp_record, model_version),
    PALPATE_FIELD(plp_record, flags),
    PALPATE_FIELD(plp_record, label),
    PALPATE_FIELD(plp_record, method),
    PALPATE_FIELD(plp_record, tip_world_mm),
    PALPATE_FIELD(plp_record, orientation_world_wxyz),
    PALPATE_FIELD(plp_record, force_world_N),
    PALPATE_FIELD(plp_record, torque_world_Nmm),
    PALPATE_FIELD(plp_record, tip_patient_mm),
    PALPATE_FIELD(plp_record, proxy_patient_mm),
    PALPATE_FIELD(plp_record, normal_patient),
    PALPATE_FIELD(plp_record, velocity_patient_mm_s),
    PALPATE_FIELD(plp_record, depth_mm),
    PALPATE_FIELD(plp_record, field),
    PALPATE_FIELD(plp_record, unclamped_force_N),
    PALPATE_FIELD(plp_record, limit_N),
    PALPATE_FIELD(plp_record, energy_mJ),
    PALPATE_FIELD(plp_record, damping_N_s_per_m),
    PALPATE_FIELD(plp_record, contact_label),
    PALPATE_FIELD(plp_record, contact_part),
    PALPATE_FIELD(plp_record, contact_patient_mm),
    PALPATE_FIELD(plp_record, contact_N),
    PALPATE_FIELD(plp_record, path_label),
    PALPATE_FIELD(plp_record, path_depth_mm),
    PALPATE_FIELD(plp_record, path_share),
};

constexpr std::array k_plp_session_options{
    PALPATE_FIELD(plp_session_options, size),
    PALPATE_FIELD(plp_session_options, devices),
    PALPATE_FIELD(plp_session_options, frame),
    PALPATE_FIELD(plp_session_options, method),
    PALPATE_FIELD(plp_session_options, friction),
    PALPATE_FIELD(plp_session_options, viscosity),
    PALPATE_FIELD(plp_session_options, passivity),
    PALPATE_FIELD(plp_session_options, solve_soft_tissue),
    PALPATE_FIELD(plp_session_options, max_force_N),
    PALPATE_FIELD(plp_session_options, max_torque_Nmm),
    PALPATE_FIELD(plp_session_options, max_stiffness_N_per_mm),
    PALPATE_FIELD(plp_session_options, continuous_force_N),
    PALPATE_FIELD(plp_session_options, position_step_mm),
    PALPATE_FIELD(plp_session_options, slew_N_per_s),
};

constexpr std::array k_plp_run_options{
    PALPATE_FIELD(plp_run_options, size),        PALPATE_FIELD(plp_run_options, method),
    PALPATE_FIELD(plp_run_options, script_file), PALPATE_FIELD(plp_run_options, script_text),
    PALPATE_FIELD(plp_run_options, recording),   PALPATE_FIELD(plp_run_options, seed),
    PALPATE_FIELD(plp_run_options, max_force_N), PALPATE_FIELD(plp_run_options, rate_hz),
};

constexpr std::array k_plp_run_info{
    PALPATE_FIELD(plp_run_info, size),         PALPATE_FIELD(plp_run_info, devices),
    PALPATE_FIELD(plp_run_info, ticks),        PALPATE_FIELD(plp_run_info, run_hash),
    PALPATE_FIELD(plp_run_info, failed_steps), PALPATE_FIELD(plp_run_info, rate_hz),
    PALPATE_FIELD(plp_run_info, max_force_N),  PALPATE_FIELD(plp_run_info, limit_N),
    PALPATE_FIELD(plp_run_info, troubles),
};

constexpr std::array k_plp_loop_options{
    PALPATE_FIELD(plp_loop_options, size),
    PALPATE_FIELD(plp_loop_options, realtime),
    PALPATE_FIELD(plp_loop_options, session),
    PALPATE_FIELD(plp_loop_options, rate_hz),
};

constexpr std::array k_plp_loop_health{
    PALPATE_FIELD(plp_loop_health, size),
    PALPATE_FIELD(plp_loop_health, running),
    PALPATE_FIELD(plp_loop_health, ticks),
    PALPATE_FIELD(plp_loop_health, skipped),
    PALPATE_FIELD(plp_loop_health, rate_hz),
    PALPATE_FIELD(plp_loop_health, on_time),
    PALPATE_FIELD(plp_loop_health, lateness_p99_us),
    PALPATE_FIELD(plp_loop_health, compute_p99_us),
};

constexpr std::array k_plp_recording_info{
    PALPATE_FIELD(plp_recording_info, size),       PALPATE_FIELD(plp_recording_info, devices),
    PALPATE_FIELD(plp_recording_info, ticks),      PALPATE_FIELD(plp_recording_info, run_hash),
    PALPATE_FIELD(plp_recording_info, model_hash), PALPATE_FIELD(plp_recording_info, rate_hz),
    PALPATE_FIELD(plp_recording_info, data_set),   PALPATE_FIELD(plp_recording_info, title),
    PALPATE_FIELD(plp_recording_info, script),     PALPATE_FIELD(plp_recording_info, complete),
    PALPATE_FIELD(plp_recording_info, simulated),
};

constexpr std::array k_plp_field{
    PALPATE_FIELD(plp_field, size),   PALPATE_FIELD(plp_field, type),  PALPATE_FIELD(plp_field, name),
    PALPATE_FIELD(plp_field, offset), PALPATE_FIELD(plp_field, count),
};

#undef PALPATE_FIELD

struct Described {
  std::string_view name;
  std::size_t size;
  std::span<const plp_field> fields;
};
constexpr std::array kDescribed{
    Described{"plp_labels", sizeof(plp_labels), k_plp_labels},
    Described{"plp_tissue", sizeof(plp_tissue), k_plp_tissue},
    Described{"plp_structure", sizeof(plp_structure), k_plp_structure},
    Described{"plp_tool", sizeof(plp_tool), k_plp_tool},
    Described{"plp_model_options", sizeof(plp_model_options), k_plp_model_options},
    Described{"plp_cut", sizeof(plp_cut), k_plp_cut},
    Described{"plp_model_info", sizeof(plp_model_info), k_plp_model_info},
    Described{"plp_section", sizeof(plp_section), k_plp_section},
    Described{"plp_camera", sizeof(plp_camera), k_plp_camera},
    Described{"plp_pose", sizeof(plp_pose), k_plp_pose},
    Described{"plp_wrench", sizeof(plp_wrench), k_plp_wrench},
    Described{"plp_record", sizeof(plp_record), k_plp_record},
    Described{"plp_session_options", sizeof(plp_session_options), k_plp_session_options},
    Described{"plp_run_options", sizeof(plp_run_options), k_plp_run_options},
    Described{"plp_run_info", sizeof(plp_run_info), k_plp_run_info},
    Described{"plp_loop_options", sizeof(plp_loop_options), k_plp_loop_options},
    Described{"plp_loop_health", sizeof(plp_loop_health), k_plp_loop_health},
    Described{"plp_recording_info", sizeof(plp_recording_info), k_plp_recording_info},
    Described{"plp_field", sizeof(plp_field), k_plp_field},
};

const Described* find_struct(const char* name) {
  if (name == nullptr) return nullptr;
  const auto found = std::ranges::find(kDescribed, std::string_view(name), &Described::name);
  return found == kDescribed.end() ? nullptr : &*found;
}

// ---- defaults

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

// writes the defaults to a struct of which the caller knows `size` bytes
template <class Struct>
plp_status init(Struct* to, std::size_t size, const Struct& defaults) {
  return guarded([&] {
    if (to == nullptr) return fail(PLP_BAD_INPUT, "a struct to initialise is null");
    if (size > kMaxStructBytes || !is_size(static_cast<std::uint32_t>(size), sizeof(Struct)))
      return fail(PLP_BAD_INPUT, "size: give sizeof of the struct");
    std::memset(static_cast<void*>(to), 0, size);
    std::memcpy(static_cast<void*>(to), &defaults, sizeof defaults);
    to->size = static_cast<std::uint32_t>(size);
    return PLP_OK;
  });
}

}  // namespace
}  // namespace palpate::c

using palpate::c::init;

plp_status plp_labels_init(plp_labels* labels, size_t size) {
  plp_labels defaults{};
  defaults.type = PLP_UINT16;
  for (int axis = 0; axis < 3; ++axis) defaults.spacing_mm[axis] = defaults.direction[4 * axis] = 1;
  return init(labels, size, defaults);
}

plp_status plp_tissue_init(plp_tissue* tissue, size_t size) {
  const palpate::Tissue usual;
  plp_tissue defaults{};
  defaults.touchable = usual.touchable;
  defaults.stiffness_N_per_mm = usual.stiffness_N_per_mm;
  defaults.static_friction = usual.static_friction;
  defaults.friction = usual.friction;
  defaults.viscosity_N_s_per_mm = usual.viscosity_N_s_per_mm;
  defaults.puncture_N = usual.puncture_N;
  return init(tissue, size, defaults);
}

plp_status plp_structure_init(plp_structure* structure, size_t size) {
  const palpate::Rgb usual;
  plp_structure defaults{};
  defaults.tissue = -1;
  defaults.rgb[0] = usual.r;
  defaults.rgb[1] = usual.g;
  defaults.rgb[2] = usual.b;
  return init(structure, size, defaults);
}

plp_status plp_tool_init(plp_tool* tool, size_t size) {
  return init(tool, size, plp_tool{});
}

plp_status plp_model_options_init(plp_model_options* options, size_t size) {
  plp_model_options defaults{};
  defaults.method = PLP_DEFAULT_METHOD;
  defaults.max_force_N = palpate::c::kInfinity;
  return init(options, size, defaults);
}

plp_status plp_cut_init(plp_cut* cut, size_t size) {
  return init(cut, size, plp_cut{});
}

plp_status plp_section_init(plp_section* section, size_t size) {
  const palpate::SectionStyle usual;
  plp_section defaults{};
  defaults.outlines = usual.outlines;
  defaults.width_px = defaults.height_px = 512;
  defaults.right[0] = defaults.down[1] = 1;
  defaults.width_mm = 100;
  defaults.label_opacity = usual.label_opacity;
  return init(section, size, defaults);
}

plp_status plp_camera_init(plp_camera* camera, size_t size) {
  const palpate::VolumeCamera usual;
  plp_camera defaults{};
  defaults.width_px = usual.width_px;
  defaults.height_px = usual.height_px;
  defaults.right[0] = 1;
  defaults.down[2] = -1;
  defaults.width_mm = usual.width_mm;
  defaults.eye_mm = usual.eye_mm;
  return init(camera, size, defaults);
}

plp_status plp_pose_init(plp_pose* pose, size_t size) {
  plp_pose defaults{};
  defaults.orientation_wxyz[0] = 1;
  return init(pose, size, defaults);
}

plp_status plp_wrench_init(plp_wrench* wrench, size_t size) {
  return init(wrench, size, plp_wrench{});
}

plp_status plp_record_init(plp_record* record, size_t size) {
  return init(record, size, plp_record{});
}

plp_status plp_session_options_init(plp_session_options* options, size_t size) {
  const palpate::Parameters usual;
  const palpate::OutputLimits limits;
  plp_session_options defaults{};
  defaults.devices = 1;
  defaults.frame = PLP_WORLD;
  defaults.method = PLP_DEFAULT_METHOD;
  defaults.friction = usual.friction;
  defaults.viscosity = usual.viscosity;
  defaults.passivity = usual.passivity;
  defaults.max_force_N = usual.max_force_N;
  defaults.max_stiffness_N_per_mm = palpate::c::kInfinity;
  defaults.continuous_force_N = palpate::c::kNone;
  defaults.position_step_mm = palpate::c::kNone;
  defaults.slew_N_per_s = limits.slew_N_per_s;
  return init(options, size, defaults);
}

plp_status plp_run_options_init(plp_run_options* options, size_t size) {
  plp_run_options defaults{};
  defaults.method = PLP_DEFAULT_METHOD;
  defaults.seed = -1;
  defaults.max_force_N = palpate::c::kNone;
  defaults.rate_hz = palpate::c::kNone;
  return init(options, size, defaults);
}

plp_status plp_loop_options_init(plp_loop_options* options, size_t size) {
  plp_loop_options defaults{};
  defaults.rate_hz = 1000;
  return init(options, size, defaults);
}

plp_status plp_struct_field(const char* name, size_t index, plp_field* field) {
  return palpate::c::guarded([&] {
    const auto* const described = palpate::c::find_struct(name);
    if (described == nullptr) return palpate::c::fail(PLP_BAD_INPUT, "name: there is no such struct");
    if (index >= described->fields.size())
      return palpate::c::fail(PLP_BAD_INPUT, "index: the struct has fewer members");
    return palpate::c::write(described->fields[index], field) ? PLP_OK : PLP_BAD_INPUT;
  });
}

size_t plp_struct_size(const char* name) {
  const auto* const described = palpate::c::find_struct(name);
  return described == nullptr ? 0 : described->size;
}

const char* plp_version() {
  return PLP_VERSION;
}
