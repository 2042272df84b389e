#pragma once

#include <array>
#include <memory>
#include <optional>

#include "c/guard.h"
#include "c/model.h"
#include "palpate/servo/servo.h"
#include "palpate/tissue/soft_tissue_solver.h"

namespace palpate::c {

/// Options of a session, checked.
struct SessionSetup {
  std::size_t devices = 1;
  bool in_patient = false;  ///< Poses and wrenches are in Patient, otherwise in World
  bool solve_soft_tissue = false;
  ForceMethod method = ForceMethod::kProxy;
  Parameters parameters;
};
/// Errors: kBadInput for an option out of range; kUsage for a method that the model is not prepared for.
Result<SessionSetup> setup_of(const plp_model& model, const plp_session_options* options);

/// Whether a pose is finite with a unit quaternion.
bool is_pose(const plp_pose& pose);

/// Checks that a session or loop can switch to `model`: it must be `current` itself, or a later version of
/// the same family. Errors: kBadInput.
Result<void> check_can_switch(const plp_model& model, const std::shared_ptr<const int>& family,
                              const Model& current);

}  // namespace palpate::c

struct plp_session {
  static constexpr palpate::c::Tag kTag = palpate::c::Tag::kSession;
  ~plp_session() { tag = palpate::c::Tag::kNone; }

  palpate::c::Tag tag = kTag;
  palpate::c::SessionSetup setup;
  std::shared_ptr<const int> family;
  std::shared_ptr<const palpate::Model> model, last_model;  ///< Model of the next tick, and of the last one
  palpate::SessionState state;
  palpate::TickRecord record;
  std::array<palpate::DeviceState, palpate::kMaxDevices> states;
  std::array<palpate::Wrench, palpate::kMaxDevices> wrenches;
  std::optional<palpate::VirtualClockSoftTissueSolver> soft_tissue;
  std::uint64_t run_hash = 0;
};
