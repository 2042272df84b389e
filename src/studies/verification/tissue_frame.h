#pragma once

#include <cstddef>

namespace palpate {

/// Processor time of the calling thread, s.
double tissue_thread_seconds();

/// Cost of a frame of soft tissue on this machine, in processor time of one thread.
struct TissueFrame {
  std::size_t cells = 0;     ///< Number of deformable cells
  double frame_ms = 0;       ///< Median over the frames
  double error_percent = 0;  ///< Maximum error of the compliance under the tool relative to the converged one
  double kernel_ns = 0;      ///< K u, per cell, minimum over all runs
  double floor_ns = 0;       ///< A plain loop with the same memory traffic, per cell, minimum over all runs
};

/// A sphere slides at 20 mm/s over 39 105 cells of layered tissue on one layer of bone, at 60 frames a second
/// with two iterations each, starting from the last solution.
TissueFrame measure_tissue_frame(int frames);

}  // namespace palpate
