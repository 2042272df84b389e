#include <cstdio>

#include "palpate/session.h"

namespace palpate {
namespace {

Eigen::Quaterniond quaternion(const std::array<double, 4>& wxyz) {
  return Eigen::Quaterniond(wxyz[0], wxyz[1], wxyz[2], wxyz[3]);
}

// what differs between a recorded tick and the same tick run again
std::string describe_difference(const TickRecord& recorded, const TickRecord& again) {
  char text[160];
  for (int d = 0; d < recorded.devices; ++d)
    for (int axis = 0; axis < 3; ++axis)
      if (recorded.device[d].force_N[axis] != again.device[d].force_N[axis]) {
        std::snprintf(text, sizeof text, "device %d force %c: recorded %.17g N, now %.17g N", d, "xyz"[axis],
                      recorded.device[d].force_N[axis], again.device[d].force_N[axis]);
        return text;
      }
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
    if (again.state_hash != recorded.state_hash) {
      result.first_difference = recorded.tick;
      result.difference = describe_difference(recorded, again);
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
