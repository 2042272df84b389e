#pragma once

#include "palpate/servo/servo.h"
#include "servo/output_stage.h"

/// Conversion of a tick's inputs and outputs to the plain numbers of telemetry.h.
namespace palpate {

/// Records the inputs that all devices share, before the tick uses them.
void record_inputs(const Model& model, const Parameters& parameters, const SessionState& state, double dt_s,
                   std::size_t devices, TickRecord& record);

/// Records one device's inputs and resets its outputs to zero.
void record_inputs(const DeviceState& device, const DeviceParameters& parameters, DeviceTick& out);

/// Records one device's contact and the wrench sent to it.
void record_outputs(const ToolContact& tool, const OutputRequest& request, const Output& sent,
                    const SessionState::DeviceSession& session, DeviceTick& out);

std::array<double, 4> plain(const Eigen::Quaterniond& q);

}  // namespace palpate
