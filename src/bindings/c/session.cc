#include "c/session.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "c/record.h"
#include "palpate/recording/recording.h"
#include "palpate/servo/servo_loop.h"

namespace palpate::c {
namespace {

// at least 0; infinite is permitted, NaN is not
bool is_limit(double value) {
  return value >= 0;
}

Error bad_option(const char* name, double value) {
  return {ErrorKind::kBadInput, "a value of " + std::to_string(value), name,
          "see plp_session_options in palpate.h"};
}

Result<void> check_numbers(const plp_session_options& options) {
  if (!is_limit(options.max_force_N)) return bad_option("max_force_N", options.max_force_N);
  if (!is_limit(options.max_torque_Nmm)) return bad_option("max_torque_Nmm", options.max_torque_Nmm);
  if (!(options.max_stiffness_N_per_mm > 0))
    return bad_option("max_stiffness_N_per_mm", options.max_stiffness_N_per_mm);
  if (!(options.slew_N_per_s > 0)) return bad_option("slew_N_per_s", options.slew_N_per_s);
  if (!std::isnan(options.continuous_force_N) && !(options.continuous_force_N > 0))
    return bad_option("continuous_force_N", options.continuous_force_N);
  if (!std::isnan(options.position_step_mm) && !(options.position_step_mm > 0))
    return bad_option("position_step_mm", options.position_step_mm);
  return {};
}

// frame of the caller to World and back; the model is not rotated in a session
void to_world(const plp_pose& pose, const SessionSetup& setup,
              const Transform<World, Patient>& X_WorldPatient, DeviceState& state) {
  const Eigen::Vector3d tip(pose.tip_mm);
  const double* const q = pose.orientation_wxyz;
  const Eigen::Quaterniond orientation(q[0], q[1], q[2], q[3]);
  if (setup.in_patient) {
    state.tip = X_WorldPatient * Point<Patient>(tip);
    state.R_WorldTool = Eigen::Quaterniond(X_WorldPatient.linear()) * orientation;
  } else {
    state.tip = Point<World>(tip);
    state.R_WorldTool = orientation;
  }
  state.buttons = pose.buttons;
  state.status = pose.status;
  state.age_s = pose.age_s;
}

plp_wrench wrench_of(const Wrench& wrench, const SessionSetup& setup,
                     const Transform<World, Patient>& X_WorldPatient) {
  const Eigen::Matrix3d R_OutWorld =
      setup.in_patient ? Eigen::Matrix3d(X_WorldPatient.linear().transpose()) : Eigen::Matrix3d::Identity();
  const Eigen::Vector3d force_N = R_OutWorld * wrench.force_N.eigen(),
                        torque_Nmm = R_OutWorld * wrench.torque_Nmm.eigen();
  plp_wrench plain{};
  plain.size = sizeof plain;
  for (int axis = 0; axis < 3; ++axis) {
    plain.force_N[axis] = force_N[axis];
    plain.torque_Nmm[axis] = torque_Nmm[axis];
  }
  return plain;
}

// Solution of soft tissue for the next tick, as on the virtual clock of a run.
void solve_soft_tissue(plp_session& session, double dt_s) {
  if (!session.soft_tissue) session.soft_tissue.emplace(std::clamp(1 / dt_s, kMinRate_hz, kMaxRate_hz));
  const TickRecord* const before = session.state.tick > 0 ? &session.record : nullptr;
  const bool is_deformable = before != nullptr && session.last_model != nullptr &&
                             is_elastic(session.last_model->tissue_law) &&
                             session.last_model->has(ForceMethod::kProxy);
  if (is_deformable ? session.soft_tissue->advance(*session.last_model, before)
                    : session.soft_tissue->publish_pending())
    session.setup.parameters.compliance = session.soft_tissue->frame();
}

bool is_duration(double dt_s) {
  return std::isfinite(dt_s) && dt_s >= 0;
}

// One tick of poses that have been checked for their sizes.
void advance(plp_session& session, const Elements<const plp_pose>& poses, std::size_t first, double dt_s) {
  const std::size_t devices = session.setup.devices;
  const Transform<World, Patient>& X_WorldPatient = session.model->X_WorldPatient;
  for (std::size_t d = 0; d < devices; ++d) {
    // the entry has at least the size of the struct
    plp_pose pose;
    std::memcpy(&pose, poses[first + d], sizeof pose);
    to_world(pose, session.setup, X_WorldPatient, session.states[d]);
  }
  if (session.setup.solve_soft_tissue) solve_soft_tissue(session, dt_s);
  tick(*session.model, session.setup.parameters, {session.states.data(), devices}, dt_s, session.state,
       {session.wrenches.data(), devices}, session.record);
  if (session.last_model != session.model) session.last_model = session.model;
  session.run_hash = mix_run_hash(session.run_hash, session.record.state_hash);
}

void put_wrenches(const plp_session& session, const Elements<plp_wrench>& wrenches, std::size_t first) {
  for (std::size_t d = 0; d < session.setup.devices; ++d)
    wrenches.put(first + d, wrench_of(session.wrenches[d], session.setup, session.model->X_WorldPatient));
}

plp_status check_run(const plp_session* session, const plp_pose* poses, std::size_t ticks, double dt_s) {
  if (!is_handle(session)) return PLP_BAD_INPUT;
  if (!is_duration(dt_s)) return fail(PLP_BAD_INPUT, "dt_s: a tick of " + std::to_string(dt_s) + " s");
  if (ticks > std::numeric_limits<std::ptrdiff_t>::max() / (kMaxStructBytes * std::size_t{kMaxDevices}))
    return fail(PLP_BAD_INPUT, "ticks: more than memory can hold");
  if (ticks > 0 && poses == nullptr) return fail(PLP_BAD_INPUT, "poses: null");
  return Elements<const plp_pose>(poses).ok() ? PLP_OK : PLP_BAD_INPUT;
}

}  // namespace

Result<SessionSetup> setup_of(const plp_model& model, const plp_session_options* options) {
  plp_session_options input;
  plp_session_options_init(&input, sizeof input);
  if (options != nullptr && !read(options, input))
    return Error{ErrorKind::kBadInput, plp_last_error(), "", ""};
  if (input.devices < 1 || input.devices > kMaxDevices) return bad_option("devices", input.devices);
  if (input.frame != PLP_WORLD && input.frame != PLP_PATIENT) return bad_option("frame", input.frame);
  const auto method = method_of(input.method);
  if (!method) return method.error();
  if (auto fine = check_numbers(input); !fine) return fine.error();

  SessionSetup setup;
  setup.devices = input.devices;
  setup.in_patient = input.frame == PLP_PATIENT;
  setup.solve_soft_tissue = input.solve_soft_tissue != 0;
  setup.method = method->value_or(model.method);
  if (!model.current().has(setup.method))
    return Error{ErrorKind::kUsage, "the model is not prepared for " + std::string(name_of(setup.method)),
                 "method", "make or load it with this method"};
  setup.parameters.method = setup.method;
  setup.parameters.friction = input.friction != 0;
  setup.parameters.viscosity = input.viscosity != 0;
  setup.parameters.passivity = input.passivity != 0;
  setup.parameters.max_force_N = input.max_force_N;
  for (std::size_t d = 0; d < setup.devices; ++d) {
    DeviceParameters& device = setup.parameters.device[d];
    device.max_stiffness_N_per_mm = input.max_stiffness_N_per_mm;
    device.position_step_mm = input.position_step_mm;
    device.limits.continuous_force_N = input.continuous_force_N;
    device.limits.slew_N_per_s = input.slew_N_per_s;
    if (input.max_torque_Nmm > 0) device.limits.peak_torque_Nmm = input.max_torque_Nmm;
  }
  return setup;
}

bool is_pose(const plp_pose& pose) {
  const Eigen::Map<const Eigen::Vector3d> tip(pose.tip_mm);
  const Eigen::Map<const Eigen::Vector4d> orientation(pose.orientation_wxyz);
  return tip.allFinite() && std::abs(orientation.norm() - 1) < 1e-3;
}

Result<void> check_can_switch(const plp_model& model, const std::shared_ptr<const int>& family,
                              const Model& current) {
  if (model.loaded.model.get() == &current) return {};
  if (model.family != family)
    return Error{ErrorKind::kBadInput, "this is a version of another model", "model", "make a session of it"};
  if (model.current().version <= current.version)
    return Error{ErrorKind::kBadInput,
                 "version " + std::to_string(model.current().version) + " is not later than version " +
                     std::to_string(current.version),
                 "model", "change the version that the session has"};
  return {};
}

}  // namespace palpate::c

