#pragma once

#include <cstddef>
#include <memory>
#include <string>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"
#include "palpate/contact/model.h"
#include "palpate/tissue/soft_tissue_solver.h"

/// Choice of the soft-tissue solver's cell size by this machine's speed.
namespace palpate {

/// Model whose soft tissue can be solved in real time on this machine.
struct MeasuredCells {
  std::shared_ptr<const Model> model;
  std::string warning;  ///< Warning text if the cells are coarser than the scene requests; empty otherwise
};

/// Measures the solver's frame time on this thread, at a point where soft tissue is outermost, and increases
/// the cell length by a factor of 1.25, 1.6 or 2 (Model::tissue_cell_factor) until a frame fits `max_frame_s`
/// of processor time. Takes at most the time of about 40 frames. A model whose tissue is not elastic, or that
/// already has a factor, is returned unchanged.
/// @param model         prepared for the proxy
/// @param devices       number of devices that press simultaneously, each with a solver box of its own;
///                      1 ... kMaxDevices
/// @param max_frame_s   processor time available per frame; by default three quarters of the frame period,
///                      which leaves some to other threads
MeasuredCells with_measured_cells(std::shared_ptr<const Model> model, std::size_t devices,
                                  double max_frame_s = 0.75 * kSolverFrame_s);

/// Switches a model to another law (under_law; surfaces prepared earlier are taken from the cache) and, if
/// that law is elastic, chooses the cell size as above, ignoring the factor of `model`. Takes seconds if the
/// law needs other surfaces. Errors: those of under_law; kBadInput if both sets of surfaces do not fit in
/// memory.
Result<MeasuredCells> measured_under_law(const Model& model, TissueLaw law, std::size_t devices,
                                         const Progress& progress = {});

}  // namespace palpate
