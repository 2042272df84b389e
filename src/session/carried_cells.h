#pragma once

#include <cstddef>
#include <memory>
#include <string>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"
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
/// than that. It takes the time of some 40 frames at most. A model that does not yield, or that has such a
/// factor already, is given back as it is.
/// @param model         prepared for the proxy
/// @param devices       that press at once, each with a box of its own in every frame; 1 ... kMaxDevices
/// @param most_frame_s  by default three quarters of the time from one frame to the next, so that other
///                      threads have some
CarriedCells with_carried_cells(std::shared_ptr<const Model> model, std::size_t devices,
                                double most_frame_s = 0.75 * kYieldFrame_s);

/// A model whose soft tissue goes by that law (under_law, with surfaces that were prepared before where they
/// are kept), and where it yields by it as above, whatever factor the model has. Takes seconds where the law
/// has other surfaces. Errors: those of under_law; kBadInput where there is no memory for both at a time.
Result<CarriedCells> carried_under_law(const Model& felt, TissueLaw law, std::size_t devices,
                                       const Progress& progress = {});

}  // namespace palpate
