#pragma once

#include <vector>

#include "palpate/rendering/volume_marks.h"
#include "report/overlay.h"

/// How pictures of the volume show what happened.
namespace palpate::report {

/// As in the sections; the places stand out from bone.
inline constexpr Rgb kFreeWayColour{255, 255, 255}, kTouchingWayColour{255, 225, 77},
    kForceColour{79, 227, 255}, kToolColour{155, 227, 122}, kPlaceColour{255, 80, 70};
/// How much is seen of what lies behind structures.
inline constexpr double kWayBehind = 0.3, kPlaceBehind = 0.45;
/// Of the picture's width: the radii of a touched place and of a force.
inline constexpr double kPlaceShare = 0.007, kArrowShare = 0.004;

Point<Patient> proxy_place(const TickRecord& tick, int device);
/// A tool with its shaft where its proxy is held.
void add_tool(std::vector<VolumeMark>& marks, const Model& model, const TickRecord& tick, int device);

}  // namespace palpate::report
