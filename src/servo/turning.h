#pragma once

#include <span>

#include "palpate/servo/servo.h"

/// How the object turns to where it was told to be, and what that does to a hand. docs/concepts/passivity.md,
/// "A turning object", derives the limits.
///
/// The way of a tip in World is its way relative to the object and the object's own way under it:
///
///     p - p' = R (q - q')   +   (R - R') q'          q: the tip in the patient; ': a tick ago
///              observer E       account, limited
///
/// Passivity counts the first, this the second.
namespace palpate {

/// Turns the object towards the commanded rotation, kTurningFeel.interval_s after the command at the
/// earliest, and slower where the limits ask for it. Counts the work in each hand's `turned_mJ`. A command
/// that is no rotation is left alone.
/// @param devices  as they are in this tick; the work is that of what they were sent in the last one
/// @return bit d is set where device d held the object back
std::uint32_t turn_object(const Model& model, const Parameters& parameters,
                          std::span<const DeviceState> devices, double dt_s, SessionState& state);

/// A commanded rotation is a unit quaternion but for rounding.
bool is_rotation(const Eigen::Quaterniond& q);

}  // namespace palpate
