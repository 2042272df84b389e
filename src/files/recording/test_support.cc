#include "recording/test_support.h"

#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstring>
#include <fstream>

#include "recording/hdf5_handle.h"
#include "recording/hdf5_reader.h"

namespace palpate::test {
namespace {

std::uint64_t bits(double value) {
  return std::bit_cast<std::uint64_t>(value);
}

template <std::size_t N>
bool same(const std::array<double, N>& a, const std::array<double, N>& b) {
  return std::memcmp(a.data(), b.data(), sizeof a) == 0;
}

std::string first_difference(const DeviceTick& a, const DeviceTick& b) {
  if (!same(a.tip_world_mm, b.tip_world_mm)) return "tip_world_mm";
  if (!same(a.orientation_wxyz, b.orientation_wxyz)) return "orientation_wxyz";
  if (!same(a.velocity_world_mm_s, b.velocity_world_mm_s)) return "velocity_world_mm_s";
  if (!same(a.angular_velocity_world_rad_s, b.angular_velocity_world_rad_s))
    return "angular_velocity_world_rad_s";
  if (bits(a.gripper_rad) != bits(b.gripper_rad)) return "gripper_rad";
  if (a.buttons != b.buttons) return "buttons";
  if (a.status != b.status) return "status";
  if (bits(a.age_s) != bits(b.age_s)) return "age_s";
  if (bits(a.force_gain) != bits(b.force_gain)) return "force_gain";
  if (bits(a.scale) != bits(b.scale)) return "scale";
  if (bits(a.peak_force_N) != bits(b.peak_force_N)) return "peak_force_N";
  if (bits(a.continuous_force_N) != bits(b.continuous_force_N)) return "continuous_force_N";
  if (bits(a.peak_torque_Nmm) != bits(b.peak_torque_Nmm)) return "peak_torque_Nmm";
  if (bits(a.peak_gripper_N) != bits(b.peak_gripper_N)) return "peak_gripper_N";
  if (bits(a.slew_N_per_s) != bits(b.slew_N_per_s)) return "slew_N_per_s";
  if (bits(a.max_stiffness_N_per_mm) != bits(b.max_stiffness_N_per_mm)) return "max_stiffness_N_per_mm";
  if (bits(a.position_step_mm) != bits(b.position_step_mm)) return "position_step_mm";
  if (bits(a.max_damping_N_s_per_mm) != bits(b.max_damping_N_s_per_mm)) return "max_damping_N_s_per_mm";
  if (bits(a.delay_s) != bits(b.delay_s)) return "delay_s";
  if (!same(a.force_N, b.force_N)) return "force_N";
  if (!same(a.torque_Nmm, b.torque_Nmm)) return "torque_Nmm";
  if (bits(a.gripper_N) != bits(b.gripper_N)) return "gripper_N";
  if (bits(a.unclamped_force_N) != bits(b.unclamped_force_N)) return "unclamped_force_N";
  if (bits(a.limit_N) != bits(b.limit_N)) return "limit_N";
  if (bits(a.heat) != bits(b.heat)) return "heat";
  if (bits(a.energy_mJ) != bits(b.energy_mJ)) return "energy_mJ";
  if (bits(a.damping_N_s_per_m) != bits(b.damping_N_s_per_m)) return "damping_N_s_per_m";
  if (bits(a.turned_mJ) != bits(b.turned_mJ)) return "turned_mJ";
  if (bits(a.cutting_N) != bits(b.cutting_N)) return "cutting_N";
  if (bits(a.cutting_energy_mJ_per_mm3) != bits(b.cutting_energy_mJ_per_mm3))
    return "cutting_energy_mJ_per_mm3";
  if (bits(a.vibration_hz) != bits(b.vibration_hz)) return "vibration_hz";
  if (bits(a.vibration_N) != bits(b.vibration_N)) return "vibration_N";
  if (bits(a.kick_N) != bits(b.kick_N)) return "kick_N";
  if (bits(a.bone_rise_K) != bits(b.bone_rise_K)) return "bone_rise_K";
  if (!same(a.tip_patient_mm, b.tip_patient_mm)) return "tip_patient_mm";
  if (!same(a.proxy_patient_mm, b.proxy_patient_mm)) return "proxy_patient_mm";
  if (!same(a.normal_patient, b.normal_patient)) return "normal_patient";
  if (!same(a.velocity_patient_mm_s, b.velocity_patient_mm_s)) return "velocity_patient_mm_s";
  if (bits(a.field) != bits(b.field)) return "field";
  if (bits(a.depth_mm) != bits(b.depth_mm)) return "depth_mm";
  if (a.label != b.label) return "label";
  if (a.path_label != b.path_label) return "path_label";
  if (!same(a.path_depth_mm, b.path_depth_mm)) return "path_depth_mm";
  if (!same(a.path_share, b.path_share)) return "path_share";
  if (a.contact_label != b.contact_label) return "contact_label";
  if (a.contact_part != b.contact_part) return "contact_part";
  if (!same(a.contact_patient_mm, b.contact_patient_mm)) return "contact_patient_mm";
  if (!same(a.contact_N, b.contact_N)) return "contact_N";
  if (a.near_label != b.near_label) return "near_label";
  if (!same(a.near_mm, b.near_mm)) return "near_mm";
  if (a.no_go != b.no_go) return "no_go";
  if (bits(a.no_go_depth_mm) != bits(b.no_go_depth_mm)) return "no_go_depth_mm";
  if (bits(a.no_go_N) != bits(b.no_go_N)) return "no_go_N";
  if (a.flags != b.flags) return "flags";
  return "";
}

class RandomBits {
 public:
  explicit RandomBits(std::uint64_t seed) : engine_(seed) {}
  std::uint64_t word() { return engine_(); }
  double number() {
    // makes special values frequent
    switch (engine_() % 8) {
      case 0:
        return -0.0;
      case 1:
        return std::bit_cast<double>(0x7ff0000000000000u |
                                     (engine_() & 0x800fffffffffffffu));  // NaN, infinite
      case 2:
        return std::bit_cast<double>(engine_() & 0x800fffffffffffffu);  // denormal
      default:
        return std::bit_cast<double>(engine_());
    }
  }
  template <std::size_t N>
  void fill(std::array<double, N>& numbers) {
    for (double& value : numbers) value = number();
  }

