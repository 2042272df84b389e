#include <algorithm>
#include <bit>
#include <cstdio>

#include "palpate/session.h"

namespace palpate {
namespace {

Eigen::Quaterniond quaternion(const std::array<double, 4>& wxyz) {
  return Eigen::Quaterniond(wxyz[0], wxyz[1], wxyz[2], wxyz[3]);
}

bool same_bits(double a, double b) {
  return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b);
}
template <std::size_t n>
bool same_bits(const std::array<double, n>& a, const std::array<double, n>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), [](double x, double y) { return same_bits(x, y); });
}

std::string text_of(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.17g", value);
  return text;
}
template <std::size_t n>
std::string text_of(const std::array<double, n>& values) {
  std::string text;
  for (const double value : values) text += (text.empty() ? "" : " ") + text_of(value);
  return text;
}

// every output of a device's tick; the first that differs, in words, or nothing
std::string first_different_output(const DeviceTick& recorded, const DeviceTick& again) {
  std::string difference;
  const auto compare = [&](const char* name, const auto& a, const auto& b) {
    if (difference.empty() && !same_bits(a, b))
      difference = std::string(name) + ": recorded " + text_of(a) + ", now " + text_of(b);
  };
  compare("force_N", recorded.force_N, again.force_N);
  compare("torque_Nmm", recorded.torque_Nmm, again.torque_Nmm);
  compare("unclamped_force_N", recorded.unclamped_force_N, again.unclamped_force_N);
  compare("tip_patient_mm", recorded.tip_patient_mm, again.tip_patient_mm);
  compare("normal_patient", recorded.normal_patient, again.normal_patient);
  compare("velocity_patient_mm_s", recorded.velocity_patient_mm_s, again.velocity_patient_mm_s);
  compare("field", recorded.field, again.field);
  compare("depth_mm", recorded.depth_mm, again.depth_mm);
  compare("label", static_cast<double>(recorded.label), static_cast<double>(again.label));
  compare("flags", static_cast<double>(recorded.flags), static_cast<double>(again.flags));
  return difference;
}

// what differs between a recorded tick and the same tick run again: outputs first, because they say
// more than a hash; nothing when they are the same
std::string first_difference(const TickRecord& recorded, const TickRecord& again) {
  for (int d = 0; d < recorded.devices; ++d) {
    const std::string difference = first_different_output(recorded.device[d], again.device[d]);
    if (!difference.empty()) return "device " + std::to_string(d) + " " + difference;
  }
  if (!same_bits(recorded.rotation_felt_wxyz, again.rotation_felt_wxyz))
    return "rotation_felt_wxyz: recorded " + text_of(recorded.rotation_felt_wxyz) + ", now " +
           text_of(again.rotation_felt_wxyz);
  if (recorded.state_hash == again.state_hash) return "";
  char text[80];
  std::snprintf(text, sizeof text, "state hash: recorded %016llx, now %016llx",
                static_cast<unsigned long long>(recorded.state_hash),
                static_cast<unsigned long long>(again.state_hash));
  return text;
}

}  // namespace

Result<ReplayResult> replay(const Recording& recording, const Model& model, const Progress& progress) {
  if (recording.header.model_hash != model.content_hash)
    return Error{ErrorKind::kBadInput, "the recording was made with another scene or other volumes", "",
                 "name the scene file or data set that it was made with; a changed scene is another model"};

  ReplayResult result;
  SessionState state;
  for (const TickRecord& recorded : recording.ticks) {
    if (result.ticks % 1000 == 0) {
      progress.report("replaying",
                      static_cast<double>(result.ticks) / static_cast<double>(recording.ticks.size()));
      if (progress.stopped()) return Progress::interrupted();
    }

    if (recorded.method > static_cast<std::uint8_t>(ForceMethod::kTrilinear))
      return Error{
          ErrorKind::kBadInput,
          "tick " + std::to_string(recorded.tick) + " used a force method that this version does not have",
          "", "replay it with the version that made it"};

    // every input of the tick as it was
    Parameters parameters;
    parameters.method = static_cast<ForceMethod>(recorded.method);
    parameters.friction = recorded.switches & kSwitchFriction;
    parameters.viscosity = recorded.switches & kSwitchViscosity;
    parameters.paused = recorded.switches & kSwitchPaused;
    parameters.max_force_N = recorded.max_force_N;
    parameters.rotation_target = quaternion(recorded.rotation_target_wxyz);
    std::array<DeviceState, kMaxDevices> devices;
    for (int d = 0; d < recorded.devices; ++d) {
      const DeviceTick& in = recorded.device[d];
      devices[d].tip = Point<World>(in.tip_world_mm[0], in.tip_world_mm[1], in.tip_world_mm[2]);
      devices[d].R_WorldTool = quaternion(in.orientation_wxyz);
      devices[d].buttons = in.buttons;
    }

    std::array<Wrench, kMaxDevices> wrenches;
    TickRecord again;
    const std::size_t count = static_cast<std::size_t>(recorded.devices);
    tick(model, parameters, {devices.data(), count}, recorded.dt_s, state, {wrenches.data(), count}, again);
    result.ticks += 1;
    result.run_hash = mix_run_hash(result.run_hash, again.state_hash);
    result.difference = first_difference(recorded, again);
    if (!result.difference.empty()) {
      result.first_difference = recorded.tick;
      return result;
    }
  }
  progress.report("replaying", 1);
  // a complete recording also carries the hash of the whole run
  result.identical = !recording.summary || recording.summary->run_hash == result.run_hash;
  if (!result.identical) {
    result.first_difference = result.ticks;
    result.difference = "the recording's ticks are not all there";
  }
  return result;
}

}  // namespace palpate