using palpate::c::fail;
using palpate::c::guarded;
using palpate::c::is_handle;

plp_status plp_session_create(const plp_model* model, const plp_session_options* options,
                              plp_session** session) {
  return guarded([&] {
    if (session == nullptr) return fail(PLP_BAD_INPUT, "session: the place for the result is null");
    *session = nullptr;
    if (!is_handle(model)) return PLP_BAD_INPUT;
    auto setup = palpate::c::setup_of(*model, options);
    if (!setup) return fail(setup.error());
    auto created = std::make_unique<plp_session>();
    created->setup = *std::move(setup);
    created->family = model->family;
    created->model = model->loaded.model;
    *session = created.release();
    return PLP_OK;
  });
}

void plp_session_destroy(plp_session* session) {
  if (session != nullptr && is_handle(session)) delete session;
}

plp_status plp_session_tick(plp_session* session, const plp_pose* poses, double dt_s, plp_wrench* wrenches) {
  return guarded([&]() -> plp_status {
    const palpate::c::Elements<plp_wrench> out(wrenches);
    if (!is_handle(session) || !out.ok()) return PLP_BAD_INPUT;
    if (out.empty()) return fail(PLP_BAD_INPUT, "wrenches: null");
    const plp_status status = palpate::c::check_run(session, poses, 1, dt_s);
    if (status != PLP_OK) {
      for (std::size_t d = 0; d < session->setup.devices; ++d) out.put(d, plp_wrench{});
      return status;
    }
    palpate::c::advance(*session, palpate::c::Elements<const plp_pose>(poses), 0, dt_s);
    palpate::c::put_wrenches(*session, out, 0);
    return PLP_OK;
  });
}

