#pragma once

#include <span>

#include "palpate/servo/servo.h"

/// Rotation of the object towards the commanded attitude, with an account of the work it does on the
/// operators. docs/concepts/passivity.md, "A turning object", derives the limits.
///
/// The displacement of a tip in World is its displacement relative to the object plus the object's own
/// displacement at the tip:
///
///     p - p' = R (q - q')   +   (R - R') q'          q: the tip in the patient; ': a tick ago
///              observer E       account, limited
///
/// The passivity observer counts the first term, this account the second.
namespace palpate {

/// Rotates the object towards the commanded rotation, which it reaches kRotationSettings.interval_s after the
/// command at the earliest; slower where the limits require it. Adds the work to each device's `turned_mJ`. A
/// command that is not a rotation is ignored.
/// @param devices  states of this tick; the work is that of the forces sent in the last one
/// @return bit d is set where device d limited the rotation
std::uint32_t rotate_object(const Model& model, const Parameters& parameters,
                            std::span<const DeviceState> devices, double dt_s, SessionState& state);

/// Whether `q` is a unit quaternion up to rounding (norm between 0.5 and 2).
bool is_rotation(const Eigen::Quaterniond& q);

}  // namespace palpate
