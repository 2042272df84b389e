#pragma once

#include <cstdint>
#include <memory>

#include "palpate/contact/model.h"

/// Soft tissue that is cut while a sphere presses it (CarvedCells), and re-centred solution boxes.
namespace palpate {

/// Figures per frame, for the block of soft_block() with a 3 mm sphere pressed 2 mm deep at its centre.
struct CutTissue {
  /// Maximum error of the compliance W with two iterations per frame, relative to the converged solution of
  /// the same cells.
  double lag_percent = 0;
  /// Maximum error of W relative to cells that are cut immediately.
  double behind_percent = 0;
  /// Maximum relative change of the force in a frame.
  double change_percent = 0;
  double force_changed_percent = 0;  ///< Change from first to last
  /// Median processor times: of updating the cells, and of the whole frame
  double update_ms = 0, frame_ms = 0;
  std::uint64_t frames = 0;
};
/// A ball of 4 mm mills a groove 3 mm deep past the contact; its edge is 2.5 mm from the contact's centre.
CutTissue mill_nearby(const Model& model, double speed_mm_s);
/// The surface under the contact is removed, 12 mm wide and 4 mm deep.
CutTissue trim_under(const Model& model, double speed_mm_s);

/// A sphere slides 2 mm deep along a homogeneous block: maximum change of the force in a frame in which the
/// box is re-centred; percent.
struct Recentring {
  double change_percent = 0;
  std::uint64_t boxes = 0;
};
Recentring slide_through_boxes(const Model& model, double speed_mm_s);

}  // namespace palpate
