#pragma once

#include <cstdint>
#include <memory>

#include "palpate/haptics/haptics.h"

/// Soft tissue that is cut while a sphere presses it (CarvedCells), and boxes that are laid anew.
namespace palpate {

/// Frame by frame, of the block that yielding_block() makes, pressed 2 mm deep at its middle by 3 mm.
struct CutTissue {
  /// How far two iterations a frame leave W from that of the same cells when it has converged, at worst.
  double lag_percent = 0;
  /// How far W is at worst from that of cells that are as they are cut at once.
  double behind_percent = 0;
  /// Of the force in a frame, at most.
  double change_percent = 0;
  double force_changed_percent = 0;    ///< from first to last
  double follow_ms = 0, frame_ms = 0;  ///< processor time, medians: cells that follow, all of a frame
  std::uint64_t frames = 0;
};
/// A ball of 4 mm mills a groove 3 mm deep past the place, whose edge is 2.5 mm from its middle.
CutTissue mill_beside(const Model& model, double speed_mm_s);
/// The surface is taken off under the place, 12 mm wide, 4 mm deep.
CutTissue trim_under(const Model& model, double speed_mm_s);

/// Slid 2 mm deep along a block that is the same everywhere: how much the force changes at most in a frame
/// for which the box was laid anew; percent.
struct Recentring {
  double change_percent = 0;
  std::uint64_t boxes = 0;
};
Recentring slide_through_boxes(const Model& model, double speed_mm_s);

}  // namespace palpate