plp_status plp_session_run(plp_session* session, const plp_pose* poses, size_t ticks, double dt_s,
                           plp_wrench* wrenches, plp_record* records) {
  return guarded([&]() -> plp_status {
    const palpate::c::Elements<plp_wrench> out(wrenches);
    const palpate::c::Elements<plp_record> log(records);
    const plp_status status = palpate::c::check_run(session, poses, ticks, dt_s);
    if (status != PLP_OK) return status;
    if (!out.ok() || !log.ok()) return PLP_BAD_INPUT;
    const palpate::c::Elements<const plp_pose> in(poses);
    const std::size_t devices = session->setup.devices;
    for (std::size_t first = 0; first < ticks * devices; first += devices) {
      palpate::c::advance(*session, in, first, dt_s);
      if (!out.empty()) palpate::c::put_wrenches(*session, out, first);
      if (log.empty()) continue;
      for (std::size_t d = 0; d < devices; ++d) log.put(first + d, palpate::c::record_of(session->record, d));
    }
    return PLP_OK;
  });
}

plp_status plp_session_record(const plp_session* session, size_t device, plp_record* record) {
  return guarded([&] {
    if (!is_handle(session)) return PLP_BAD_INPUT;
    if (device >= session->setup.devices)
      return fail(PLP_BAD_INPUT, "device: there is no device " + std::to_string(device));
    if (session->state.tick == 0) return fail(PLP_USAGE, "there was no tick");
    return palpate::c::write(palpate::c::record_of(session->record, device), record) ? PLP_OK : PLP_BAD_INPUT;
  });
}

plp_status plp_session_reset(plp_session* session) {
  return guarded([&] {
    if (!is_handle(session)) return PLP_BAD_INPUT;
    session->state = {};
    session->record = {};
    session->last_model.reset();
    session->soft_tissue.reset();
    session->setup.parameters.compliance = {};
    session->run_hash = 0;
    return PLP_OK;
  });
}

plp_status plp_session_set_model(plp_session* session, const plp_model* model) {
  return guarded([&] {
    if (!is_handle(session) || !is_handle(model)) return PLP_BAD_INPUT;
    if (auto fine = palpate::c::check_can_switch(*model, session->family, *session->model); !fine)
      return fail(fine.error());
    if (!model->current().has(session->setup.method))
      return fail(PLP_USAGE, "model: this version is not prepared for the session's method");
    session->model = model->loaded.model;
    return PLP_OK;
  });
}

plp_status plp_session_hash(const plp_session* session, uint64_t* ticks, uint64_t* run_hash) {
  return guarded([&] {
    if (!is_handle(session)) return PLP_BAD_INPUT;
    if (ticks == nullptr || run_hash == nullptr)
      return fail(PLP_BAD_INPUT, "ticks or run_hash: the place for the result is null");
    *ticks = session->state.tick;
    *run_hash = session->run_hash;
    return PLP_OK;
  });
}
