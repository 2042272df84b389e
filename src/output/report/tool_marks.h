#pragma once

#include <vector>

#include "palpate/rendering/volume_marks.h"
#include "report/overlay.h"

/// Graphic marks in pictures of the volume.
namespace palpate::report {

/// Colours as in the sections; contact points contrast with bone.
inline constexpr Rgb kFreePathColour{255, 255, 255}, kTouchingPathColour{255, 225, 77},
    kForceColour{79, 227, 255}, kToolColour{155, 227, 122}, kPositionColour{255, 80, 70};
/// Opacity of marks behind structures.
inline constexpr double kPathBehind = 0.3, kPositionBehind = 0.45;
/// Radii of contact points and force arrows as a fraction of the picture's width.
inline constexpr double kPositionFraction = 0.007, kArrowFraction = 0.004;

Point<Patient> proxy_position(const TickRecord& tick, int device);
/// Adds a tool with its shaft at the position of its proxy.
void add_tool(std::vector<VolumeMark>& marks, const Model& model, const TickRecord& tick, int device);

}  // namespace palpate::report
