#pragma once

#include "palpate/servo/servo.h"
#include "servo/output_stage.h"

/// Ticks as the plain numbers of telemetry.h.
namespace palpate {

/// Every input of a tick, before anything is made of it.
void record_inputs(const Model& model, const Parameters& parameters, const SessionState& state, double dt_s,
                   std::size_t devices, TickRecord& record);

/// Every input that belongs to a device; the outputs become zero.
void record_inputs(const DeviceState& device, const DeviceParameters& parameters, DeviceTick& out);

/// What a device met, and what it was sent.
void record_outputs(const ToolContact& tool, const OutputRequest& request, const Output& sent,
                    const SessionState::Hand& hand, DeviceTick& out);

std::array<double, 4> plain(const Eigen::Quaterniond& q);

}  // namespace palpate