 private:
  std::mt19937_64 engine_;
};

DeviceTick random_device(RandomBits& random) {
  DeviceTick device;
  random.fill(device.tip_world_mm);
  random.fill(device.orientation_wxyz);
  random.fill(device.velocity_world_mm_s);
  random.fill(device.angular_velocity_world_rad_s);
  device.buttons = static_cast<std::uint32_t>(random.word());
  device.status = static_cast<std::uint32_t>(random.word());
  for (double* number : {&device.gripper_rad,
                         &device.age_s,
                         &device.force_gain,
                         &device.scale,
                         &device.peak_force_N,
                         &device.continuous_force_N,
                         &device.peak_torque_Nmm,
                         &device.peak_gripper_N,
                         &device.slew_N_per_s,
                         &device.max_stiffness_N_per_mm,
                         &device.position_step_mm,
                         &device.max_damping_N_s_per_mm,
                         &device.delay_s,
                         &device.gripper_N,
                         &device.unclamped_force_N,
                         &device.limit_N,
                         &device.heat,
                         &device.energy_mJ,
                         &device.damping_N_s_per_m,
                         &device.turned_mJ,
                         &device.cutting_N,
                         &device.cutting_energy_mJ_per_mm3,
                         &device.vibration_hz,
                         &device.vibration_N,
                         &device.kick_N,
                         &device.bone_rise_K,
                         &device.no_go_depth_mm,
                         &device.no_go_N})
    *number = random.number();
  random.fill(device.force_N);
  random.fill(device.torque_Nmm);
  random.fill(device.tip_patient_mm);
  random.fill(device.proxy_patient_mm);
  random.fill(device.normal_patient);
  random.fill(device.velocity_patient_mm_s);
  device.field = random.number();
  device.depth_mm = random.number();
  device.label = static_cast<std::uint16_t>(random.word());
  for (std::uint16_t& label : device.path_label) label = static_cast<std::uint16_t>(random.word());
  random.fill(device.path_depth_mm);
  random.fill(device.path_share);
  for (std::uint16_t& label : device.contact_label) label = static_cast<std::uint16_t>(random.word());
  for (std::uint16_t& part : device.contact_part) part = static_cast<std::uint16_t>(random.word());
  random.fill(device.contact_patient_mm);
  random.fill(device.contact_N);
  for (std::uint16_t& label : device.near_label) label = static_cast<std::uint16_t>(random.word());
  random.fill(device.near_mm);
  device.no_go = static_cast<std::uint16_t>(random.word());
  device.flags = static_cast<std::uint32_t>(random.word());
  return device;
}

// a tip that circles and touches a plane at z = 0, 0.5 N/mm
DeviceTick example_device(double t, int device) {
  const double phase = 2 * t + device;
  DeviceTick tick;
  tick.tip_world_mm = {20 * std::cos(phase), 20 * std::sin(phase), 3 * std::sin(5 * phase)};
  tick.tip_patient_mm = {tick.tip_world_mm[0], -tick.tip_world_mm[2], tick.tip_world_mm[1]};
  tick.proxy_patient_mm = tick.tip_patient_mm;
  tick.velocity_patient_mm_s = {-40 * std::sin(phase), -30 * std::cos(5 * phase), 40 * std::cos(phase)};
  tick.peak_force_N = 8.5;
  tick.continuous_force_N = 1.4;
  tick.slew_N_per_s = 2000;
  tick.limit_N = 1.4;
  tick.heat = 0.5 - 0.5 * std::cos(0.1 * t);
  tick.depth_mm = -tick.tip_world_mm[2];
  if (tick.depth_mm <= 0) return tick;
  tick.unclamped_force_N = 0.5 * tick.depth_mm;
  tick.force_N = {0, 0, std::min(tick.unclamped_force_N, 1.4)};
  tick.normal_patient = {0, -1, 0};
  tick.field = tick.depth_mm / 3;
  tick.label = 7;
  tick.flags = kFlagContact | (tick.unclamped_force_N > 1.4 ? kFlagClamped : 0u);
  return tick;
}

}  // namespace

RecordingHeader example_header(int devices, double rate_hz) {
  RecordingHeader header;
  header.palpate_version = "0.1.0";
  header.commit = "0123456789ab";
  header.build_type = "Release";
  header.compiler = "GNU 12.2.0";
  header.simd_target = "AVX2";
  header.started_utc = "2026-03-01T12:34:56Z";
  header.data_set = "knee-phantom";
  header.scene_title = "Knee, ünïcode";
  header.model_hash = 0xfedcba9876543210u;
  header.model_version = 3;
  header.rate_hz = rate_hz;
  header.seed = 0xffffffffffffffffu;
  header.tissue_cell_factor = 1.25;
  header.device = "premium-1.5";
  header.hand = "light-grip";
  header.simulated = true;
  header.devices = devices;
  header.clock = "real";
  header.scheduler = "SCHED_FIFO 80";
  header.haptic_settings = "output.blend_s 0.1\n";
  header.task = {"find-the-nodule", 0x0123456789abcdefu, "7"};
  header.script_text = "[[step]]\napproach = \"femur\"\npress_N = 1.5\n";
  header.structures = {{7, "femur", "bone", {221, 200, 170}}, {65535, "knorpel-größe", "", {0, 255, 1}}};
  return header;
}

RecordingSummary example_summary(std::uint64_t ticks) {
  RecordingSummary summary;
  summary.ticks = ticks;
  summary.run_hash = 0x8000000000000001u;
  // all counts differ
  std::uint64_t next = 1000;
  for (std::uint64_t* count : {&summary.clamped,          &summary.not_finite,
                               &summary.outside,          &summary.paused,
                               &summary.rotation_ignored, &summary.thermal,
                               &summary.slewed,           &summary.stale,
                               &summary.jumped,           &summary.device_faults,
                               &summary.halted,           &summary.emergency_stopped,
                               &summary.clutched,         &summary.ramped,
                               &summary.blended,          &summary.method_missing,
                               &summary.inside,           &summary.wedged,
                               &summary.ruptured,         &summary.passivated,
                               &summary.dropped,          &summary.skipped,
                               &summary.rotation_limited})
    *count = next++;
  summary.problems = {"line 3: asked for 2.00 N, felt 1.40 N", "größer"};
  return summary;
}

std::vector<RecordingEvent> example_events() {
  std::vector<RecordingEvent> events(2);
  events[0].tick = 3;
  events[0].kind = RecordingEvent::Kind::kModel;
  events[0].by = {Originator::kControlViewer, 2};
  events[0].number = 4;
  events[0].change = {4, 1, 0.8, 0.3, 0.25, 0.001};
  events[1].tick = 7;
  events[1].kind = RecordingEvent::Kind::kSettings;
  events[1].by = {Originator::kKey, 0};
  events[1].number = 1;
  events[1].changed = kSettingPaused | kSettingMaxForce;
  events[1].method = 5;
  events[1].switches = kSwitchFriction | kSwitchPaused;
  events[1].max_force_N = 1.25;
  events[1].rotation_target_wxyz = {0, 1, 0, 0};
  return events;
}

std::vector<RecordingEvent> random_events(std::span<const TickRecord> ticks, std::size_t every,
                                          std::uint64_t seed) {
  RandomBits random(seed);
  std::vector<RecordingEvent> events;
  for (std::size_t i = 0; i < ticks.size(); i += every) {
    RecordingEvent& event = events.emplace_back();
    event.tick = ticks[i].tick;
    event.kind = static_cast<RecordingEvent::Kind>(random.word() % 4);
    event.by = {static_cast<Originator>(random.word() % 5), static_cast<std::uint32_t>(random.word())};
    event.number = static_cast<std::uint32_t>(random.word());
    if (event.kind == RecordingEvent::Kind::kModel) event.change.version = event.number;
    event.change.tissue = static_cast<std::uint32_t>(random.word());
    for (const ContactProperty& property : kContactProperties)
      event.change.contact.*property.value = random.number();
    event.changed = static_cast<std::uint16_t>(random.word());
    event.method = static_cast<std::uint8_t>(random.word());
    event.switches = static_cast<std::uint8_t>(random.word());
    event.max_force_N = random.number();
    random.fill(event.rotation_target_wxyz);
    event.input_tick = random.word();
    event.frame_hash = random.word();
  }
  return events;
}

std::vector<TickRecord> example_ticks(std::size_t count, int devices, double rate_hz) {
  std::vector<TickRecord> ticks(count);
  for (std::size_t i = 0; i < count; ++i) {
    TickRecord& tick = ticks[i];
    tick.tick = i;
    tick.time_s = static_cast<double>(i) / rate_hz;
    tick.dt_s = 1 / rate_hz;
    // a lateness of 20 us, every 100th tick 2 ms
    tick.lateness_s = i % 100 == 99 ? 2e-3 : 20e-6;
    tick.compute_s = 8e-6;
    tick.model_version = 1;
    tick.switches = 3;
    tick.max_force_N = 1.4;
    tick.devices = devices;
    for (int d = 0; d < devices; ++d)
      tick.device[static_cast<std::size_t>(d)] = example_device(tick.time_s, d);
    tick.state_hash = (i + 1) * 0x9e3779b97f4a7c15u;
  }
  return ticks;
}

std::vector<TickRecord> random_ticks(std::size_t count, int devices, double rate_hz, std::uint64_t seed) {
  RandomBits random(seed);
  std::vector<TickRecord> ticks(count);
  for (std::size_t i = 0; i < count; ++i) {
    TickRecord& tick = ticks[i];
    tick.tick = random.word();
    tick.time_s = static_cast<double>(i) / rate_hz;
    tick.dt_s = random.number();
    tick.lateness_s = random.number();
    tick.compute_s = random.number();
    tick.model_version = static_cast<std::uint32_t>(random.word());
    tick.solver_frame = static_cast<std::uint32_t>(random.word());
    tick.method = static_cast<std::uint8_t>(random.word());
    tick.switches = static_cast<std::uint8_t>(random.word());
    tick.max_force_N = random.number();
    random.fill(tick.rotation_target_wxyz);
    random.fill(tick.rotation_applied_wxyz);
    tick.devices = devices;
    for (int d = 0; d < devices; ++d) tick.device[static_cast<std::size_t>(d)] = random_device(random);
    tick.state_hash = random.word();
  }
  return ticks;
}

std::string first_difference(const TickRecord& a, const TickRecord& b) {
  if (a.tick != b.tick) return "tick";
  if (bits(a.time_s) != bits(b.time_s)) return "time_s";
  if (bits(a.dt_s) != bits(b.dt_s)) return "dt_s";
  if (bits(a.lateness_s) != bits(b.lateness_s)) return "lateness_s";
  if (bits(a.compute_s) != bits(b.compute_s)) return "compute_s";
  if (a.model_version != b.model_version) return "model_version";
  if (a.solver_frame != b.solver_frame) return "yield_frame";
  if (a.method != b.method) return "method";
  if (a.switches != b.switches) return "switches";
  if (bits(a.max_force_N) != bits(b.max_force_N)) return "max_force_N";
  if (!same(a.rotation_target_wxyz, b.rotation_target_wxyz)) return "rotation_target_wxyz";
  if (!same(a.rotation_applied_wxyz, b.rotation_applied_wxyz)) return "rotation_applied_wxyz";
  if (a.devices != b.devices) return "devices";
  for (std::size_t d = 0; d < a.device.size(); ++d)
    if (const auto name = first_difference(a.device[d], b.device[d]); !name.empty())
      return "device " + std::to_string(d) + " " + name;
  if (a.state_hash != b.state_hash) return "state_hash";
  return "";
}

std::string first_difference(const RecordingEvent& a, const RecordingEvent& b) {
  if (a.tick != b.tick) return "tick";
  if (a.kind != b.kind) return "kind";
  if (!(a.by == b.by)) return "by";
  if (a.number != b.number) return "number";
  if (a.change.version != b.change.version) return "version";
  if (a.change.tissue != b.change.tissue) return "tissue";
  for (const ContactProperty& property : kContactProperties)
    if (bits(a.change.contact.*property.value) != bits(b.change.contact.*property.value))
      return std::string(property.name);
  if (a.changed != b.changed) return "changed";
  if (a.method != b.method) return "method";
  if (a.switches != b.switches) return "switches";
  if (bits(a.max_force_N) != bits(b.max_force_N)) return "max_force_N";
  if (!same(a.rotation_target_wxyz, b.rotation_target_wxyz)) return "rotation_target_wxyz";
  if (a.input_tick != b.input_tick) return "input_tick";
  if (a.frame_hash != b.frame_hash) return "frame_hash";
  return "";
}

std::string first_difference(const RecordingHeader& a, const RecordingHeader& b) {
  if (a.palpate_version != b.palpate_version) return "palpate_version";
  if (a.commit != b.commit) return "commit";
  if (a.build_type != b.build_type) return "build_type";
  if (a.compiler != b.compiler) return "compiler";
  if (a.simd_target != b.simd_target) return "simd_target";
  if (a.started_utc != b.started_utc) return "started_utc";
  if (a.data_set != b.data_set) return "data_set";
  if (a.scene_title != b.scene_title) return "scene_title";
  if (a.model_hash != b.model_hash) return "model_hash";
  if (a.model_version != b.model_version) return "model_version";
  if (bits(a.rate_hz) != bits(b.rate_hz)) return "rate_hz";
  if (a.seed != b.seed) return "seed";
  if (bits(a.tissue_cell_factor) != bits(b.tissue_cell_factor)) return "tissue_coarsened";
  if (a.device != b.device) return "device";
  if (a.hand != b.hand) return "hand";
  if (a.simulated != b.simulated) return "simulated";
  if (a.devices != b.devices) return "devices";
  if (a.clock != b.clock) return "clock";
  if (a.scheduler != b.scheduler) return "scheduler";
  if (a.haptic_settings != b.haptic_settings) return "feel";
  if (a.task != b.task) return "task";
  if (a.script_text != b.script_text) return "script_text";
  const auto same_structure = [](const auto& x, const auto& y) {
    return x.label == y.label && x.name == y.name && x.tissue == y.tissue && x.colour == y.colour;
  };
  if (!std::ranges::equal(a.structures, b.structures, same_structure)) return "structures";
  return "";
}

std::string first_difference(const RecordingSummary& a, const RecordingSummary& b) {
  if (a.ticks != b.ticks) return "ticks";
  if (a.run_hash != b.run_hash) return "run_hash";
  if (a.clamped != b.clamped) return "clamped";
  if (a.not_finite != b.not_finite) return "not_finite";
  if (a.outside != b.outside) return "outside";
  if (a.paused != b.paused) return "paused";
  if (a.rotation_ignored != b.rotation_ignored) return "rotation_ignored";
  if (a.thermal != b.thermal) return "thermal";
  if (a.slewed != b.slewed) return "slewed";
  if (a.stale != b.stale) return "stale";
  if (a.jumped != b.jumped) return "jumped";
  if (a.device_faults != b.device_faults) return "device_faults";
  if (a.halted != b.halted) return "halted";
  if (a.emergency_stopped != b.emergency_stopped) return "emergency_stopped";
  if (a.clutched != b.clutched) return "clutched";
  if (a.ramped != b.ramped) return "faded";
  if (a.blended != b.blended) return "blended";
  if (a.method_missing != b.method_missing) return "method_missing";
  if (a.inside != b.inside) return "inside";
  if (a.wedged != b.wedged) return "wedged";
  if (a.ruptured != b.ruptured) return "ruptured";
  if (a.passivated != b.passivated) return "passivated";
  if (a.rotation_limited != b.rotation_limited) return "turns_held";
  if (a.dropped != b.dropped) return "dropped";
  if (a.skipped != b.skipped) return "skipped";
  if (a.problems != b.problems) return "trouble";
  return "";
}

void replay_step(const SinkingStep& step, std::vector<std::byte>& file) {
  if (step.resize) return file.resize(step.offset);
  file.resize(std::max(file.size(), step.offset + step.bytes.size()));
  std::ranges::copy(step.bytes, file.begin() + static_cast<std::ptrdiff_t>(step.offset));
}

int MemorySink::write_at(std::uint64_t offset, std::span<const std::byte> bytes) {
  // a full disk still accepts writes within the file, and a part of those beyond
  const bool fails = disk_.steps.size() >= disk_.fails_at;
  const std::size_t room = disk_.file.size() > offset ? disk_.file.size() - offset : 0;
  const auto stored = !fails ? bytes : bytes.first(room > 0 ? 0 : bytes.size() / 2);
  disk_.steps.push_back({offset, {stored.begin(), stored.end()}, false});
  replay_step(disk_.steps.back(), disk_.file);
  return fails ? ENOSPC : 0;
}

int MemorySink::read_at(std::uint64_t offset, std::span<std::byte> bytes) {
  std::ranges::fill(bytes, std::byte{0});
  if (offset >= disk_.file.size()) return 0;
  const std::size_t count = std::min<std::size_t>(bytes.size(), disk_.file.size() - offset);
  std::copy_n(disk_.file.begin() + static_cast<std::ptrdiff_t>(offset), count, bytes.begin());
  return 0;
}

int MemorySink::resize(std::uint64_t size) {
  disk_.steps.push_back({size, {}, true});
  replay_step(disk_.steps.back(), disk_.file);
  return 0;
}

Result<void> MemorySource::read(std::span<std::byte> bytes) {
  if (remaining_.size() < bytes.size()) return Error{ErrorKind::kBadInput, "ended", "", ""};
  std::ranges::copy(remaining_.first(bytes.size()), bytes.begin());
  remaining_ = remaining_.subspan(bytes.size());
  return {};
}

bool MemoryTarget::write(std::span<const std::byte> more) {
  bytes.insert(bytes.end(), more.begin(), more.end());
  return true;
}

Result<Recording> receive_all(internal::ByteSource& source) {
  auto head = internal::receive_head(source);
  if (!head) return head.error();
  Recording recording{head->header, {}, {}, head->summary};
  const auto visit = [&](const RecordingPart& part) -> Result<void> {
    recording.ticks.insert(recording.ticks.end(), part.ticks.begin(), part.ticks.end());
    recording.events.insert(recording.events.end(), part.events.begin(), part.events.end());
    return {};
  };
  if (auto received = internal::receive_parts(source, *head, visit, {}); !received) return received.error();
  return recording;
}

Result<Recording> read_in_this_process(const std::filesystem::path& file) {
  MemoryTarget sent;
  {
    const internal::Hdf5Section section;
    internal::send_recording(file, sent);
  }
  MemorySource source(sent.bytes);
  return receive_all(source);
}

void write_bytes(const std::filesystem::path& file, std::span<const std::byte> bytes) {
  std::ofstream stream(file, std::ios::binary | std::ios::trunc);
  stream.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
}

std::vector<std::byte> read_bytes(const std::filesystem::path& file) {
  std::vector<std::byte> bytes(std::filesystem::file_size(file));
  std::ifstream(file, std::ios::binary)
      .read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  return bytes;
}

}  // namespace palpate::test
