#pragma once

#include <memory>
#include <string>

#include "palpate/haptics/haptics.h"
#include "palpate/tissue/yield_solver.h"

/// Cells of soft tissue that a machine has the time for.
namespace palpate {

/// A model whose soft tissue is solved in time.
struct CarriedCells {
  std::shared_ptr<const Model> model;
  std::string told;  ///< that its cells are coarser than they should be, in words; empty: they are not
};

/// Solves some frames on this thread, at a place where soft tissue is outermost, and lets cells be 1.25, 1.6
/// or 2 times as long (Model::tissue_coarsened) as long as a frame takes more of the thread's processor time
/// than that. Bounded: under a second where a frame takes a tenth of one.
/// @param model         prepared for the proxy; one that does not yield, or that has such a factor already,
/// is
///                      given back as it is
/// @param most_frame_s  by default three quarters of the time from one frame to the next, so that other
///                      threads have some
CarriedCells with_carried_cells(std::shared_ptr<const Model> model,
                                double most_frame_s = 0.75 * kYieldFrame_s);

}  // namespace palpate
